"""What a file is, told by its content, and what a session makes of it.

hologram file      its bench and patterns           TOML         a bench, with random patterns
pattern PNGs       patterns for the current bench   a name       the preset of that name
picture, stack     the target
"""

from __future__ import annotations

import io
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from holoview.colour import srgb_decode
from holoview.io.hologram import load_hologram
from holoview.io.png import read_pattern
from holoview.model import preset
from holoview.model.system import System
from holoview.optimise.checkpoint import load_checkpoint
from holoview.session.document import Drive
from holoview.session.target_spec import TargetSpec
from holoview.targets.image_reader import file_format
from holoview.targets.picture import Picture, read_picture
from holoview.targets.rendered_stacks import is_stack
from holoview.util.errors import UserError
from holoview.util.safetensors_file import format_of
from holoview.view import random_drive

CONTENT_KINDS = ("hologram", "preset", "patterns", "picture", "stack")
_EXPECTED = "a preset, a hologram file, pattern PNGs, or a picture (PNG, JPEG, TIFF, OpenEXR)"


@dataclass(frozen=True, eq=False)
class FileContent:
    """What was found: its kind (of KINDS), what of a document it brings, a title, and notes for the user."""

    kind: str
    title: str
    system: System | None = None
    drive: Drive | None = None
    target_spec: TargetSpec | None = None
    path: Path | None = None
    notes: tuple[str, ...] = field(default=())


def read_content(names: str | Path | Sequence[str | Path], system: System) -> FileContent:
    """What one or several files hold, or the preset of a name; `system` is the bench that patterns have to fit.

    Raises UserError when it is nothing that can be opened, damaged, or doesn't fit.
    """
    several = [names] if isinstance(names, str | Path) else list(names)
    if not several:
        raise UserError("open", "nothing", expected=_EXPECTED)
    paths = [Path(name).expanduser() for name in several]
    if len(paths) > 1:
        return _patterns(paths, system)
    path = paths[0]
    if str(several[0]) in preset.names() and not path.exists():
        return _bench(preset.load(path.name), path.name, None)
    if path.is_dir():
        return _folder(path, system)
    return _file(path, system)


def _file(path: Path, system: System) -> FileContent:
    kind = file_format(path)
    if kind == "PNG" and is_pattern_png(path, system):
        return _patterns([path], system)
    if kind in ("PNG", "JPEG", "TIFF", "OpenEXR"):
        return _stack(path) if is_stack(path) else _picture(path)
    written = format_of(path)
    if written == "holoview-hologram":
        hologram = load_hologram(path)
        return FileContent("hologram", path.name, hologram.system, hologram.drive, path=path)
    if written == "holoview-checkpoint":
        best = load_checkpoint(path)
        lasers = {"wavelengths": best.tensors["best_wavelengths"], "amplitudes": best.tensors["best_amplitudes"]}
        drive = best.tensors["best_drive"].astype(np.float32)
        return FileContent("hologram", path.name, best.system.edit(lasers), drive, path=path)
    if _is_toml(path):
        return _bench(preset.load(path if path.suffix == ".toml" else _refuse_toml_suffix(path)), path.stem, path)
    raise UserError(str(path), "isn't a file that can be opened", expected=_EXPECTED)


def _refuse_toml_suffix(path: Path) -> Path:
    raise UserError(str(path), f'a bench in a file with the suffix "{path.suffix}"', remedy="rename it to .toml")


def _is_toml(path: Path) -> bool:
    if path.suffix == ".toml":
        return True
    try:
        return bool(tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return False


def _bench(system: System, title: str, path: Path | None) -> FileContent:
    return FileContent("preset", title, system, random_drive(system), path=path)


def _picture(path: Path) -> FileContent:
    picture = read_picture(path)
    depth = path.with_name(f"{path.stem}-depth{path.suffix}")
    notes = picture.notes + ((f"{depth.name} beside it isn't used",) if depth.is_file() else ())
    return FileContent("picture", path.name, target_spec=TargetSpec(picture, path.name), path=path, notes=notes)


def _stack(path: Path) -> FileContent:
    return FileContent("stack", path.name, target_spec=TargetSpec(path, path.name), path=path)


def _folder(path: Path, system: System) -> FileContent:
    """A folder of patterns as `holoview export` writes them, else one of pictures, a picture a plane."""
    patterns = sorted(path.glob("slm[12]*.png"))
    return _patterns(patterns, system) if patterns else _stack(path)


# --- patterns -------------------------------------------------------------------------------------------------------


def is_pattern_png(path: Path, system: System) -> bool:
    """Whether a PNG says that it holds a modulator's pattern, or is grey and as large as the modulator."""
    try:
        with Image.open(path) as opened:
            if "holoview.pattern" in getattr(opened, "text", {}):
                return True
            rows, columns = system.modulators[0].shape
            return opened.size == (columns, rows) and opened.mode in ("L", "I;16", "I")
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError):
        return False


def _patterns(paths: list[Path], system: System) -> FileContent:
    """One PNG a frame and modulator, told apart by "slm1"/"slm2" in their names, else in the given order."""
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


# --- pixels that are no file ----------------------------------------------------------------------------------------


def target_from_pixels(pixels: NDArray[np.uint8], title: str = "pasted picture") -> TargetSpec:
    """A target of 8-bit sRGB pixels (y, x, 3 or 4); transparency is over black. Raises UserError for another shape."""
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or pixels.size == 0:
        raise UserError(title, f"pixels of shape {pixels.shape}", expected="(y, x, 3) or (y, x, 4)")
    light = srgb_decode(pixels[..., :3] / 255.0)
    if pixels.shape[2] == 4:
        light = light * (pixels[..., 3:] / 255.0)
    return TargetSpec(Picture(light.astype(np.float32), title), title)


def target_from_image_bytes(data: bytes, title: str = "pasted picture") -> TargetSpec:
    """A target of a picture file's bytes, as clipboards hold them. Raises UserError when it isn't a picture."""
    try:
        with Image.open(io.BytesIO(data)) as opened:
            return target_from_pixels(np.asarray(opened.convert("RGBA")), title)
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise UserError(title, "isn't a picture", expected="a picture, e.g. PNG") from error
