"""Starting values where plane fringes lie over a modulator, by an adjoint pass.

In the picture, fringes of a modulator are blurred by what light spreads on its way, and may be turned bright for dark.
The derivative of χ² by the transmission t of each pixel doesn't mind: with G = ∂χ²/∂Re t + i·∂χ²/∂Im t, fringes that
change t by the factor 1 + A·exp(iφ)/2 change χ² by Re[A·Σ G*·t·exp(iφ)]/2, summed over the pixels. Their wedge is where
these sums are largest, of all wavelengths together, relative to those of random phases.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.dead_places import modulator_of
from holoview.diagnose.displacement_starts import StartingValues
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.fringe_spectrum import (
    resolved_paths,
    spectrum,
    strongest_paths,
    within_bounds,
)
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.transmission_slopes import transmission_slopes
from holoview.model.effects.effect import Effect, StartKind
from holoview.model.effects.hook_contexts import ModulatorContext

Complex = NDArray[np.complex128]


class ModulatorFringeStarts:
    """For an effect of fringes on a modulator, those that the captures of a comparison suggest; none for others."""

    def __init__(self, context: SearchContext, base: FittedValues, comparison: Comparison) -> None:
        self._context, self._base, self._comparison = context, base, comparison
        captures = comparison.data.captures
        lasers, first = np.unique(captures.laser_number[comparison.indices], return_index=True)
        wavelengths = captures.wavelength_m[comparison.indices[first]]
        self._wavelengths_m = {int(n): float(w) for n, w in zip(lasers, wavelengths, strict=True)}

    def __call__(self, effect: Effect) -> StartingValues:
        if StartKind.MODULATOR_FRINGES not in effect.start_kinds or effect.id in self._base:
            return []
        of, slopes = self._slopes[modulator_of(effect)]
        shortest = min(self._wavelengths_m.values())
        y, x = (resolved_paths(n, shortest, self._context.config.starts) for n in of.shape)
        power = np.zeros((len(y), len(x)))
        for laser, slope in slopes.items():
            sums = spectrum(slope.conj(), y, x, self._wavelengths_m[laser])
            power += np.square(np.abs(sums)) / max(float(np.square(np.abs(slope)).sum()), 1e-30)
        paths = strongest_paths(power, y, x, shortest, self._context.config.starts)
        starts = [self._with_depths(effect, of, path, slopes) for path in paths]
        return [within_bounds(effect, start) for start in starts]

    @cached_property
    def _slopes(self) -> dict[int, tuple[ModulatorContext, dict[int, Complex]]]:
        """For each modulator Σ G*·t (y, x) over the captures of each laser."""
        found: dict[int, tuple[ModulatorContext, dict[int, Complex]]] = {}
        for one in transmission_slopes(self._context, self._base, self._comparison):
            of, slope = one.modulator, one.of_pixels(one.slope.conj() * one.transmission)
            _, sums = found.setdefault(of.number, (of, {}))
            sums[of.laser] = np.asarray(sums.get(of.laser, 0.0) + slope, dtype=np.complex128)
        return found

    def _with_depths(
        self, effect: Effect, of: ModulatorContext, path: tuple[float, float], slopes: dict[int, Complex]
    ) -> dict[str, float]:
        """The parameters of the fringes of a path: down the slope of χ² at each laser, by the step of least squares."""
        y, x = (np.array([p]) for p in path)
        wide_y, wide_x = (p * whole / n for p, whole, n in zip(path, of.whole_shape, of.shape, strict=True))
        wedge, tried = {"path_y": wide_y, "path_x": wide_x}, dict[int, complex]()
        depth = self._context.config.starts.fringe_trial_depth
        for laser, slope in slopes.items():
            towards = -complex(spectrum(slope.conj(), y, x, self._wavelengths_m[laser])[0, 0])
            tried[laser] = depth * towards / max(abs(towards), 1e-30)
        values = within_bounds(effect, wedge | _depths(tried))
        steps = self._best_steps({**self._base, effect.id: values})
        return wedge | _depths({laser: steps[laser] * amplitude for laser, amplitude in tried.items()})

    def _best_steps(self, values: FittedValues) -> dict[int, float]:
        """For each laser by how much the way from the base to these values is to be longer, by linear least squares."""
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
