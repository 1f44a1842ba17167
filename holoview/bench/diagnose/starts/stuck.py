"""Starting values where pixels of a modulator are stuck: the columns, rows and pixels, and the levels that they show.

The places are found in rounds. The fall of χ² if a line or a pixel kept to a level (`replacement_gains`) is compared
with the fall for all other lines, or pixels, by median and median absolute deviation. Places that stand out far are
taken, their levels are fitted by L-BFGS with the derivatives of an adjoint pass, and the next round starts from the
residual.

DeadPlace   a line, a part of a line, or a pixel; the lists of an effect's parameters that state several places
StuckStarts the places that the captures suggest
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache, cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.optimize import minimize

from holoview.bench.diagnose.fit import FittedValues, cost_or_inf
from holoview.bench.diagnose.judge import FLOOR_CHI2
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.search_context import SearchContext
from holoview.bench.diagnose.starts.picture import StartingValues
from holoview.bench.diagnose.starts.transmission_slopes import (
    line_significance,
    modulator_of,
    replacement_gains,
    significance,
    squared_residuals,
)
from holoview.light.model.effects.effect import MAX_FREE_ENTRIES, Effect, StartKind

_LEVEL_COUNT = 24
"""[levels] Shares of the stroke from 0 to 1 that are tried. Evidence: a stroke of two waves advances by half a radian
from one to the next."""
LINE_SEGMENTS = 8
"""[segments] The gain of a line is the median of so many parts of it, times their number. Evidence: a block of stuck
pixels reaches over one or two parts, and isn't taken for a line."""
_PART_SEGMENTS = 3
"""[segments] Parts of a line are looked for that begin at an edge and have so many segments or more. Evidence: as for
`LINE_SEGMENTS`: the median of three tolerates one that a block reaches over."""
_END_MOVES = (-8, -4, -2, -1, 1, 2, 4, 8)
"""[pixels] By which the end of a part of a line is moved, again and again, while χ² falls. Evidence: derivation: gains
locate the end to some pixels."""
MIN_LINE_SIGMAS = 5.0  # [σ] Lines that stand out less from the others aren't taken.
_MIN_PIXEL_SIGMAS = 8.0  # [σ] The same of single pixels, of which there are a hundred times as many.
NEAR_BEST_LINES = 0.5
"""[1] Lines of this share of the best line's significance are taken in the same round, where their neighbours have
less."""
_NEAR_BEST_PIXELS = 0.6  # [1] The same of pixels, but with their neighbours, since stuck pixels come in groups.
_MAX_PIXELS = 48
"""[pixels] If more stand out in a round, none is taken, since another fault spreads over the modulator. Evidence: with
stuck pixels up to 20 stood out, on the modulator without stuck pixels 18 to 107."""
_MAX_ROUND_ERROR = 0.95
"""[1] A round must leave less than this share of the model's error. Evidence: places on the wrong modulator took away 2
to 5 % in a round."""
_MAX_ERROR_SHARE = 0.7  # [1] All places together must leave less than this share.
_EXPLAINED_ERROR_SHARE = 0.1  # [1] If less is left, the other modulator isn't searched.
_ROUNDS = 12  # [rounds] At most. Evidence: neighbours are taken in different rounds.
_LEVEL_ITERATIONS = 6  # [1] Iterations of L-BFGS on the levels in a round. Evidence: a local fit follows.
_LAST_ITERATIONS = 24  # [1] The same at the end, for lists that are too long for a local fit.
_MIN_GAIN = 25.0
"""[Δχ²] A place must gain so much, times χ²/n where that is above 1. Evidence: 5 σ for one number, as for a cause
(`min_delta_chi2`)."""
_MAX_PLACES = 160  # [places] The search ends there. Evidence: a modulator with more needs repair.
LEVELS = np.linspace(0.0, 1.0, _LEVEL_COUNT)  # [1] The shares of the stroke that are tried.

Key = tuple[int | None, int | None]


class Shows(StrEnum):
    """The light of a dead place: one level, the first pattern of all captures, or the pattern of the capture before."""

    LEVEL = "level"
    FIRST = "kept"
    BEFORE = "late"


@dataclass(frozen=True)
class DeadPlace:
    """A column (row is None), row (column is None) or pixel, counted in the modulator's pixels.

    level: share of the stroke, a tensor while derivatives are computed. shows: what it shows; pixels and parts show
    levels. span: first and last pixel along a line of which a part is dead; None for all of it.
    """

    row: int | None
    column: int | None
    level: float | torch.Tensor = 0.0
    shows: Shows = Shows.LEVEL
    span: tuple[int, int] | None = None

    @property
    def key(self) -> Key:
        """The identity of the place, whatever it shows and however much of it is dead."""
        return self.row, self.column

    @property
    def is_line(self) -> bool:
        """Whether it is a row, a column, or a part of one."""
        return self.row is None or self.column is None

    def stands_for(self, line: DeadPlace) -> bool:
        """Whether the place is a pixel on a line or beside it, which may have been taken before the line was."""
        if self.row is None or self.column is None or not line.is_line:
            return False
        distance = self.column - line.column if line.column is not None else self.row - (line.row or 0)
        return abs(distance) <= 1

    @property
    def has_level(self) -> bool:
        """Whether it shows one level."""
        return self.shows is Shows.LEVEL

    @property
    def order(self) -> tuple[bool, bool, bool, int, int]:
        """Columns, rows, pixels; whole lines before parts of lines."""
        return (not self.is_line, self.row is not None, self.span is not None, self.row or 0, self.column or 0)

    @property
    def sides(self) -> tuple[int, int, int, int]:
        """First and last row, first and last column, of a part of a line."""
        first, last = self.span or (0, 0)
        rows = (first, last) if self.row is None else (self.row, self.row)
        columns = (first, last) if self.column is None else (self.column, self.column)
        return (*rows, *columns)


def is_stuck_effect(effect: Effect) -> bool:
    """Whether an effect is one of dead places."""
    return StartKind.STUCK_PIXELS in effect.start_kinds


def as_values(places: Sequence[DeadPlace]) -> dict[str, Any]:
    """The lists of an effect's parameters, in the order of the places."""
    places = sorted(places, key=lambda place: place.order)
    whole = [p for p in places if p.is_line and p.span is None]
    columns = [p for p in whole if p.row is None and p.has_level]
    rows = [p for p in whole if p.column is None and p.has_level]
    parts, pixels = [p for p in places if p.span is not None], [p for p in places if not p.is_line]
    values: dict[str, Any] = {
        "columns": tuple(p.column for p in columns),
        "column_levels": tuple(p.level for p in columns),
        "rows": tuple(p.row for p in rows),
        "row_levels": tuple(p.level for p in rows),
        "pixel_rows": tuple(p.row for p in pixels),
        "pixel_columns": tuple(p.column for p in pixels),
        "pixel_levels": tuple(p.level for p in pixels),
        "part_levels": tuple(p.level for p in parts),
    }
    for i, side in enumerate(("first_rows", "last_rows", "first_columns", "last_columns")):
        values[f"part_{side}"] = tuple(p.sides[i] for p in parts)
    for shows in (Shows.FIRST, Shows.BEFORE):
        own = [p for p in whole if p.shows is shows]
        values[f"{shows}_columns"] = tuple(p.column for p in own if p.row is None)
        values[f"{shows}_rows"] = tuple(p.row for p in own if p.column is None)
    return values


def _without_neighbours(places: Sequence[DeadPlace]) -> list[DeadPlace]:
    """The places without pixels beside an earlier pixel."""
    kept: list[DeadPlace] = []
    for place in places:
        if not any(_are_neighbours(place.key, other.key) for other in kept):
            kept.append(place)
    return kept


def _are_neighbours(a: Key, b: Key) -> bool:
    """Whether both are pixels, side by side or corner to corner."""
    return all(p is not None and q is not None and abs(p - q) <= 1 for p, q in zip(a, b, strict=True))


def spans_near(span: tuple[int, int], count: int, steps: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Spans of a line of `count` pixels from an edge, with the inner end moved by each of the steps."""
    first, last = span
    for step in steps:
        moved = (first + step, last) if last == count - 1 else (first, last + step)
        if 0 <= moved[0] < moved[1] < count and moved != (0, count - 1):
            yield moved


def likely_span(gains: NDArray[np.float64]) -> tuple[int, int]:
    """The part of a line that gains, from one edge on, or all of it. gains: of each pixel along the line.

    A change point between pixels whose gain is g on average, the highest of any part of three eighths, and pixels of no
    gain: the sum of gain − g/2 over the part is largest.
    """
    count = len(gains)
    least = max(2, 3 * count // 8)
    means = [np.convolve(gains, np.ones(least) / least, mode="valid")[i] for i in (0, -1)]
    beyond = gains - max(float(gains.mean()), *map(float, means)) / 2
    from_start, from_end = np.cumsum(beyond), np.cumsum(beyond[::-1])
    if from_start.max() >= from_end.max():
        return 0, int(from_start.argmax())
    return count - 1 - int(from_end.argmax()), count - 1


Floats = NDArray[np.float64]


class StuckStarts:
    """For an effect of stuck pixels, the places that the captures suggest; none for others.

    The modulator whose lines or pixels stand out most is searched first; the other modulator only if the first doesn't
    explain most of the error.
    """

    def __init__(self, context: SearchContext, base: FittedValues, comparison: Comparison) -> None:
        self._starts: dict[str, dict[str, Any]] = {}
        open_ones = [e for e in context.effects.values() if is_stuck_effect(e) and e.id not in base]
        if not open_ones:
            return
        gains = replacement_gains(context, base, comparison, LEVELS, earlier=True)
        searches = [
            _StuckSearch(context, base, effect, number, gains[number])
            for effect in open_ones
            if (number := modulator_of(effect, context.data.captures)) is not None
        ]
        for search in sorted(searches, key=lambda one: -one.first_significance):
            error = context.relative_model_error(base)
            found = search.run(comparison)
            left = context.relative_model_error(search.values(found))
            if found and left < _MAX_ERROR_SHARE * error:
                self._starts[search.effect.id] = as_values(found)
            if left < _EXPLAINED_ERROR_SHARE * error:
                break

    def __call__(self, effect: Effect) -> StartingValues:
        return [self._starts[effect.id]] if effect.id in self._starts else []


class _StuckSearch:
    """The search for the stuck places of one modulator on top of a base.

    number: of the modulator, as of `modulator_of`. gains: of replacements on the base alone.
    """

    def __init__(self, context: SearchContext, base: FittedValues, effect: Effect, number: int, gains: Floats) -> None:
        self.effect, self._number = effect, number
        self._context, self._base, self._gains = context, base, gains
        self._settled = set[Key]()
        captures = context.data.captures
        self._first_pixel, self._whole = captures.first_pixel, captures.slm_frame or gains.shape[1:]

    @cached_property
    def first_significance(self) -> float:
        """How far the most conspicuous line or pixel stands out, over the threshold of its kind."""
        lines = [self._line_significance(self._gains, axis) for axis in (1, 2)]
        pixels = significance(self._gains[:_LEVEL_COUNT])
        line = max(float(one.max()) for one in lines) / MIN_LINE_SIGMAS
        return max(line, float(pixels.max()) / _MIN_PIXEL_SIGMAS)

    def run(self, comparison: Comparison) -> list[DeadPlace]:
        """The places with their levels: on a few captures, then on the captures of a fit, which tell levels apart that
        few captures confuse. Pixels may stand for a line with earlier patterns, which only more captures show.
        """
        if self.first_significance < 1:
            return []
        places = self._rounds([], comparison, self._gains)
        if not any(place.is_line for place in places):
            lines = self._lines_alone(self._comparison(self._context.split.fine, []))
            places = lines if lines and self._error(lines) < self._error(places) else places
        if not places:
            return []
        comparison = self._comparison(self._context.split.fine, places)
        self._settled.clear()
        places = self._rounds(places, comparison, self._gains_beside(places, comparison))
        places = self._with_joined_pixels(places, comparison)
        places = self._with_best_looks(self._a_wave_off(places, comparison), comparison)
        places = self._without_superfluous(places, comparison)
        if len(places) <= MAX_FREE_ENTRIES:
            return places
        return self._with_fitted_levels(places, comparison, _LAST_ITERATIONS)

    def _rounds(self, places: list[DeadPlace], comparison: Comparison, gains: Floats) -> list[DeadPlace]:
        """The places and further places that stand out beside them, round after round, while these lower the model's
        error."""
        error = self._error(places)
        for _ in range(_ROUNDS):
            wider = self._wider(places, comparison, gains)
            if wider is None or (left := self._error(wider)) > _MAX_ROUND_ERROR * error:
                break
            places, error = wider, left
            comparison = self._comparison(comparison.indices, places)
            gains = self._gains_beside(places, comparison)
        return places

    def _lines_alone(self, comparison: Comparison) -> list[DeadPlace]:
        """The lines that stand out on the base alone."""
        lines = self._lines(self._gains_beside([], comparison), [])
        return self._with_best_spans(self._with_fitted_levels(lines, comparison), comparison) if lines else []

    def _error(self, places: list[DeadPlace]) -> float:
        return self._context.relative_model_error(self.values(places))

    def _comparison(self, indices: NDArray[np.intp], places: list[DeadPlace]) -> Comparison:
        """A comparison that tolerates the error that these places leave."""
        return self._context.tolerant_comparison(indices, self._error(places))

    def _gains_beside(self, places: list[DeadPlace], comparison: Comparison) -> Floats:
        """The gains of replacements on top of these places."""
        found = replacement_gains(self._context, self.values(places), comparison, LEVELS, earlier=True)
        return found[self._number]

    def _wider(self, places: list[DeadPlace], comparison: Comparison, gains: Floats) -> list[DeadPlace] | None:
        """The places with the lines that stand out beside them, or else with pixels; None where neither gains."""
        for standing_out in (self._lines, self._pixels):
            fresh = [place for place in standing_out(gains, places) if place.key not in self._settled]
            if not fresh or len(places) + len(fresh) > _MAX_PLACES:
                continue
            wider = self._with_fresh(places, fresh, comparison)
            apart = _without_neighbours(fresh)
            if len(apart) < len(fresh):  # a neighbour of a dead place may seem dead too, and spoil both levels
                fewer = self._with_fresh(places, apart, comparison)
                first = next(place for place in fewer if place.key == apart[0].key)
                fewer = self._with_fitted_levels(self._with_best_level(fewer, first, comparison), comparison)
                wider = wider if self._gains_enough(comparison, fewer, wider) else fewer
            if self._gains_enough(comparison, places, wider):
                return wider
        return None

    def _with_fresh(self, places: list[DeadPlace], fresh: list[DeadPlace], comparison: Comparison) -> list[DeadPlace]:
        """The places with others that stand out beside them, with fitted levels and ends; a place that was known before
        takes the level of lowest χ²."""
        kept = [place for place in places if not any(place.stands_for(line) for line in fresh)]
        known = {place.key: place for place in kept}
        wider = list({place.key: place for place in (*fresh, *kept)}.values())
        for place in fresh:
            if place.key in known:
                wider = self._with_best_level(wider, known[place.key], comparison)
        return self._with_best_spans(self._with_fitted_levels(wider, comparison), comparison)

    def _lines(self, gains: Floats, known: list[DeadPlace]) -> list[DeadPlace]:
        """Columns and rows that stand out, the clearest first, with the level or earlier pattern that gains most."""
        (top, left) = self._first_pixel
        columns, rows = (self._line_significance(gains, axis) for axis in (1, 2))
        threshold = max(MIN_LINE_SIGMAS, NEAR_BEST_LINES * max(columns.max(), rows.max()))
        found = [
            (columns[:, x].max(), self._line(gains[:, :, x], columns[:, x], column=left + int(x)))
            for x in _peaks(columns, threshold)
        ]
        found += [
            (rows[:, y].max(), self._line(gains[:, y], rows[:, y], row=top + int(y))) for y in _peaks(rows, threshold)
        ]
        return [line for _, line in sorted(found, key=lambda pair: -pair[0])]

    def _line_significance(self, gains: Floats, axis: int) -> Floats:
        return line_significance(gains, axis, LINE_SEGMENTS, _PART_SEGMENTS)

    def _line(self, gains: Floats, sigmas: Floats, *, row: int | None = None, column: int | None = None) -> DeadPlace:
        """A line, or the part of it that gains. gains (look, pixel): for each pattern or level that it may show. sigmas
        (look,): significance of the line."""
        look, count = int(sigmas.argmax()), _LEVEL_COUNT
        if look >= count:
            return DeadPlace(row, column, shows=(Shows.FIRST, Shows.BEFORE)[look - count])
        place, axis = DeadPlace(row, column, self._level(sigmas)), 0 if row is None else 1
        first, last = likely_span(gains[look])
        if (last - first + 1) * LINE_SEGMENTS > (LINE_SEGMENTS - 1) * len(gains[look]):
            return place
        edge = self._first_pixel[axis]
        span = (first and first + edge, last + edge if last < len(gains[look]) - 1 else self._whole[axis] - 1)
        return replace(place, span=span)

    def _pixels(self, gains: Floats, known: list[DeadPlace]) -> list[DeadPlace]:
        """Pixels that stand out, the clearest first, beside the known lines."""
        (top, left) = self._first_pixel
        pixels = significance(gains[:_LEVEL_COUNT])
        for line in (p for p in known if p.is_line):
            rows = slice(None) if line.row is None else line.row - top
            columns = slice(None) if line.column is None else line.column - left
            pixels[:, rows, columns] = 0.0
        best = pixels.max(axis=0)
        found = np.argwhere(best >= max(_MIN_PIXEL_SIGMAS, _NEAR_BEST_PIXELS * best.max()))
        if len(found) > _MAX_PIXELS:
            return []
        clearest_first = sorted(found, key=lambda place: -best[tuple(place)])
        return [DeadPlace(top + int(y), left + int(x), self._level(pixels[:, y, x])) for y, x in clearest_first]

    def _a_wave_off(self, places: list[DeadPlace], comparison: Comparison) -> list[DeadPlace]:
        """The places with levels a wave higher or lower where this lowers χ², unless the noise is reached. At one
        wavelength levels a wave apart are the same light; with several wavelengths each is a local minimum of χ².
        """
        noise_alone = self._context.data_weighted_comparison(comparison.indices, 0.0)
        floor = FLOOR_CHI2
        if len(places) > MAX_FREE_ENTRIES or noise_alone.chi2_per_pixel(self.values(places)) < floor:
            return places
        captures = self._context.data.captures
        stroke_m = captures.slms[self._number].opd_range_m
        waves = captures.wavelengths_m / stroke_m if stroke_m else np.empty(0)  # of an amplitude modulator
        for place in (place for place in places if place.has_level):
            level, others = float(place.level), [one for one in places if one is not place]
            levels = [level, *(level + wave for wave in (*waves, *-waves) if 0 <= level + wave <= 1)]
            tried = [[*others, replace(place, level=float(one))] for one in levels]
            places = self._cheapest(tried, comparison)
        return self._with_fitted_levels(places, comparison)

    def _with_best_level(self, places: list[DeadPlace], one: DeadPlace, comparison: Comparison) -> list[DeadPlace]:
        """The places with one of them at the level of lowest χ², for which every level is predicted, because its first
        level may belong to another local minimum. A place that keeps its level, or shows an earlier pattern, is
        settled.
        """
        if not one.has_level:
            self._settled.add(one.key)
            return places
        others, levels = [place for place in places if place.key != one.key], LEVELS
        tried = [[*others, replace(one, level=float(level))] for level in levels]
        best = self._cheapest(tried, comparison)
        if abs(best[-1].level - one.level) > levels[1] - levels[0]:
            return best
        self._settled.add(one.key)
        return places

    def _with_joined_pixels(self, places: list[DeadPlace], comparison: Comparison) -> list[DeadPlace]:
        """The places with a part of a line in place of its pixels, where there are enough of them to show the line, and
        the part predicts about as well."""
        for axis in (0, 1):  # columns, along which rows are counted, and rows
            for number in {place.key[1 - axis] for place in places if not place.is_line}:
                pixels = [p for p in places if not p.is_line and p.key[1 - axis] == number]
                along, count = sorted(p.key[axis] or 0 for p in pixels), self._whole[axis]
                if len(pixels) * LINE_SEGMENTS < _PART_SEGMENTS * count:
                    continue
                level = float(np.median([float(p.level) for p in pixels]))
                others, key = [p for p in places if p not in pixels], (None, number) if axis == 0 else (number, None)
                spans = ((along[0], count - 1), (0, along[-1]))
                tried = [[*others, DeadPlace(key[0], key[1], level, span=span)] for span in spans]
                joined = self._with_fitted_levels(self._cheapest(tried, comparison), comparison)
                joined = self._with_best_spans(joined, comparison)
                if not self._gains_enough(comparison, joined, places):
                    places = joined
        return places

    def _with_best_looks(self, places: list[DeadPlace], comparison: Comparison) -> list[DeadPlace]:
        """The places with each line as it lowers χ²: an earlier pattern in place of a level or the reverse, unless the
        noise is reached."""
        noise_alone = self._context.data_weighted_comparison(comparison.indices, 0.0)
        if noise_alone.chi2_per_pixel(self.values(places)) >= FLOOR_CHI2:
            for line in [place for place in places if place.is_line]:
                others = [one for one in places if one is not line]
                looks = [DeadPlace(line.row, line.column, shows=shows) for shows in (Shows.FIRST, Shows.BEFORE)]
                if not line.has_level:
                    looks += [DeadPlace(line.row, line.column, float(level)) for level in LEVELS]
                places = self._cheapest([[*others, one] for one in (line, *looks)], comparison)
            places = self._with_fitted_levels(places, comparison)
        return self._with_best_spans(places, comparison)

    def _with_best_spans(self, places: list[DeadPlace], comparison: Comparison) -> list[DeadPlace]:
        """Parts of lines with the ends that lower χ² most; whole lines where they cost little more."""
        for line in [place for place in places if place.span is not None]:
            others = [one for one in places if one is not line]
            places = [*others, self._with_best_span(line, others, comparison)]
            whole = [*others, replace(line, span=None)]
            if not self._gains_enough(comparison, whole, places):
                places = whole
        return places

    def _with_best_span(self, line: DeadPlace, others: list[DeadPlace], comparison: Comparison) -> DeadPlace:
        """A part of a line with the end that lowers χ² most beside other places: each move is predicted once."""

        @cache
        def cost(span: tuple[int, int]) -> float:
            return cost_or_inf(comparison, self.values([*others, replace(line, span=span)]))

        assert line.span is not None
        span, least, count = line.span, np.inf, self._whole[0 if line.row is None else 1]
        while cost(span) < least:
            least = cost(span)
            span = min((span, *spans_near(span, count, _END_MOVES)), key=cost)
        return replace(line, span=span)

    def _cheapest(self, tried: list[list[DeadPlace]], comparison: Comparison) -> list[DeadPlace]:
        return min(tried, key=lambda places: cost_or_inf(comparison, self.values(places)))

    def _level(self, sigmas: Floats) -> float:
        """The level with the highest value of `sigmas`."""
        return float(LEVELS[int(sigmas[:_LEVEL_COUNT].argmax())])

    def _with_fitted_levels(
        self, places: list[DeadPlace], comparison: Comparison, iterations: int | None = None
    ) -> list[DeadPlace]:
        """The places with the levels that lower χ² most, by L-BFGS from their present levels."""
        fixed = [place for place in places if not place.has_level]
        places = sorted((place for place in places if place.has_level), key=lambda place: place.order)
        if not places:
            return fixed

        def function(vector: Floats) -> tuple[float, Floats]:
            levels = [torch.tensor(x, dtype=torch.float32, requires_grad=True) for x in vector]
            values = self.values([*fixed, *(replace(p, level=t) for p, t in zip(places, levels, strict=True))])
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
            options={"maxiter": iterations or _LEVEL_ITERATIONS},
        )
        return fixed + [replace(p, level=float(x)) for p, x in zip(places, solution.x, strict=True)]

    def _gains_enough(self, comparison: Comparison, few: list[DeadPlace], more: list[DeadPlace]) -> bool:
        """Whether χ² falls by enough for each further place."""
        before, after = (cost_or_inf(comparison, self.values(places)) for places in (few, more))
        least = _MIN_GAIN * max(1.0, after / comparison.pixel_count)
        return before - after > least * max(1, len(more) - len(few))

    def _without_superfluous(self, places: list[DeadPlace], comparison: Comparison) -> list[DeadPlace]:
        """The places without those that gain too little beside the others; the last places are tried first."""
        for place in places[::-1]:
            others = [p for p in places if p is not place]
            if not self._gains_enough(comparison, others, places):
                places = others
        return places

    def values(self, places: list[DeadPlace]) -> FittedValues:
        """The values of the base with these places."""
        return {**self._base, self.effect.id: as_values(places)} if places else self._base


def _peaks(sigmas: Floats, threshold: float) -> Iterator[Any]:
    """Indices of lines that reach the threshold at their best level and are higher than their neighbours."""
    best = sigmas.max(axis=0)
    return iter(np.flatnonzero((best >= threshold) & (best == maximum_filter(best, size=3))))
