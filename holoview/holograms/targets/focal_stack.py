"""Renders a focal stack with incoherent defocus from a picture and a depth map (layers, occlusion, inpainting).

The viewer looks against the light, so that what has the larger distance z behind the last modulator is nearer to the
viewer, and occludes what has a smaller one.

The picture is cut into layers of nearly equal depth. On each plane they are composited from far to near; each layer's
light and mask m are convolved with the blur kernel K of its distance, and its blurred mask occludes what lies behind:

    light ← light·(1 − K∗m) + K∗(m·rgb)        coverage ← coverage·(1 − K∗m) + K∗m        result = light / coverage

Where a nearer layer occludes a farther one, the farther one is inpainted beneath it from its neighbourhood, because a
blurred edge is translucent. The division by the coverage compensates for light that is still missing.

Limits: the masks of different layers count as statistically independent, surfaces as matt (a reflection is blurred by
the mirror's distance, not by that of the mirrored things), and occluded parts of the scene are guessed.

`Film` has the pictures of a video file, read by PyAV, or of a folder in the natural order of their names.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.image_reader import ANIMATED, animation_count, file_format, picture_count
from holoview.holograms.files.raster import natural_sort_key
from holoview.holograms.targets.defocus import LayerBlur, LightCone, checked_depth, layer_count, split_layers
from holoview.holograms.targets.picture import (
    Picture,
    check_saturation,
    read_animated,
    read_picture,
    read_pictures,
    resize_to_cover,
    scale_saturation,
)
from holoview.light.colour import srgb_decode
from holoview.light.model.focus import focused_planes
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.files import require_file
from holoview.util.packages import import_optional
from holoview.util.processes import process_cpu_count

_MOST_THREADS = 8  # of a stack, which has few planes


@dataclass(frozen=True)
class Target:
    """The focal stack that a hologram is optimised for.

    stack: (plane, y, x, 3) float32 linear sRGB with `brightness` already applied. planes_m: distances of the planes.
    source: its source, in words. notes: changes that were made on the way, for the user. are_planes_given: whether its
    pictures were given for the planes, as those of a rendered stack are, not made for them.
    Raises UserError when the numbers of pictures and of planes differ or all is black, ValueError for other shapes.
    """

    stack: NDArray[np.float32]
    planes_m: tuple[float, ...]
    source: str
    brightness: float = 1.0
    notes: tuple[str, ...] = ()
    are_planes_given: bool = False

    def __post_init__(self) -> None:
        if self.stack.ndim != 4 or self.stack.shape[-1] != 3:
            raise ValueError(f"stack {self.stack.shape}: expected (plane, y, x, 3)")
        if len(self.stack) != len(self.planes_m):
            raise UserError(
                self.source,
                f"has {len(self.stack)} pictures",
                expected=f"one for each of the {len(self.planes_m)} planes",
            )
        if not self.stack.any():
            raise UserError(self.source, "is black everywhere", expected="a target with light in it")

    @classmethod
    def from_stack(
        cls,
        stack: NDArray[np.float32],
        planes_m: Sequence[float] | NDArray[np.floating],
        source: str,
        brightness: float = 1.0,
        notes: tuple[str, ...] = (),
    ) -> Target:
        """The target of `stack` times `brightness`, a factor on linear light. UserError unless it is positive."""
        check_brightness(brightness)
        scaled = np.asarray(stack, dtype=np.float32) * np.float32(brightness)
        return cls(scaled, tuple(float(z) for z in planes_m), source, brightness, notes)


def check_brightness(brightness: float) -> None:
    """Raises UserError for a factor on linear light that isn't finite and positive."""
    if not (math.isfinite(brightness) and brightness > 0):
        raise UserError("brightness", f"{brightness:g}", expected="a positive number", remedy="1 changes nothing")


def render_focal_stack(
    rgb_linear: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    planes_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
    cone: LightCone | Sequence[LightCone],
    layers: int | None = None,
) -> NDArray[np.float32]:
    """The focal stack of a picture in incoherent light, (plane, y, x, 3) float32.

    rgb_linear: (y, x, 3) linear light. depth_m: distance z of the picture or of each pixel (y, x) behind the last
    modulator; larger is nearer to the viewer. planes_m: distances z (n,) of the planes. pitch_m: of the picture's
    pixels. cone: of the light that reaches an image point, or a cone for each plane.
    layers: greatest number of layers. By default as many as keep blur radius and shift of each depth within half a
    pixel of its layer's, but at most 24.

    Near the borders the result is divided by the fraction of the kernel inside the picture, so that an even picture
    stays even and the borders don't darken. For a cone off the axis, the picture is continued by its outermost pixels.

    Raises ValueError for wrong shapes, or numbers that aren't finite (positive where due).
    """
    depth = checked_depth(rgb_linear, depth_m, planes_m, pitch_m)
    cones = [cone] * len(planes_m) if isinstance(cone, LightCone) else list(cone)
    count = max(layer_count(depth, one, pitch_m) for one in dict.fromkeys(cones))
    labels, distances = split_layers(depth, layers or count)
    cones_at = list(zip(cones, np.asarray(planes_m, dtype=np.float64).tolist(), strict=True))
    shifts = [one.shift_px(z - d, pitch_m) for one, z in cones_at for d in distances.tolist()]
    margin = max(math.ceil(abs(shift)) for pair in shifts for shift in pair)
    most = max(labels.shape) + 2 * margin - 1  # between two of the picture's pixels
    kernels = [[one.kernel(z - d, pitch_m, most) for one, z in cones_at] for d in distances.tolist()]
    if margin:
        rgb_linear = np.pad(rgb_linear, ((margin, margin), (margin, margin), (0, 0)), mode="edge")
        labels = np.pad(labels, margin, mode="edge")
    light = _composite_layers(rgb_linear, labels, kernels)
    inside = slice(margin, -margin or None)
    return np.ascontiguousarray(np.moveaxis(light[:, :, inside, inside], 1, -1))


def _composite_layers(
    rgb: NDArray[np.float32], labels: NDArray[np.int64], kernels: Sequence[Sequence[NDArray[np.float64]]]
) -> NDArray[np.float32]:
    """The light (plane, channel, y, x) of layers that occlude each other. kernels: of each layer, on each plane.

    Planes are computed in threads of their own, and the next layer beside them.
    """
    height, width = labels.shape
    reach = max(len(kernel) // 2 for layer in kernels for kernel in layer)
    total = np.zeros((len(kernels[0]), rgb.shape[-1] + 1, height, width), dtype=np.float32)
    whole = (slice(0, height), slice(0, width))
    with ThreadPoolExecutor(min(process_cpu_count(), _MOST_THREADS)) as pool:
        order = list(reversed(range(len(kernels))))
        waiting = pool.submit(LayerBlur, rgb, labels, order[0], reach)
        for layer, following in zip(order, [*order[1:], None], strict=True):
            blur = waiting.result()
            done = [
                pool.submit(blur.put_over, light, kernel, whole)
                for light, kernel in zip(total, kernels[layer], strict=True)
            ]
            if following is not None:
                waiting = pool.submit(LayerBlur, rgb, labels, following, reach)
            for plane in done:
                plane.result()
    return np.asarray(total[:, :-1] / np.maximum(total[:, -1:], np.float32(1e-6)))


# --- stacks rendered elsewhere: a folder, TIFF pages, OpenEXR parts or layers -----------------------------------------


_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".avif", ".heic", ".gif", ".tif", ".tiff", ".exr", ".hdr", ".npz")

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
    light. saturation: factor on chroma in CIE LCHuv. space: the colour space of float files, "srgb" or "xyz".

    Raises UserError when a picture can't be read, when their sizes differ, or when there isn't one for each plane.
    """
    check_brightness(brightness)
    check_saturation(saturation)
    planes_m = focused_planes(system)
    pictures = read_resized_pictures(path, make_plan(system).grid.shape, space, len(planes_m))
    stack = np.stack([scale_saturation(picture.rgb, saturation) for picture in pictures])
    target = Target.from_stack(stack, tuple(planes_m), str(path), brightness, merge_notes(pictures))
    return replace(target, are_planes_given=True)


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
        check_white(picture, first)
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


def check_white(picture: Picture, first: Picture) -> None:
    """Raises UserError for a picture whose white isn't that of the first one, beside which it would be too dark."""
    if picture.white != first.white:
        raise UserError(
            picture.source,
            f"has the white {picture.white or 'of 8 bits'}",
            expected=f"{first.white or 'that of 8 bits'} as {Path(first.source).name}",
            remedy="state the bits of all, e.g. --space srgb12 or srgb16",
        )


def merge_notes(pictures: Sequence[Picture]) -> tuple[str, ...]:
    """The notes of all pictures once, then those of some with the picture's name."""
    shared = [note for note in pictures[0].notes if all(note in picture.notes for picture in pictures)]
    single = [f"{Path(p.source).name}: {note}" for p in pictures for note in p.notes if note not in shared]
    return (*shared, *single)


# --- films ------------------------------------------------------------------------------------------------------------


SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi")
"""Of video files."""
_EXPECTED = f"a video file ({', '.join(SUFFIXES)}) or an animated picture"
_CONTAINERS = {"format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi", "protocol_whitelist": "file"}
"""What FFmpeg may take a file for: lists of other files, which it would open, are none of them."""


def is_video(path: Path) -> bool:
    """Whether the name is that of a video file."""
    return path.suffix.lower() in SUFFIXES


@dataclass(frozen=True)
class Film:
    """A film that can be read. count: of its pictures, 0 where a video file doesn't state it. space: of float pictures.

    Raises UserError for a missing or damaged file, a folder without pictures, and where PyAV isn't installed.
    """

    path: Path
    space: str = "srgb"

    def __post_init__(self) -> None:
        if self.path.is_dir():
            if not self._files:
                raise UserError(str(self.path), "has no pictures", expected="the pictures of a film, or " + _EXPECTED)
            return
        require_file(self.path, _EXPECTED)
        if self._is_animation:
            return
        if not is_video(self.path):
            raise UserError(str(self.path), "isn't a film", expected=f"{_EXPECTED}, or a folder of pictures")
        with self._stream():
            pass

    @property
    def count(self) -> int:
        """The number of pictures; 0 if it isn't known before they are read."""
        if self.path.is_dir():
            return len(self._files)
        if self._is_animation:
            return animation_count(self.path)
        with self._stream() as (_, stream):
            return int(stream.frames)

    def pictures(self) -> Iterator[Picture]:
        """One after the other, as linear light. Raises UserError for a picture that can't be read."""
        if self.path.is_dir():
            first: Picture | None = None
            for file in self._files:
                picture = read_picture(file, space=self.space)
                first = first or picture
                check_white(picture, first)
                yield picture
            return
        if self._is_animation:
            yield from read_animated(self.path)
            return
        with self._stream() as (container, stream):
            for number, frame in enumerate(container.decode(stream)):
                light = srgb_decode(frame.to_ndarray(format="rgb24") / 255.0)
                yield Picture(light.astype(np.float32), f"{self.path}, picture {number}")

    @property
    def _is_animation(self) -> bool:
        return not is_video(self.path) and file_format(self.path) in ANIMATED and animation_count(self.path) > 1

    @property
    def _files(self) -> list[Path]:
        files = [file for file in self.path.iterdir() if file.is_file() and not file.name.startswith(".")]
        return sorted(files, key=lambda file: natural_sort_key(file.name))

    @contextmanager
    def _stream(self) -> Iterator[tuple[Any, Any]]:
        """The opened video file and its first stream of pictures."""
        av = import_optional("av", "a film")
        try:
            with av.open(str(self.path), options=_CONTAINERS) as container:
                if not container.streams.video:
                    raise UserError(str(self.path), "has no pictures", expected=_EXPECTED)
                yield container, container.streams.video[0]
        except av.error.FFmpegError as error:
            raise UserError(str(self.path), f"can't be read: {error.strerror or error}", expected=_EXPECTED) from error
