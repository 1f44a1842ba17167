"""Starting values where plane fringes lie over the picture: peaks of the spectrum of what multiplies the prediction.

Fringes are found by the length of path that grows over the picture, whose phase in wavelengths is the same for all
lasers, so that the spectra of all wavelengths add up at one peak. They are known by their parameters, not by their
name: an effect with a path (y, x) and with a cosine and a sine for each laser. Fringes on a modulator are seen in the
picture, blurred by what the light spreads on its way, with the same phase in the centre, or with the opposite one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison, GainFit
from holoview.diagnose.config import StartConfig
from holoview.diagnose.displacement_starts import StartingValues
from holoview.model.effects.effect import Effect

_PARAMETERS = {"path_y", "path_x", "cos1", "sin1"}
Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class _Modulation:
    """What multiplies the prediction at one wavelength, less 1, with weights: both (y, x).

    weighted: weight times modulation. weight: inverse variance of the modulation. laser: number of the wavelength.
    """

    weighted: Floats
    weight: Floats
    wavelength_m: float
    laser: int


class FringeStarts:
    """For an effect of plane fringes, the wedges and depths that the captures suggest; none for others."""

    def __init__(self, fitted: GainFit, comparison: Comparison, config: StartConfig) -> None:
        modulations = _modulations(fitted, comparison)
        self._starts = [_fringes(modulations, path) for path in _strongest_paths(modulations, config)]
        self._modulator_over_picture = _modulator_over_picture(comparison)
        captures = comparison.data.captures
        sizes = zip(captures.frame or captures.shape, captures.shape, strict=True)
        self._frame_over_picture = tuple(whole / seen for whole, seen in sizes)

    def __call__(self, effect: Effect) -> StartingValues:
        bounds = {p.name: (p.low, p.high) for p in effect.parameters}
        if not set(bounds) >= _PARAMETERS:
            return []
        starts = self._starts
        if "camera" in effect.acts_on:
            starts = [_over(start, self._frame_over_picture) for start in starts]
        else:  # there, opposite wedges have the same light and opposite wavefronts
            scaled = [_over(start, self._modulator_over_picture) for start in starts]
            both = [one for start in scaled for one in (start, _opposite(start))]
            starts = [*both, *map(_reversed, both)]
        return [
            {name: float(np.clip(value, *bounds[name])) for name, value in start.items() if name in bounds}
            for start in starts
        ]


def _modulator_over_picture(comparison: Comparison) -> tuple[float, float]:
    """The size of a modulator over that of the picture, (y, x)."""
    captures = comparison.data.captures
    panel, whole = captures.slms[0], captures.slm_frame or captures.levels.shape[2:]
    sizes = [n * panel.pitch_m / (m * captures.camera.pitch_m) for n, m in zip(whole, captures.shape, strict=True)]
    return sizes[0], sizes[1]


def _over(start: dict[str, float], scale: tuple[float, ...]) -> dict[str, float]:
    """The same wedge, with its paths over something so many times as large as the picture, (y, x)."""
    return {**start, "path_y": start["path_y"] * scale[0], "path_x": start["path_x"] * scale[1]}


def _opposite(start: dict[str, float]) -> dict[str, float]:
    """The other wedge with the same fringes."""
    turned = {name: -value for name, value in start.items() if name.startswith(("path", "sin"))}
    return {**start, **turned}


def _reversed(start: dict[str, float]) -> dict[str, float]:
    """Bright for dark: on its way, light turns the contrast of narrow fringes round (Talbot)."""
    turned = {name: -value for name, value in start.items() if name.startswith(("cos", "sin"))}
    return {**start, **turned}


def _fringes(modulations: list[_Modulation], path: tuple[float, float]) -> dict[str, float]:
    """The parameters of the fringes of a path."""
    values = dict(zip(("path_y", "path_x"), path, strict=True))
    for m in modulations:
        amplitude = _amplitude(m, path)
        values |= {f"cos{m.laser + 1}": amplitude.real, f"sin{m.laser + 1}": amplitude.imag}
    return values


def _modulations(fitted: GainFit, comparison: Comparison) -> list[_Modulation]:
    """For each wavelength the least-squares modulation m of residual = m·expected over its captures."""
    model = comparison.weight * fitted.expected
    captures, numbers = comparison.data.captures, comparison.data.captures.laser_number[comparison.indices]
    found = []
    for laser in np.unique(numbers):
        own = numbers == laser
        weighted = (fitted.residual[own] * model[own]).sum(axis=0, dtype=np.float64)
        weight = np.square(model[own]).sum(axis=0, dtype=np.float64)
        weighted -= weight * (weighted.sum() / max(weight.sum(), 1e-30))
        wavelength_m = float(captures.wavelength_m[comparison.indices[own]].mean())
        found.append(_Modulation(weighted, weight, wavelength_m, int(laser)))
    return found


def _strongest_paths(modulations: list[_Modulation], config: StartConfig) -> list[tuple[float, float]]:
    """(y, x) of the highest peaks over all paths that the camera's pixels resolve at every wavelength, m."""
    shape, shortest = modulations[0].weight.shape, min(m.wavelength_m for m in modulations)
    step = shortest / config.fringe_samples
    y = step * np.arange(config.fringe_samples * shape[0] // 2)
    x = step * np.arange(-config.fringe_samples * shape[1] // 2 + 1, config.fringe_samples * shape[1] // 2)
    power = sum(np.square(np.abs(_spectrum(m, y, x))) / max(float(m.weight.sum()), 1e-30) for m in modulations)
    count = np.hypot(y[:, None], x[None, :]) / shortest
    power = np.where(count < config.fringe_min_count, -np.inf, power)
    peaks = []
    for _ in range(config.fringe_peaks):
        row, column = np.unravel_index(int(np.argmax(power)), power.shape)
        peaks.append((float(y[row]), float(x[column])))
        away = np.hypot(y[:, None] - y[row], x[None, :] - x[column]) / shortest
        mirrored = np.hypot(y[:, None] + y[row], x[None, :] + x[column]) / shortest  # the same, where y is near 0
        power[np.minimum(away, mirrored) < config.fringe_min_count] = -np.inf
    return peaks


def _spectrum(m: _Modulation, path_y: Floats, path_x: Floats) -> Complex:
    """Σ weighted·exp(−iφ) at all paths (y, x)."""
    rows, columns = m.weighted.shape
    along_y, along_x = _phasors(rows, path_y, m.wavelength_m), _phasors(columns, path_x, m.wavelength_m)
    return np.asarray(along_y @ m.weighted @ along_x.T)


def _phasors(n: int, path: Floats, wavelength_m: float) -> Complex:
    """exp(−iπ·path·p/λ) for (path, pixel), p from −1 to 1 over the picture."""
    position = (np.arange(n) - (n - 1) / 2) / (n / 2)
    return np.asarray(np.exp((-1j * np.pi / wavelength_m) * path[:, None] * position[None, :]))


def _amplitude(m: _Modulation, path: tuple[float, float]) -> complex:
    """Cosine and sine, as real and imaginary part, of the fringes of this path.

    Re[amplitude·exp(iφ)] = cos·cos φ − sin·sin φ, of which Σ weighted·exp(−iφ) holds half.
    """
    y, x = (np.array([p]) for p in path)
    return complex(2 * _spectrum(m, y, x)[0, 0] / max(float(m.weight.sum()), 1e-30))
