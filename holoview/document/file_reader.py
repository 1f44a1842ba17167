"""Recognises a file by its content and reads what it contributes to a document.

hologram, page     system and patterns                TOML         a system, with random patterns
pattern PNGs       patterns for the present system    a name       the preset of that name
picture, stack     the target                         CSV          the path of the pupil
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from holoview.colour import srgb_decode
from holoview.document.target_spec import TargetSpec
from holoview.io.hologram import load_hologram
from holoview.io.pictures import read_pattern
from holoview.io.pupil_path_file import is_pupil_path, load_pupil_path
from holoview.model import preset
from holoview.model.pupil_path import PupilPath
from holoview.model.system import System
from holoview.optimise.checkpoint import load_checkpoint
from holoview.page.link import shown_by_link, split_link
from holoview.page.page import is_page, read_page
from holoview.render.scene import Drive
from holoview.targets.focal_stack import is_stack
from holoview.targets.image_reader import file_format
from holoview.targets.picture import Picture, read_picture
from holoview.util.errors import UserError
from holoview.util.files import expand_home, read_text
from holoview.util.safetensors_file import format_of
from holoview.util.tables import parse_toml
from holoview.view import random_drive

CONTENT_KINDS = ("hologram", "page", "preset", "patterns", "picture", "stack", "pupil path")
_EXPECTED = (
    "a preset, a hologram file or page, pattern PNGs, a picture (PNG, JPEG, TIFF, OpenEXR), or a pupil path (CSV)"
)


@dataclass(frozen=True, eq=False)
class FileContent:
    """The content of a file: its kind (one of CONTENT_KINDS), a title, the parts of a document, notes for the user.

    plane_m: the focal plane that it is to be shown at; None for that of the viewer.
    """

    kind: str
    title: str
    system: System | None = None
    drive: Drive | None = None
    target_spec: TargetSpec | None = None
    pupil_path: PupilPath | None = None
    path: Path | None = None
    plane_m: float | None = None
    notes: tuple[str, ...] = field(default=())


def read_content(names: str | Path | Sequence[str | Path], system: System) -> FileContent:
    """Reads one or several files, a folder, or the preset of a name; patterns must fit `system`.

    Raises UserError for an unknown format, a damaged file, and patterns that don't fit.
    """
    names_list = [names] if isinstance(names, str | Path) else list(names)
    if not names_list:
        raise UserError("open", "nothing", expected=_EXPECTED)
    paths = [expand_home(name) for name in names_list]
    if len(paths) > 1:
        return _patterns(paths, system)
    path = paths[0]
    if str(names_list[0]) in preset.names() and not path.exists():
        return _preset(preset.load(path.name), path.name, None)
    if path.is_dir():
        return _folder(path, system)
    return _file(path, system)


def _file(path: Path, system: System) -> FileContent:
    page, state = split_link(path)
    if is_page(page):
        return _page(page, state)
    if is_pupil_path(path):
        return FileContent("pupil path", path.name, pupil_path=load_pupil_path(path), path=path)
    kind = file_format(path)
    if kind == "PNG" and is_pattern_png(path, system):
        return _patterns([path], system)
    if kind in ("PNG", "JPEG", "TIFF", "OpenEXR"):
        return _stack(path) if is_stack(path) else _picture(path)
    file_type = format_of(path)
    if file_type == "holoview-hologram":
        hologram = load_hologram(path)
        return FileContent("hologram", path.name, hologram.system, hologram.drive, path=path)
    if file_type == "holoview-checkpoint":
        checkpoint = load_checkpoint(path)
        lasers = {
            "wavelengths": checkpoint.tensors["best_wavelengths"],
            "amplitudes": checkpoint.tensors["best_amplitudes"],
        }
        drive = checkpoint.tensors["best_drive"].astype(np.float32)
        return FileContent("hologram", path.name, checkpoint.system.edit(lasers), drive, path=path)
    if _is_toml(path):
        return _preset(preset.load(path if path.suffix == ".toml" else _refuse_toml_suffix(path)), path.stem, path)
    raise UserError(str(path), "isn't a file that can be opened", expected=_EXPECTED)


def _page(path: Path, state: str) -> FileContent:
    """The first hologram of a page, with the state of a link to it."""
    (name, hologram), *others = read_page(path).items()
    shown = shown_by_link(hologram, state)
    notes = (f"{name}, the first of {1 + len(others)} holograms",) if others else ()
    bench, drive = shown.hologram.system, shown.hologram.drive
    return FileContent("page", path.name, bench, drive, path=path, plane_m=shown.plane_m, notes=notes)


def _refuse_toml_suffix(path: Path) -> Path:
    raise UserError(str(path), f'a bench in a file with the suffix "{path.suffix}"', remedy="rename it to .toml")


def _is_toml(path: Path) -> bool:
    if path.suffix == ".toml":
        return True
    try:
        return bool(parse_toml(read_text(path, "TOML"), str(path), "TOML"))
    except UserError:
        return False


def _preset(system: System, title: str, path: Path | None) -> FileContent:
    return FileContent("preset", title, system, random_drive(system), path=path)


def _picture(path: Path) -> FileContent:
    picture = read_picture(path)
    depth = path.with_name(f"{path.stem}-depth{path.suffix}")
    notes = picture.notes + ((f"{depth.name} beside it isn't used",) if depth.is_file() else ())
    return FileContent("picture", path.name, target_spec=TargetSpec(picture, path.name), path=path, notes=notes)


def _stack(path: Path) -> FileContent:
    return FileContent("stack", path.name, target_spec=TargetSpec(path, path.name), path=path)


def _folder(path: Path, system: System) -> FileContent:
    """A folder of patterns as `holoview export` writes them, else a focal stack, or a folder of views."""
    patterns = sorted(path.glob("slm[12]*.png"))
    return _patterns(patterns, system) if patterns else _stack(path)


# --- patterns -------------------------------------------------------------------------------------------------------


def is_pattern_png(path: Path, system: System) -> bool:
    """Whether a PNG is marked as a modulator's pattern by its metadata, or is grey with the modulator's pixel count."""
    try:
        with Image.open(path) as image:
            if "holoview.pattern" in getattr(image, "text", {}):
                return True
            rows, columns = system.modulators[0].shape
            return image.size == (columns, rows) and image.mode in ("L", "I;16", "I")
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError):
        return False


def _patterns(paths: list[Path], system: System) -> FileContent:
    """One PNG for each frame and modulator, assigned by "slm1" and "slm2" in the names, else in the given order."""
    frames, modulators, *shape = system.drive_shape
    if len(paths) != frames * modulators:
        raise UserError(
            "patterns",
            f"{len(paths)} files",
            expected=f"{frames * modulators} for {system.name or 'this bench'}: one a frame and modulator",
            remedy="choose all of them at once, or another bench first",
        )
    groups = [[path for path in paths if f"slm{number}" in path.stem] for number in range(1, modulators + 1)]
    if any(len(group) != frames for group in groups):
        groups = [paths[number * frames : (number + 1) * frames] for number in range(modulators)]
    drive = np.stack([np.stack([read_pattern(path, (shape[0], shape[1])) for path in group]) for group in groups], 1)
    return FileContent("patterns", paths[0].parent.name or paths[0].name, drive=drive)


# --- pixels from the clipboard --------------------------------------------------------------------------------------


def target_from_pixels(pixels: NDArray[np.uint8], title: str = "pasted picture") -> TargetSpec:
    """A target from 8-bit sRGB pixels (y, x, 3 or 4), composited over black. Raises UserError for another shape."""
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or pixels.size == 0:
        raise UserError(title, f"pixels of shape {pixels.shape}", expected="(y, x, 3) or (y, x, 4)")
    light = srgb_decode(pixels[..., :3] / 255.0)
    if pixels.shape[2] == 4:
        light = light * (pixels[..., 3:] / 255.0)
    return TargetSpec(Picture(light.astype(np.float32), title), title)


def target_from_image_bytes(data: bytes, title: str = "pasted picture") -> TargetSpec:
    """A target from the bytes of a picture file, e.g. of the clipboard. Raises UserError when they aren't a picture."""
    try:
        with Image.open(io.BytesIO(data)) as image:
            return target_from_pixels(np.asarray(image.convert("RGBA")), title)
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise UserError(title, "isn't a picture", expected="a picture, e.g. PNG") from error
