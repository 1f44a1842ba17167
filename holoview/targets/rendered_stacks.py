"""Reads focal stacks rendered elsewhere: a folder of pictures, TIFF pages, OpenEXR parts or layers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from holoview.model.focus import focused_planes
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.targets.focal_stack import Target, check_brightness
from holoview.targets.image_reader import picture_count
from holoview.targets.picture import Picture, read_picture, read_pictures, resize_to_cover
from holoview.targets.raster import natural_sort_key
from holoview.targets.saturation import check_saturation, scale_saturation
from holoview.util.errors import UserError

_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr")

StackSource = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]
"""A folder, a file of several pictures, or the files of single pictures."""


def is_stack(path: str | os.PathLike[str]) -> bool:
    """Whether a path holds several pictures: a folder, or a file of several pages, parts or numbered layers.

    Only headers are read. Raises UserError when the file is missing, empty, truncated, or no picture.
    """
    return Path(path).is_dir() or picture_count(Path(path)) > 1


def target_from_stack(
    system: System,
    path: str | os.PathLike[str],
    *,
    brightness: float = 1.0,
    saturation: float = 1.0,
    space: str = "srgb",
) -> Target:
    """The target of a rendered focal stack: one picture for each plane of the system, resized to the simulation grid.

    With an eye, one for each of its accommodations, already seen by that eye.

    path: a folder (its PNG, JPEG, TIFF and OpenEXR files in the order of the numbers in their names), a TIFF file with
    a page for each plane, or an OpenEXR file with a part or a numbered layer for each. brightness: factor on linear
    light. saturation: factor on chroma in CIE LCHuv. space: what float files hold, "srgb" or "xyz".

    Raises UserError when a picture can't be read, when their sizes differ, or when there isn't one for each plane.
    """
    check_brightness(brightness)
    check_saturation(saturation)
    planes_m = focused_planes(system)
    pictures = read_resized_pictures(path, make_plan(system).grid.shape, space, len(planes_m))
    stack = np.stack([scale_saturation(picture.rgb, saturation) for picture in pictures])
    return Target.from_stack(stack, tuple(planes_m), str(path), brightness, merge_notes(pictures))


def read_resized_pictures(
    source: StackSource, shape: tuple[int, int], space: str = "srgb", expected_count: int | None = None
) -> list[Picture]:
    """The pictures of a stack, each resized to `shape` (y, x) when it is read.

    source: a path as in `target_from_stack`, or the files in the order of the planes. expected_count: number of
    pictures, any when None. Raises UserError as `target_from_stack` does.
    """
    where, count, pictures = _open_source(source, space)
    if count == 0:
        raise UserError(where, "holds no pictures", expected=f"one a plane ({', '.join(_IMAGE_SUFFIXES)})")
    if expected_count not in (None, count):
        raise UserError(
            where,
            f"holds {count} picture{'s' * (count > 1)}",
            expected=f"one for each of {expected_count} plane{'s' * (expected_count != 1)}",
            remedy="change the planes (--set planes=…) or the stack",
        )
    first: Picture | None = None
    resized = []
    for picture in pictures:
        first = first or picture
        _check_size(picture, first)
        resized.append(replace(picture, rgb=resize_to_cover(picture.rgb, shape)))
    return resized


def _open_source(source: StackSource, space: str) -> tuple[str, int, Iterator[Picture]]:
    """Name of the stack in errors, number of pictures, and the pictures, which are read one by one."""
    if isinstance(source, str | os.PathLike):
        where, path = str(source), Path(source)
        if not path.is_dir():
            return where, picture_count(path), read_pictures(path, space)
        files = image_files(path)
    else:
        where, files = "focal stack", [Path(file) for file in source]
    return where, len(files), (read_picture(file, space) for file in files)


def image_files(folder: Path) -> list[Path]:
    """The PNG, JPEG, TIFF and OpenEXR files of a folder, in the order of the numbers in their names."""
    try:
        files = [f for f in folder.iterdir() if f.suffix.lower() in _IMAGE_SUFFIXES and not f.name.startswith(".")]
    except OSError as error:
        raise UserError(str(folder), f"can't be read: {error.strerror}", remedy="check its permissions") from error
    return sorted(files, key=lambda f: natural_sort_key(f.name))


def _check_size(picture: Picture, first: Picture) -> None:
    (height, width), (rows, columns) = picture.rgb.shape[:2], first.rgb.shape[:2]
    if (height, width) != (rows, columns):
        raise UserError(
            picture.source,
            f"is {width} × {height}",
            expected=f"{columns} × {rows} as {Path(first.source).name}",
            remedy="render all at one size",
        )


def merge_notes(pictures: Sequence[Picture]) -> tuple[str, ...]:
    """The notes of all pictures once, then those of some with the picture's name."""
    shared = [note for note in pictures[0].notes if all(note in picture.notes for picture in pictures)]
    single = [f"{Path(p.source).name}: {note}" for p in pictures for note in p.notes if note not in shared]
    return (*shared, *single)
