"""Starting values where pixels of a modulator are stuck: the columns, rows and pixels, and the levels that they show.

The places are found in rounds. What χ² would gain if a line or a pixel kept to a level (`replacement_gains`) is
compared with that of all other lines, or pixels, by median and median absolute deviation. Those that stand out far
are taken, the levels of all that were taken are fitted by L-BFGS with the derivatives of an adjoint pass, and the next
round looks at what is left. Stuck pixels are known by their parameters, not by their name: an effect with lists of
columns, rows and pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.optimize import minimize

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.displacement_starts import StartingValues
from holoview.diagnose.effect_fit import cost_or_inf
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.replacement_gains import line_gains, replacement_gains, significance, squared_residuals
from holoview.diagnose.search_context import SearchContext
from holoview.model.effects.effect import Effect
from holoview.model.effects.list_parameter import MAX_FREE_ENTRIES

_LISTS = {"columns", "column_levels", "rows", "row_levels", "pixel_rows", "pixel_columns", "pixel_levels"}
Floats = NDArray[np.float64]
_Key = tuple[int | None, int | None]


@dataclass(frozen=True)
class _Place:
    """A stuck column (row is None), row (column is None) or pixel, counted in the modulator's pixels, and its level.

    level: share of the stroke, a tensor while derivatives are computed.
    """

    row: int | None
    column: int | None
    level: float | torch.Tensor

    @property
    def key(self) -> _Key:
        """Which place it is, whatever its level."""
        return self.row, self.column


class StuckStarts:
    """For an effect of stuck pixels, those that the captures suggest; none for others.

    The modulator whose lines or pixels stand out most is searched first; the other one only if that doesn't explain
    most of the error.
    """

    def __init__(self, context: SearchContext, base: FittedValues, comparison: Comparison) -> None:
        self._starts: dict[str, dict[str, Any]] = {}
        open_ones = [e for e in context.effects.values() if _is_stuck_effect(e) and e.id not in base]
        if not open_ones:
            return
        gains = replacement_gains(context, base, comparison, context.config.stuck.levels)
        searches = [_Search(context, base, effect, gains[_modulator(effect)]) for effect in open_ones]
        for search in sorted(searches, key=lambda one: -one.first_significance):
            error = context.relative_model_error(base)
            found = search.run(comparison)
            left = context.relative_model_error(search.values(found))
            if found and left < context.config.stuck.max_error_share * error:
                self._starts[search.effect.id] = _as_values(found)
            if left < context.config.stuck.explained_error_share * error:
                break

    def __call__(self, effect: Effect) -> StartingValues:
        return [self._starts[effect.id]] if effect.id in self._starts else []


def _is_stuck_effect(effect: Effect) -> bool:
    return {p.name for p in effect.parameters} == _LISTS


def _modulator(effect: Effect) -> int:
    """The number of the modulator that an effect acts on, 0 for the first."""
    return int(effect.acts_on[0].removeprefix("modulator ")) - 1


class _Search:
    """The search for the stuck places of one modulator on top of a base. gains: of replacements on the base alone."""

    def __init__(self, context: SearchContext, base: FittedValues, effect: Effect, gains: Floats) -> None:
        self.effect = effect
        self._context, self._base, self._gains, self._config = context, base, gains, context.config.stuck
        self._settled = set[_Key]()
        self._first_pixel = context.data.captures.first_pixel

    @property
    def first_significance(self) -> float:
        """How far the line or the pixel that stands out most does so, over the threshold of its kind."""
        lines = [significance(line_gains(self._gains, axis, self._config.line_segments)) for axis in (1, 2)]
        pixels = significance(self._gains)
        line = max(float(one.max()) for one in lines) / self._config.min_line_sigmas
        return max(line, float(pixels.max()) / self._config.min_pixel_sigmas)

    def run(self, comparison: Comparison) -> list[_Place]:
        """The places, with their levels: on a few captures, then on those of a fit, which tell levels apart that few
        captures confuse."""
        places = self._rounds([], comparison, self._gains)
        if not places:
            return []
        comparison = self._comparison(self._context.split.fine, places)
        self._settled.clear()
        places = self._rounds(places, comparison, self._gains_beside(places, comparison))
        places = self._without_superfluous(self._a_wave_off(places, comparison), comparison)
        if len(places) <= MAX_FREE_ENTRIES:
            return places
        return self._with_fitted_levels(places, comparison, self._config.last_iterations)

    def _rounds(self, places: list[_Place], comparison: Comparison, gains: Floats) -> list[_Place]:
        """The places and those that stand out beside them, round after round, while these lower the model's error."""
        error = self._error(places)
        for _ in range(self._config.rounds):
            wider = self._wider(places, comparison, gains)
            if wider is None or (left := self._error(wider)) > self._config.max_round_error * error:
                break
            places, error = wider, left
            comparison = self._comparison(comparison.indices, places)
            gains = self._gains_beside(places, comparison)
        return places

    def _error(self, places: list[_Place]) -> float:
        return self._context.relative_model_error(self.values(places))

    def _comparison(self, indices: NDArray[np.intp], places: list[_Place]) -> Comparison:
        """A comparison that tolerates the error that is left with these places."""
        return self._context.tolerant_comparison(indices, self._error(places))

    def _gains_beside(self, places: list[_Place], comparison: Comparison) -> Floats:
        """The gains of replacements on top of these places."""
        found = replacement_gains(self._context, self.values(places), comparison, self._config.levels)
        return found[_modulator(self.effect)]

    def _wider(self, places: list[_Place], comparison: Comparison, gains: Floats) -> list[_Place] | None:
        """The places with those lines that stand out beside them, or else with pixels; None where neither gains."""
        for standing_out in (self._lines, self._pixels):
            fresh = [place for place in standing_out(gains, places) if place.key not in self._settled]
            if not fresh or len(places) + len(fresh) > self._config.max_places:
                continue
            known = {place.key: place for place in places}
            wider = list({place.key: place for place in (*fresh, *places)}.values())
            for place in fresh:
                if place.key in known:
                    wider = self._with_best_level(wider, known[place.key], comparison)
            wider = self._with_fitted_levels(wider, comparison)
            if self._gains_enough(comparison, places, wider):
                return wider
        return None

    def _lines(self, gains: Floats, known: list[_Place]) -> list[_Place]:
        """Columns and rows that stand out, with the level that gains most."""
        config, (top, left) = self._config, self._first_pixel
        columns, rows = (significance(line_gains(gains, axis, config.line_segments)) for axis in (1, 2))
        threshold = max(config.min_line_sigmas, config.near_best * max(columns.max(), rows.max()))
        found = [_Place(None, left + int(x), self._level(columns[:, x])) for x in _peaks(columns, threshold)]
        return found + [_Place(top + int(y), None, self._level(rows[:, y])) for y in _peaks(rows, threshold)]

    def _pixels(self, gains: Floats, known: list[_Place]) -> list[_Place]:
        """Pixels that stand out, beside the known lines."""
        config, (top, left) = self._config, self._first_pixel
        pixels = significance(gains)
        for line in (p for p in known if p.row is None or p.column is None):
            rows = slice(None) if line.row is None else line.row - top
            columns = slice(None) if line.column is None else line.column - left
            pixels[:, rows, columns] = 0.0
        best = pixels.max(axis=0)
        found = np.argwhere(best >= max(config.min_pixel_sigmas, config.near_best_pixels * best.max()))
        if len(found) > config.max_pixels:
            return []
        return [_Place(top + int(y), left + int(x), self._level(pixels[:, y, x])) for y, x in found]

    def _a_wave_off(self, places: list[_Place], comparison: Comparison) -> list[_Place]:
        """The places with levels that are a wave higher or lower where that is better, unless the noise is reached.

        At one wavelength these levels are the same light, so that they are minima of χ² at several too.
        """
        noise_alone = self._context.data_weighted_comparison(comparison.indices, 0.0)
        floor = self._context.config.selection.floor_chi2
        if len(places) > MAX_FREE_ENTRIES or noise_alone.chi2_per_pixel(self.values(places)) < floor:
            return places
        captures = self._context.data.captures
        waves = captures.wavelengths_m / captures.slms[_modulator(self.effect)].opd_range_m
        for place in places:
            level, others = float(place.level), [one for one in places if one is not place]
            levels = [level, *(level + wave for wave in (*waves, *-waves) if 0 <= level + wave <= 1)]
            tried = [[*others, replace(place, level=float(one))] for one in levels]
            places = min(tried, key=lambda with_level: cost_or_inf(comparison, self.values(with_level)))
        return self._with_fitted_levels(places, comparison)

    def _with_best_level(self, places: list[_Place], one: _Place, comparison: Comparison) -> list[_Place]:
        """One place at the level of lowest χ², each of which is predicted: the first one was of another minimum.

        Where that is the level that it has, it is settled.
        """
        others, levels = [place for place in places if place.key != one.key], self._config.levels
        tried = [[*others, replace(one, level=float(level))] for level in levels]
        best = min(tried, key=lambda with_level: cost_or_inf(comparison, self.values(with_level)))
        if abs(best[-1].level - one.level) > levels[1] - levels[0]:
            return best
        self._settled.add(one.key)
        return places

    def _level(self, sigmas: Floats) -> float:
        """The level of the highest value."""
        return float(self._config.levels[int(sigmas.argmax())])

    def _with_fitted_levels(
        self, places: list[_Place], comparison: Comparison, iterations: int | None = None
    ) -> list[_Place]:
        """The places with the levels that lower χ² most, by L-BFGS from those that they have."""
        places = sorted(places, key=_order)

        def function(vector: Floats) -> tuple[float, Floats]:
            levels = [torch.tensor(x, dtype=torch.float32, requires_grad=True) for x in vector]
            values = self.values([replace(p, level=t) for p, t in zip(places, levels, strict=True)])
            total, slopes = 0.0, np.zeros(len(vector))
            for position in range(len(comparison.indices)):
                squares = squared_residuals(comparison, values, position) / comparison.pixel_count
                slopes += [float(g) for g in torch.autograd.grad(squares, levels)]
                total += float(squares.detach())
            return total, slopes

        bounds = next((p.low, p.high) for p in self.effect.parameters if p.name == "pixel_levels")
        solution = minimize(
            function,
            np.array([float(p.level) for p in places]),
            jac=True,
            method="L-BFGS-B",
            bounds=[bounds] * len(places),
            options={"maxiter": iterations or self._config.level_iterations},
        )
        return [replace(p, level=float(x)) for p, x in zip(places, solution.x, strict=True)]

    def _gains_enough(self, comparison: Comparison, few: list[_Place], more: list[_Place]) -> bool:
        """Whether χ² falls by enough for each further place."""
        before, after = (cost_or_inf(comparison, self.values(places)) for places in (few, more))
        least = self._config.min_gain * max(1.0, after / comparison.pixel_count)
        return before - after > least * max(1, len(more) - len(few))

    def _without_superfluous(self, places: list[_Place], comparison: Comparison) -> list[_Place]:
        """Without places that gain too little beside the others, the last ones first."""
        for place in places[::-1]:
            others = [p for p in places if p is not place]
            if not self._gains_enough(comparison, others, places):
                places = others
        return places

    def values(self, places: list[_Place]) -> FittedValues:
        """The base with these places."""
        return {**self._base, self.effect.id: _as_values(places)} if places else self._base


def _order(place: _Place) -> tuple[bool, bool, int, int]:
    """Columns, rows, pixels."""
    return place.row is not None, place.column is not None, place.row or 0, place.column or 0


def _as_values(places: list[_Place]) -> dict[str, Any]:
    """The lists of the effect's parameters."""
    columns, rows = [p for p in places if p.row is None], [p for p in places if p.column is None]
    pixels = [p for p in places if p.row is not None and p.column is not None]
    return {
        "columns": tuple(p.column for p in columns),
        "column_levels": tuple(p.level for p in columns),
        "rows": tuple(p.row for p in rows),
        "row_levels": tuple(p.level for p in rows),
        "pixel_rows": tuple(p.row for p in pixels),
        "pixel_columns": tuple(p.column for p in pixels),
        "pixel_levels": tuple(p.level for p in pixels),
    }


def _peaks(sigmas: Floats, threshold: float) -> Iterator[Any]:
    """Indices of lines that reach the threshold at their best level and are higher than their neighbours."""
    best = sigmas.max(axis=0)
    return iter(np.flatnonzero((best >= threshold) & (best == maximum_filter(best, size=3))))
