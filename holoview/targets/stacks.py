"""Focal stacks rendered elsewhere: a folder of pictures, the pages of a TIFF, the parts or layers of an EXR file."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.errors import UserError
from holoview.plan import make_plan
from holoview.system import System
from holoview.targets.focal_stack import Target
from holoview.targets.picture import Picture, fit, read_picture
from holoview.targets.raster import by_number, page_count
from holoview.targets.saturation import scaled_saturation

_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr")


def is_stack(path: str | os.PathLike[str]) -> bool:
    """Whether a path names several pictures: a folder, or a file of several pages.

    Raises UserError when the file is missing, empty or unreadable.
    """
    return Path(path).is_dir() or page_count(Path(path)) > 1


def stack_for(
    system: System,
    path: str | os.PathLike[str],
    brightness: float = 1.0,
    saturation: float = 1.0,
    space: str = "srgb",
) -> Target:
    """A ready focal stack, one picture a plane of the system in its order, fitted to the simulation grid.

    Raises UserError when the number of pictures and of planes differ, when one can't be read, or their sizes differ.
    """
    stack = read_stack(path, make_plan(system).grid.shape, space, pictures=len(system.planes_m))
    return Target.of(scaled_saturation(stack, saturation), tuple(system.planes_m), str(path), brightness)


def read_stack(
    source: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    shape: tuple[int, int],
    space: str = "srgb",
    pictures: int | None = None,
) -> NDArray[np.float32]:
    """A ready focal stack as (plane, y, x, 3) linear light fitted to `shape` (y, x).

    source: a folder (its PNG, JPEG, TIFF and OpenEXR files in the order of the numbers in their names), a TIFF with a
    page a plane, an OpenEXR file with a part or a layer a plane, or the files in the planes' order. pictures: how many
    there have to be.

    Raises UserError when there are none or another number, when one can't be read, or when their sizes differ.
    """
    where, pages = _pages(source)
    if not pages:
        raise UserError(where, "holds no pictures", expected=f"one a plane ({', '.join(_PICTURES)})")
    if pictures is not None and len(pages) != pictures:
        raise UserError(
            where,
            f"holds {len(pages)} pictures",
            expected=f"one for each of {pictures} planes",
            remedy="change the planes (--set planes=…) or the stack",
        )
    stack: list[NDArray[np.float32]] = []
    first: tuple[int, ...] = ()
    for file, page in pages:
        picture = read_picture(file, space, page)
        first = first or picture.rgb.shape
        _check_size(picture, first, pages[0][0].name)
        stack.append(fit(picture.rgb, shape))
    return np.stack(stack)


def _pages(
    source: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
) -> tuple[str, list[tuple[Path, int | None]]]:
    """What to call the stack, and the file and page of each picture; None is the only page."""
    if not isinstance(source, str | os.PathLike):
        return "focal stack", [(Path(file), None) for file in source]
    path = Path(source)
    if path.is_dir():
        return str(source), [(file, None) for file in _files_in(path)]
    return str(source), [(path, page) for page in range(page_count(path))]


def _check_size(picture: Picture, first: tuple[int, ...], name: str) -> None:
    if picture.rgb.shape != first:
        found = f"is {picture.rgb.shape[1]} × {picture.rgb.shape[0]}"
        raise UserError(picture.source, found, expected=f"{first[1]} × {first[0]} as {name}")


def _files_in(folder: Path) -> list[Path]:
    files = [f for f in folder.iterdir() if f.suffix.lower() in _PICTURES and not f.name.startswith(".")]
    return sorted(files, key=lambda f: by_number(f.name))
