"""Spectra over the path of a wedge, whose phase in wavelengths is the same for all lasers: fringes are a common peak.

The path is by how much the round trip in the glass is longer at one edge of a map than at the opposite one, so that its
fringes have the phase φ = π·(path_y·y + path_x·x)/λ, with y and x from −1 to 1 over the map.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.config import StartConfig
from holoview.model.effects.effect import Effect

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]


def within_bounds(effect: Effect, start: Mapping[str, float]) -> dict[str, float]:
    """Those values that are parameters of the effect, within their bounds."""
    bounds = {p.name: (p.low, p.high) for p in effect.parameters}
    return {name: float(np.clip(value, *bounds[name])) for name, value in start.items() if name in bounds}


def spectrum(values: NDArray[np.inexact], path_y: Floats, path_x: Floats, wavelength_m: float) -> Complex:
    """Σ values (y, x)·exp(−iφ) at all paths, (path_y, path_x)."""
    along_y, along_x = (_phasors(n, path, wavelength_m) for n, path in zip(values.shape, (path_y, path_x), strict=True))
    return np.asarray(along_y @ values @ along_x.T)


def strongest_paths(
    power: Floats, path_y: Floats, path_x: Floats, shortest_m: float, config: StartConfig, *, is_mirrored: bool = False
) -> list[tuple[float, float]]:
    """(y, x) of the highest peaks of a power (path_y, path_x), m.

    shortest_m: the shortest wavelength. is_mirrored: opposite paths have the same power; each peak is taken once.
    """
    power = np.where(np.hypot(path_y[:, None], path_x) / shortest_m < config.fringe_min_count, -np.inf, power)
    peaks = []
    for _ in range(config.fringe_peaks):
        row, column = np.unravel_index(int(np.argmax(power)), power.shape)
        y, x = float(path_y[row]), float(path_x[column])
        for sign in (1, -1) if is_mirrored else (1,):
            away = np.hypot(path_y[:, None] - sign * y, path_x - sign * x) / shortest_m
            power[away < config.fringe_min_count] = -np.inf
        peaks.append((y, x))
    return peaks


def resolved_paths(n: int, shortest_m: float, config: StartConfig) -> Floats:
    """All paths along an axis of n entries that these resolve at every wavelength, m; ascending, 0 among them."""
    most = config.fringe_samples * n // 2
    return np.asarray(shortest_m / config.fringe_samples * np.arange(-most + 1, most), dtype=np.float64)


def _phasors(n: int, path: Floats, wavelength_m: float) -> Complex:
    """exp(−iπ·path·p/λ) for (path, entry), p from −1 to 1 over the map."""
    position = (np.arange(n) - (n - 1) / 2) / (n / 2)
    return np.asarray(np.exp((-1j * np.pi / wavelength_m) * path[:, None] * position[None, :]))
