"""Starting values where planes of the captures are off, each by an error of its own.

The smoothest captures of each plane are predicted at distances around the one that was set, for all planes at once:
each has its own minimum of χ². Only where these differ by more than noise from one error that all planes share, and
from one that grows with the distance, which other effects state by one number, is there a start.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.patterns import pattern_roughness
from holoview.diagnose.displacement_starts import StartingValues
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.search_context import SearchContext
from holoview.model.effects.effect import Effect, StartKind

Floats = NDArray[np.float64]


class PlaneStarts:
    """For an effect of errors of planes, those that the captures suggest on top of a base; none for others."""

    def __init__(self, context: SearchContext, base: FittedValues) -> None:
        self._context, self._base = context, base
        self._found: dict[str, StartingValues] = {}

    def __call__(self, effect: Effect) -> StartingValues:
        if StartKind.PLANES not in effect.start_kinds or self._is_known(effect):
            return []
        if effect.id not in self._found:
            search = _Search(self._context, self._base, effect)
            start = search.run() if len(search.planes_m) > 1 else None
            self._found[effect.id] = [] if start is None else [start]
        return self._found[effect.id]

    def _is_known(self, effect: Effect) -> bool:
        """Whether the base has the effect, or one error for all planes."""
        return bool({effect.id, *self._context.equivalents.get(effect.id, ())} & self._base.keys())


class _Search:
    """The search for the errors of all planes. planes_m: the distances that were set."""

    def __init__(self, context: SearchContext, base: FittedValues, effect: Effect) -> None:
        self._base, self._effect, self._config = base, effect, context.config.planes
        captures = context.data.captures
        self.planes_m = np.unique(captures.distance_m[context.kept])
        indices = np.array([k for z in self.planes_m for k in self._smoothest(context, float(z))])
        self._of_plane = captures.distance_m[indices][None, :] == self.planes_m[:, None]
        sine = captures.relay2.first_order_sine(float(captures.wavelengths_m.mean()), captures.slms[0].pitch_m)
        self._depth_m = float(captures.wavelengths_m.mean()) / sine**2
        self._lowest_m = -np.inf if captures.is_fourier else 0.0
        self._comparison = context.tolerant_comparison(indices, context.relative_model_error(base, indices))

    def _smoothest(self, context: SearchContext, plane_m: float) -> list[int]:
        """The smoothest captures of a plane, of different wavelengths if there are several."""
        captures, roughness = context.data.captures, pattern_roughness(context.data.captures)
        own = sorted((int(k) for k in context.kept if captures.distance_m[k] == plane_m), key=lambda k: roughness[k])
        first = {float(captures.wavelength_m[k]): k for k in reversed(own)}
        ordered = sorted(own, key=lambda k: (first[float(captures.wavelength_m[k])] != k, roughness[k]))
        return ordered[: self._config.captures]

    def run(self) -> dict[str, Any] | None:
        """The errors of the planes that are off; None where a simpler effect states them, or none is."""
        nothing = np.zeros(len(self.planes_m))
        before, errors = self._costs(nothing), self._on_grid()
        errors, after, curvature = self._refined(errors)
        least = self._config.min_gain * max(1.0, float(after.sum()) / self._comparison.pixel_count)
        ones = np.ones(len(self.planes_m))
        if min(_beyond(errors, curvature, shape) for shape in (ones, self.planes_m)) < least:
            return None
        off = before - after > least
        if not off.any():
            return None
        return {"distances": tuple(self.planes_m[off].tolist()), "errors": tuple(errors[off].tolist())}

    def _on_grid(self) -> Floats:
        """The best error of each plane among distances that miss no minimum."""
        depths = np.array(self._config.depths)
        tried = self._depth_m * np.concatenate([[0.0], depths, -depths])
        costs = [self._costs(np.full(len(self.planes_m), error)) for error in tried]
        return np.asarray(tried[np.argmin(costs, axis=0)])

    def _refined(self, errors: Floats) -> tuple[Floats, Floats, Floats]:
        """The minima near these errors, Σ residual² there, and its curvature (half the second derivative)."""
        step = np.maximum(self._config.first_step * np.abs(errors), self._config.least_step * self._depth_m)
        here = self._costs(errors)
        curvature = np.zeros_like(errors)
        for _ in range(self._config.rounds):
            low, high = self._costs(errors - step), self._costs(errors + step)
            bend = low + high - 2 * here
            vertex = np.where(bend > 0, (low - high) / (2 * np.where(bend > 0, bend, 1.0)), np.sign(low - high))
            moved = errors + step * np.clip(vertex, -1.0, 1.0)
            there = self._costs(moved)
            curvature = np.maximum(bend, 0.0) / (2 * step**2)
            better = there < here
            errors, here = np.where(better, moved, errors), np.where(better, there, here)
            step = step * self._config.step_ratio
        return errors, here, curvature

    def _costs(self, errors: Floats) -> Floats:
        """Σ residual² of each plane's captures with these errors; infinite where the camera can't be."""
        possible = self.planes_m + errors >= self._lowest_m
        given = np.where(possible, errors, 0.0)
        own: dict[str, Any] = {"distances": tuple(self.planes_m.tolist()), "errors": tuple(given.tolist())}
        squares = self._comparison.fit_gains({**self._base, self._effect.id: own}).squares
        return np.where(possible, self._of_plane @ np.asarray(squares, dtype=np.float64), np.inf)


def _beyond(errors: Floats, curvature: Floats, shape: Floats) -> float:
    """By how much Σ residual² exceeds its minimum, by its curvature, with errors in proportion to `shape` alone."""
    power = float((curvature * shape**2).sum())
    amount = float((curvature * shape * errors).sum()) / power if power > 0 else 0.0
    return float((curvature * np.square(errors - amount * shape)).sum())
