"""Starting values where plane fringes lie over the picture: peaks of the spectrum of what multiplies the prediction.

Those of a modulator are found otherwise (`modulator_fringe_starts`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison, GainFit
from holoview.diagnose.config import StartConfig
from holoview.diagnose.displacement_starts import StartingValues
from holoview.diagnose.fringe_spectrum import (
    resolved_paths,
    spectrum,
    strongest_paths,
    within_bounds,
)
from holoview.model.effects.effect import Effect, StartKind

Floats = NDArray[np.float64]


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
    """For an effect of plane fringes over the picture, the wedges and depths that captures suggest; none for others."""

    def __init__(self, fitted: GainFit, comparison: Comparison, config: StartConfig) -> None:
        modulations = _modulations(fitted, comparison)
        captures = comparison.data.captures
        sizes = zip(captures.frame or captures.shape, captures.shape, strict=True)
        wider = tuple(whole / seen for whole, seen in sizes)
        self._starts = [_fringes(modulations, path, wider) for path in _strongest_paths(modulations, config)]

    def __call__(self, effect: Effect) -> StartingValues:
        if StartKind.CAMERA_FRINGES not in effect.start_kinds:
            return []
        return [within_bounds(effect, start) for start in self._starts]


def _fringes(modulations: list[_Modulation], path: tuple[float, float], wider: tuple[float, ...]) -> dict[str, float]:
    """The parameters of the fringes of a path over the pictures, of which the camera's are so many times as wide."""
    values = {"path_y": path[0] * wider[0], "path_x": path[1] * wider[1]}
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
    """(y, x) of the highest peaks over all paths that the camera's pixels resolve at every wavelength, y ≥ 0, m."""
    shape, shortest = modulations[0].weight.shape, min(m.wavelength_m for m in modulations)
    y, x = (resolved_paths(n, shortest, config) for n in shape)
    y = y[y >= 0]
    spectra = [spectrum(m.weighted, y, x, m.wavelength_m) for m in modulations]
    weights = [max(float(m.weight.sum()), 1e-30) for m in modulations]
    power = sum(np.square(np.abs(s)) / weight for s, weight in zip(spectra, weights, strict=True))
    return strongest_paths(np.asarray(power), y, x, shortest, config, is_mirrored=True)


def _amplitude(m: _Modulation, path: tuple[float, float]) -> complex:
    """Cosine and sine, as real and imaginary part, of the fringes of this path.

    Re[amplitude·exp(iφ)] = cos·cos φ − sin·sin φ, of which Σ weighted·exp(−iφ) holds half.
    """
    y, x = (np.array([p]) for p in path)
    return complex(2 * spectrum(m.weighted, y, x, m.wavelength_m)[0, 0] / max(float(m.weight.sum()), 1e-30))
