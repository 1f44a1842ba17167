"""Writes calibrations of slmsuite in the layout of its `save_h5` (slmsuite/holography/analysis/files.py, version 0.5,
github.com/holodyne/slmsuite): a dataset a key, a group a dictionary, None as False with the attribute `__none__`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray


def save(path: Path, data: dict[str, Any]) -> Path:
    with h5py.File(path, "w") as file:
        _fill(file, data)
    return path


def _fill(group: h5py.Group, data: dict[str, Any]) -> None:
    for key, value in data.items():
        if isinstance(value, dict):
            _fill(group.create_group(key), value)
        elif value is None:
            group[key] = False
            group[key].attrs["__none__"] = True
        else:
            group[key] = value.encode() if isinstance(value, str) else np.array(value)


def meta(wav_um: float = 0.532, slm_pitch_um: float = 36.0, cam_pitch_um: float | None = 12.0) -> dict[str, Any]:
    camera = None if cam_pitch_um is None else (cam_pitch_um, cam_pitch_um)
    slm = {"wav_um": wav_um, "pitch_um": (slm_pitch_um, slm_pitch_um), "shape": (96, 128), "bitdepth": 8}
    return {"slm": slm, "cam": {"pitch_um": camera, "shape": (240, 320), "exposure_bounds_s": None}}


def fourier(focal_px: float, axis_xy: tuple[float, float], **of_meta: Any) -> dict[str, Any]:
    matrix, offset = focal_px * np.eye(2), np.array(axis_xy)[:, None]
    return {"M": matrix, "b": offset, "a": np.zeros((2, 1)), "__version__": "0.5.0", "__meta__": meta(**of_meta)}


def pixel(phase: NDArray[np.float64], periods: tuple[int, ...] = (8, 16), **of_meta: Any) -> dict[str, Any]:
    """A pixel calibration of gratings along x alone: order ±1 of bars of phases a, b is (4/π²)·sin²((a − b)/2)."""
    count = len(phase)
    difference = phase[:, None] - phase[None]
    orders = np.array([-1, 0, 1])
    data = np.zeros((2, len(periods), count, count, 3))
    for k in range(len(periods)):
        data[0, k, :, :, 1] = 1e4 * np.cos(difference / 2) ** 2
        data[0, k, :, :, [0, 2]] = 4e3 * np.sin(difference / 2) ** 2 + 5
    levels = np.arange(count) * (256 // count)
    axes = {"levels": levels, "periods": np.array(periods), "orders": orders, "directions": np.array([0])}
    return {**axes, "data": data, "__meta__": meta(**of_meta)}
