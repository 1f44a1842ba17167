"""Starting values where plane fringes lie over the picture or over a modulator: peaks of a spectrum over the path.

The path is the difference of the round trip in the glass between one edge of a map and the opposite edge, so that its
fringes have the phase φ = π·(path_y·y + path_x·x)/λ, with y and x from −1 to 1 over the map. The path is the same for
all lasers, so that fringes are a peak which the spectra of all wavelengths share.

Over the picture, the spectrum is that of the factor which multiplies the prediction; with the reference wavelength in
place of each laser's, it shows fringes that have the same period at all wavelengths. Fringes of a modulator are blurred
in the picture, as light spreads on its way, and may be turned bright for dark. The derivative of χ² by the transmission
t of each pixel of the modulator doesn't suffer from this: with G = ∂χ²/∂Re t + i·∂χ²/∂Im t, fringes that change t by
the factor 1 + A·exp(iφ)/2 change χ² by Re[A·Σ G*·t·exp(iφ)]/2, summed over the pixels. Their wedge is where these sums,
of all wavelengths together, are largest relative to those of random phases.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.likelihood import Comparison, GainFit
from holoview.bench.diagnose.search_context import SearchContext
from holoview.bench.diagnose.starts.picture import StartingValues
from holoview.bench.diagnose.starts.transmission_slopes import modulator_of, transmission_slopes
from holoview.light.effects.fringes import REFERENCE_M
from holoview.light.model.effects.effect import Effect, StartKind
from holoview.light.model.effects.hook_contexts import ModulatorContext

_FRINGE_PEAKS = 3  # [1] Peaks of the spectrum tried as fringes.
_FRINGE_MIN_COUNT = 1.5
"""[fringes] Fewer fringes over the picture can't be told from shading, and peaks nearer to a higher peak are part of
it. Evidence: the main lobe of a full picture's spectrum ends at 1."""
_FRINGE_SAMPLES = 2
"""[1] Samples of the spectrum for each further fringe over the picture. Evidence: derivation: the largest error, a
quarter of a fringe, is an eighth at the picture's edges, where a fit converges."""
_FRINGE_TRIAL_DEPTH = 0.02
"""[1] Depth of trial fringes of a modulator, from which the depth that lowers χ² most is extrapolated. Evidence: χ² is
linear to a tenth; the fit does the rest."""

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]


def within_bounds(effect: Effect, start: Mapping[str, float]) -> dict[str, float]:
    """The values that are parameters of the effect, within their bounds."""
    bounds = {p.name: (p.low, p.high) for p in effect.parameters}
    return {name: float(np.clip(value, *bounds[name])) for name, value in start.items() if name in bounds}


def spectrum(values: NDArray[np.inexact], path_y: Floats, path_x: Floats, wavelength_m: float) -> Complex:
    """Σ values (y, x)·exp(−iφ) at all paths, (path_y, path_x)."""
    along_y, along_x = (_phasors(n, path, wavelength_m) for n, path in zip(values.shape, (path_y, path_x), strict=True))
    return np.asarray(along_y @ values @ along_x.T)


def strongest_paths(
    power: Floats, path_y: Floats, path_x: Floats, shortest_m: float, *, is_mirrored: bool = False
) -> list[tuple[float, float]]:
    """(y, x) of the highest peaks of a power (path_y, path_x), m.

    shortest_m: the shortest wavelength. is_mirrored: opposite paths have the same power; each peak is taken once.
    """
    power = np.where(np.hypot(path_y[:, None], path_x) / shortest_m < _FRINGE_MIN_COUNT, -np.inf, power)
    peaks = []
    for _ in range(_FRINGE_PEAKS):
        row, column = np.unravel_index(int(np.argmax(power)), power.shape)
        y, x = float(path_y[row]), float(path_x[column])
        for sign in (1, -1) if is_mirrored else (1,):
            away = np.hypot(path_y[:, None] - sign * y, path_x - sign * x) / shortest_m
            power[away < _FRINGE_MIN_COUNT] = -np.inf
        peaks.append((y, x))
    return peaks


def resolved_paths(n: int, shortest_m: float) -> Floats:
    """All paths along an axis of n entries that the entries resolve at every wavelength, m; ascending, 0 among them."""
    most = _FRINGE_SAMPLES * n // 2
    return np.asarray(shortest_m / _FRINGE_SAMPLES * np.arange(-most + 1, most), dtype=np.float64)


def _phasors(n: int, path: Floats, wavelength_m: float) -> Complex:
    """exp(−iπ·path·p/λ) for (path, entry), p from −1 to 1 over the map."""
    position = (np.arange(n) - (n - 1) / 2) / (n / 2)
    return np.asarray(np.exp((-1j * np.pi / wavelength_m) * path[:, None] * position[None, :]))


@dataclass(frozen=True)
class _Modulation:
    """The factor that multiplies the prediction at one wavelength, less 1, with weights: both (y, x).

    weighted: weight times modulation. weight: inverse variance of the modulation. laser: number of the wavelength.
    wavelength_m: by which paths are divided.
    """

    weighted: Floats
    weight: Floats
    wavelength_m: float
    laser: int


class FringeStarts:
    """For an effect of plane fringes over the picture, the wedges and depths that captures suggest; none for others."""

    def __init__(self, fitted: GainFit, comparison: Comparison) -> None:
        modulations = _modulations(fitted, comparison)
        captures = comparison.data.captures
        sizes = zip(captures.frame or captures.shape, captures.shape, strict=True)
        wider = tuple(whole / seen for whole, seen in sizes)
        achromatic = [replace(m, wavelength_m=REFERENCE_M) for m in modulations]
        self._starts = [
            {**_fringes(some, path, wider), "achromatic": share}
            for share, some in ((0.0, modulations), (1.0, achromatic))
            for path in _strongest_paths(some)
        ]

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


def _strongest_paths(modulations: list[_Modulation]) -> list[tuple[float, float]]:
    """(y, x) of the highest peaks over all paths that the camera's pixels resolve at every wavelength, y ≥ 0, m."""
    shape, shortest = modulations[0].weight.shape, min(m.wavelength_m for m in modulations)
    y, x = (resolved_paths(n, shortest) for n in shape)
    y = y[y >= 0]
    spectra = [spectrum(m.weighted, y, x, m.wavelength_m) for m in modulations]
    weights = [max(float(m.weight.sum()), 1e-30) for m in modulations]
    power = sum(np.square(np.abs(s)) / weight for s, weight in zip(spectra, weights, strict=True))
    return strongest_paths(np.asarray(power), y, x, shortest, is_mirrored=True)


def _amplitude(m: _Modulation, path: tuple[float, float]) -> complex:
    """Cosine and sine, as real and imaginary part, of the fringes of this path.

    Re[amplitude·exp(iφ)] = cos·cos φ − sin·sin φ, of which Σ weighted·exp(−iφ) holds half.
    """
    y, x = (np.array([p]) for p in path)
    return complex(2 * spectrum(m.weighted, y, x, m.wavelength_m)[0, 0] / max(float(m.weight.sum()), 1e-30))


class ModulatorFringeStarts:
    """For an effect of fringes on a modulator, the fringes that captures of a comparison suggest; none for others."""

    def __init__(self, context: SearchContext, base: FittedValues, comparison: Comparison) -> None:
        self._context, self._base, self._comparison = context, base, comparison
        captures = comparison.data.captures
        lasers, first = np.unique(captures.laser_number[comparison.indices], return_index=True)
        wavelengths = captures.wavelength_m[comparison.indices[first]]
        self._wavelengths_m = {int(n): float(w) for n, w in zip(lasers, wavelengths, strict=True)}

    def __call__(self, effect: Effect) -> StartingValues:
        if StartKind.MODULATOR_FRINGES not in effect.start_kinds or effect.id in self._base:
            return []
        number = modulator_of(effect, self._comparison.data.captures)
        if number is None:
            return []
        of, slopes = self._slopes[number]
        shortest = min(self._wavelengths_m.values())
        y, x = (resolved_paths(n, shortest) for n in of.shape)
        power = np.zeros((len(y), len(x)))
        for laser, slope in slopes.items():
            sums = spectrum(slope.conj(), y, x, self._wavelengths_m[laser])
            power += np.square(np.abs(sums)) / max(float(np.square(np.abs(slope)).sum()), 1e-30)
        paths = strongest_paths(power, y, x, shortest)
        starts = [self._with_depths(effect, of, path, slopes) for path in paths]
        return [within_bounds(effect, start) for start in starts]

    @cached_property
    def _slopes(self) -> dict[int, tuple[ModulatorContext, dict[int, Complex]]]:
        """For each modulator Σ G*·t (y, x) over the captures of each laser."""
        found: dict[int, tuple[ModulatorContext, dict[int, Complex]]] = {}
        for one in transmission_slopes(self._context, self._base, self._comparison):
            of, slope = one.modulator, one.of_pixels(one.slope.conj() * one.transmission)
            _, sums = found.setdefault(one.number, (of, {}))
            sums[of.laser] = np.asarray(sums.get(of.laser, 0.0) + slope, dtype=np.complex128)
        return found

    def _with_depths(
        self, effect: Effect, of: ModulatorContext, path: tuple[float, float], slopes: dict[int, Complex]
    ) -> dict[str, float]:
        """The parameters of the fringes of a path, with depths from one least-squares step down the slope of χ² at each
        laser."""
        y, x = (np.array([p]) for p in path)
        wide_y, wide_x = (p * whole / n for p, whole, n in zip(path, of.whole_shape, of.shape, strict=True))
        wedge, tried = {"path_y": wide_y, "path_x": wide_x}, dict[int, complex]()
        depth = _FRINGE_TRIAL_DEPTH
        for laser, slope in slopes.items():
            towards = -complex(spectrum(slope.conj(), y, x, self._wavelengths_m[laser])[0, 0])
            tried[laser] = depth * towards / max(abs(towards), 1e-30)
        values = within_bounds(effect, wedge | _depths(tried))
        steps = self._best_steps({**self._base, effect.id: values})
        return wedge | _depths({laser: steps[laser] * amplitude for laser, amplitude in tried.items()})

    def _best_steps(self, values: FittedValues) -> dict[int, float]:
        """For each laser the factor by which the step from the base to these values should be longer, by linear least
        squares."""
        before, after = (self._comparison.residual(v).astype(np.float64) for v in (self._base, values))
        numbers = self._comparison.data.captures.laser_number[self._comparison.indices]
        before, change = (a.reshape(len(numbers), -1) for a in (before, after - before))
        found = {}
        for laser in self._wavelengths_m:
            own = numbers == laser
            power = float(np.square(change[own]).sum())
            found[laser] = -float((before[own] * change[own]).sum()) / max(power, 1e-30)
        return found


def _depths(amplitudes: dict[int, complex]) -> dict[str, float]:
    """The parameters of depths {laser: cosine + i·sine}."""
    parts = {f"cos{laser + 1}": amplitude.real for laser, amplitude in amplitudes.items()}
    return parts | {f"sin{laser + 1}": amplitude.imag for laser, amplitude in amplitudes.items()}
