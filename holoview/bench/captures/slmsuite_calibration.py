"""Calibrations of slmsuite (0.4 and 0.5) in HDF5, of real and of simulated hardware.

slmsuite's `FourierSLM.save_calibration` writes a calibration's dictionary with `save_h5` (slmsuite/holography/analysis/
files.py, github.com/holodyne/slmsuite): a dataset a key, a group a dictionary, None as a dataset with the attribute
`__none__`. Read from there:

    M (2, 2), b (2, 1), a (2, 1)   Fourier: camera pixel (x, y) = M (k − a) + b, k the direction sine (x, y)
    data (2, P, N, N, O)           pixel: power by direction (x, y), period, level of either bar, and order
    levels, periods, orders        of its axes; periods in pixels
    __meta__/slm, __meta__/cam     pitch_um (x, y), shape, bitdepth; wav_um of the modulator

In 0.4 `slm` and `cam` stand at the top. Wavefront and settling calibrations hold nothing that is read here.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.capture_file import open_plain_hdf5, plain_child
from holoview.util.errors import UserError

Floats = NDArray[np.float64]
_EXPECTED = "a Fourier or pixel calibration of slmsuite (HDF5)"
_MOST_NUMBERS = 1 << 27


@dataclass(frozen=True)
class FourierCalibration:
    """Where directions lie on the camera. focal_px: focal length over the camera's pitch. axis_px: (y, x).

    wavelength_m, pitch_m (of the modulator), camera_pitch_m: None where the file doesn't tell.
    """

    focal_px: float
    axis_px: tuple[float, float]
    wavelength_m: float | None
    pitch_m: float | None
    camera_pitch_m: float | None


@dataclass(frozen=True, eq=False)
class PixelSweep:
    """Power of the first orders against the level of one bar (level,), while the other stays at the first level."""

    levels: Floats
    power: Floats
    period_px: float
    direction: str


@dataclass(frozen=True, eq=False)
class PixelCalibration:
    """The sweeps of binary gratings that a pixel calibration holds. wavelength_m: None where the file doesn't tell."""

    sweeps: tuple[PixelSweep, ...]
    wavelength_m: float | None


def read_slmsuite(path: str | os.PathLike[str]) -> FourierCalibration | PixelCalibration:
    """Reads a calibration. Raises UserError, in words, for any other file and for numbers that can't be one."""
    with open_plain_hdf5(Path(path), _EXPECTED, "slmsuite's FourierSLM.save_calibration writes it") as h5:
        if "M" in h5 and "b" in h5:
            return _fourier(h5)
        if all(name in h5 for name in ("data", "levels", "periods", "orders")):
            return _pixel(h5)
        if h5.attrs.get("format") is not None:
            raise UserError("the file", "is of another kind", expected=_EXPECTED)
        names = ", ".join(sorted(str(name) for name in h5)[:6]) or "nothing"
        raise UserError(
            "the file", f"holds {names}", expected="M and b (Fourier), or data, levels, periods, orders (pixel)"
        )


def _fourier(h5: h5py.File) -> FourierCalibration:
    matrix, offset = _numbers(h5, "M", (2, 2)), _numbers(h5, "b", (2, 1)).ravel()
    origin = _numbers(h5, "a", (2, 1)).ravel() if "a" in h5 else np.zeros(2)
    scales = np.linalg.svd(matrix, compute_uv=False)
    if scales[-1] <= 0 or scales[0] / scales[-1] > 3:
        raise UserError("M", f"scales of {scales[0]:.3g} and {scales[-1]:.3g}", expected="camera pixels a unit of sine")
    x, y = offset - matrix @ origin
    camera = _micrometres(h5, "cam", "pitch_um")
    slm, wavelength = _micrometres(h5, "slm", "pitch_um"), _micrometres(h5, "slm", "wav_um")
    return FourierCalibration(math.sqrt(scales[0] * scales[1]), (float(y), float(x)), wavelength, slm, camera)


def _pixel(h5: h5py.File) -> PixelCalibration:
    levels, periods, orders = (_numbers(h5, name, None).ravel() for name in ("levels", "periods", "orders"))
    shape = (2, len(periods), len(levels), len(levels), len(orders))
    power = _numbers(h5, "data", shape)
    first = np.flatnonzero(np.abs(orders) == 1)
    if not len(first):
        raise UserError("orders", f"{orders.tolist()}", expected="the first order, 1 or -1, among them")
    if len(levels) < 12 or levels[0] != 0:
        found = f"{len(levels)} levels from {levels[0]:g}"
        raise UserError("levels", found, expected="at least 12 grey levels from 0, to tell a phase")
    sweeps = []
    for direction, name in enumerate("xy"):
        for number, period in enumerate(periods.tolist()):
            of_first = power[direction, number, 0][:, first].sum(axis=1)
            if of_first.any():  # a direction that wasn't measured is 0
                sweeps.append(PixelSweep(levels, of_first, period, name))
    if not sweeps:
        raise UserError("data", "no light in any first order", expected="a finished pixel calibration")
    return PixelCalibration(tuple(sweeps), _micrometres(h5, "slm", "wav_um"))


def _numbers(h5: h5py.File, name: str, shape: tuple[int, ...] | None) -> Floats:
    found = plain_child(h5, name)
    if not isinstance(found, h5py.Dataset) or found.dtype.kind not in "iuf" or found.is_virtual or found.external:
        raise UserError(name, "is no array of numbers", expected=_EXPECTED)
    if (shape is not None and found.shape != shape) or found.size > _MOST_NUMBERS or found.size == 0:
        raise UserError(name, f"an array of shape {found.shape}", expected=f"{shape or 'some numbers'}")
    values = np.asarray(found[()], dtype=np.float64)
    if not np.isfinite(values).all():
        raise UserError(name, "holds numbers that aren't finite", expected="finite numbers")
    return values


def _micrometres(h5: h5py.File, device: str, name: str) -> float | None:
    """A length of a device, m; None where it is missing or None. Raises UserError where x and y differ."""
    found: Any = plain_child(h5, f"__meta__/{device}/{name}") or plain_child(h5, f"{device}/{name}")
    if not isinstance(found, h5py.Dataset) or found.attrs.get("__none__", False) or found.dtype.kind not in "iuf":
        return None
    values = np.asarray(found[()], dtype=np.float64).ravel()
    if not len(values) or not (np.isfinite(values).all() and (values > 0).all()):
        raise UserError(f"{device}/{name}", f"{values.tolist()}", expected="a positive length in micrometres")
    if np.ptp(values) > 1e-6 * values[0]:
        raise UserError(f"{device}/{name}", f"{values.tolist()} µm", expected="square pixels")
    return float(values[0]) * 1e-6
