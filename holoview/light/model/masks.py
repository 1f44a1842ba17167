"""The values of a static mask: its optical path and its amplitude, from a file or by name."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.elements import Mask
from holoview.light.numerics.sampling import positions
from holoview.util.errors import UserError
from holoview.util.files import opened_file, require_file
from holoview.util.memory_limit import require_memory
from holoview.util.plain_arrays import read_npy_header

Floats = NDArray[np.float64]

_PICTURES = "holoview.holograms.files.image_reader"  # decodes PNG and TIFF; light knows nothing of pictures' files
_EXPECTED = "a mask: .npy, PNG or TIFF"
_MOST_PATH_M = 20e-6
_BYTES_A_CELL = 40


@dataclass(frozen=True, eq=False)
class MaskValues:
    """path_m: (rows, columns) optical path, m. amplitude: (rows, columns), 0…1. None: of no effect."""

    path_m: Floats | None
    amplitude: Floats | None
    shape: tuple[int, int]


def mask_values(mask: Mask) -> MaskValues:
    """The values of a mask. Raises UserError, with the key, for a file that is no mask or doesn't fit."""
    if not mask.file:
        return _named(mask)
    file = require_file(mask.file, _EXPECTED)
    return _of_file(mask, str(file), file.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _of_file(mask: Mask, file: str, changed_ns: int) -> MaskValues:
    """The values in a file; its time of change is an argument so that a changed file is read again."""
    values = _read(Path(file))
    if not np.isfinite(values).all():
        raise UserError("file", f"{mask.file} holds values that aren't finite (NaN or infinite)", expected="numbers")
    shape = (int(values.shape[-2]), int(values.shape[-1]))
    if mask.shape is not None and shape != mask.shape:
        found = f"{mask.file} has {shape[0]} × {shape[1]} values"
        raise UserError("file", found, expected=f"the mask's shape, {mask.shape[0]} × {mask.shape[1]}")
    if values.ndim == 3:
        _check(values[1], "amplitudes", 0.0, 1.0, mask)
        _check(values[0], "optical paths", -_MOST_PATH_M, _MOST_PATH_M, mask)
        return MaskValues(values[0], values[1], shape)
    if mask.stroke_m is not None:
        _check(values, "fractions of the stroke", 0.0, 1.0, mask)
        return MaskValues(values * mask.stroke_m, None, shape)
    if file.lower().endswith(".npy") and np.abs(values).max() <= _MOST_PATH_M:
        return MaskValues(values, None, shape)
    _check(values, "amplitudes", 0.0, 1.0, mask)
    return MaskValues(None, values, shape)


def _check(values: Floats, what: str, low: float, high: float, mask: Mask) -> None:
    if values.min() < low or values.max() > high:
        found = f"{mask.file} holds {what} from {values.min():.3g} to {values.max():.3g}"
        raise UserError("file", found, expected=f"{low:g} to {high:g}")


def _read(path: Path) -> Floats:
    """The numbers (rows, columns) or (2, rows, columns) of a file in double precision."""
    if path.suffix.lower() != ".npy":
        raster = import_module(_PICTURES).read_raster(path)
        values: Floats = raster.values.astype(np.float64)
        if values.shape[2] > 1 and np.any(values != values[..., :1]):
            raise UserError("file", f"{path} is coloured", expected="a grey picture")
        return values[..., 0]
    with opened_file(path, _EXPECTED) as file:
        size = path.stat().st_size
        header = read_npy_header(file, size, f"file {path}")
        if header.dtype.kind == "c":
            raise UserError(
                "file", f"{path} holds complex numbers", expected="real ones; (2, y, x) for path and amplitude"
            )
        is_map = len(header.shape) == 2 or (len(header.shape) == 3 and header.shape[0] == 2)
        if not is_map or min(header.shape) < 2 or max(header.shape) > 16384:
            expected = "(rows, columns), or (2, rows, columns): path and amplitude; each from 2 to 16384"
            raise UserError("file", f"{path} has the shape {header.shape}", expected=expected)
        require_memory("mask", math.prod(header.shape) * _BYTES_A_CELL, remedy="use a smaller mask")
        return header.array(file.read(header.nbytes)).astype(np.float64)


def _named(mask: Mask) -> MaskValues:
    """The values of a named mask."""
    assert mask.shape is not None
    require_memory("mask", math.prod(mask.shape) * _BYTES_A_CELL, remedy="lower its shape")
    y, x = (positions(n, mask.pitch_m) for n in mask.shape)
    if mask.pattern == "random":
        assert mask.stroke_m is not None
        return MaskValues(np.random.default_rng(mask.seed).random(mask.shape) * mask.stroke_m, None, mask.shape)
    if mask.pattern == "half plane":
        return MaskValues(None, np.repeat((y < 0).astype(np.float64)[:, None], mask.shape[1], axis=1), mask.shape)
    assert mask.period_m is not None
    if mask.pattern == "grating":
        start = x - x[0]
        lines = np.floor(2 * start / mask.period_m + 1e-9).astype(int) % 2
        grid = np.repeat(lines[None].astype(np.float64), mask.shape[0], axis=0)
        is_phase = mask.stroke_m is not None
        return MaskValues(grid * mask.stroke_m if is_phase else None, None if is_phase else 1.0 - grid, mask.shape)
    assert mask.focal_length_m is not None
    from_y, from_x = (a - mask.period_m * np.floor(a / mask.period_m + 0.5) for a in (y, x))
    path_m = -(from_y[:, None] ** 2 + from_x[None, :] ** 2) / (2 * mask.focal_length_m)
    return MaskValues(path_m - path_m.min(), None, mask.shape)
