"""The middle of large pictures is searched; whole pictures polish and judge the causes found there.

A field of 1024 × 768 modulator pixels takes a hundred times as long as a field of 128 × 96, and a search needs
thousands of fields. But most effects act everywhere alike. So the captures are cut to their middle and searched. The
causes found are fitted once more to parts of the pictures (`parts`), or to whole pictures, which then rank and judge
them. Effects that show more towards the edges (`Effect.varies_over_field`) are searched there.

In the near field modulators and pictures are cut, with as much margin as light walks off sideways. Hard edges of stops
spread a little light further; the part that reaches the middle from beyond is measured with the nominal bench and
counts as noise. Once causes are found, that part is predicted with them and subtracted, and weaker causes are searched.
On a Fourier bench the pictures alone are cut, and predicted exactly; displaced far fields are cut less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.predictor import PLAIN, SamplingConfig
from holoview.bench.captures.prepared_captures import Images, prepare_captures
from holoview.bench.captures.records.trials import central_region, central_slices, picture_window, speckle_px
from holoview.bench.diagnose.capture_split import split_captures
from holoview.bench.diagnose.config import RegionConfig
from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.search_context import (
    NeighbourVariances,
    Pace,
    PerThreadPredictor,
    SearchContext,
    field_samples,
)
from holoview.bench.diagnose.starts.picture import measure_displacement
from holoview.util.errors import UserError

Floats = NDArray[np.float64]
Picture = TypeVar("Picture", bound=NDArray[Any])

_MIN_SIDE_PX = 64
"""[px] Modulator pixels, on a Fourier bench speckles, across the middle with many captures. Evidence: measured: pairs
of faults are named as well with modulators of 64 × 48 pixels; in the near field, with 128 across and their margin, a
field takes three times as long."""
_ALL_PX = 1 << 16
"""[px] Of all captures together in the middle. Evidence: 16 captures of 64 × 64 pixels."""
_CUT_CAPTURES = 6
"""[captures] Predicted whole to measure the light that the middle lacks. Evidence: that share grows steadily with the
roughness of the patterns; the roughest is among them. The value: a whole field takes seconds."""
_STOP_CAPTURES = 4  # [captures] That tell whether sharp or weighted stops fit. Evidence: as for `_CUT_CAPTURES`.
_STOP_ERROR = 0.5
"""[1] Error of weighted stops over their difference from sharp ones. Evidence: measured: of rough patterns in files of
an independent program 0.5 with 256 × 192 pixels, about 1 with 1024 × 768; half leaves χ²/n at 1 or little above."""
MAX_TIME_SHARE = 0.7
"""[1] Of the time of a search, after which the middle is given up with its best result. Evidence: a reason: whole
pictures have to be fitted and judged too. Measured: with 0.6, a pair of faults in 32 captures of 1600 × 1200 pixels was
found in time, but not when the machine was slower by a quarter."""
_MAX_DISPLACEMENT = 0.125
"""[1] Displacement of a far field from its prediction, over the middle's width, from which the middle is widened by the
displacement on either side. Evidence: a reason: seven eighths of the far field are seen and predicted."""


def middle_of_context(context: SearchContext) -> SearchContext | None:
    """The context of a search in the middle of the pictures; None where it would save little."""
    captures, config, budget = context.data.captures, context.config.region, context.config.budget
    cut = middle_captures(captures, config)
    if pixel_ratio(captures, cut) < config.min_saving:
        return None
    if captures.is_fourier and (further := _displaced_speckles(context, cut)):
        cut = middle_captures(captures, config, further)
        if pixel_ratio(captures, cut) < config.min_saving:
            return None
    shape = cut.shape
    window = picture_window(captures, shape) if captures.is_fourier else central_slices(captures.shape, shape)
    data, fields = prepare_captures(cut), math.inf
    if math.isfinite(context.field_budget):
        share = context.field_budget / budget.fields_for(field_samples(captures, context.sampling))
        middle, usual = field_samples(cut, context.sampling), field_samples(captures, PLAIN)
        fields = share * budget.fields_for_middle(middle, usual)
    options = {"captures": cut} if captures.is_fourier else compact_prediction(cut)
    return replace(
        context,
        data=data,
        system=cut.nominal_system(),
        field_budget=fields,
        split=split_captures(cut, pattern_roughness(captures), context.left_out),
        predictor=PerThreadPredictor(partial(context.predictor.create, **options)),
        variances=NeighbourVariances(data),
        end=context.end.after_share(MAX_TIME_SHARE),
        pace=Pace(),
        windows=(window,),
    )


def compact_prediction(cut: Captures) -> dict[str, Any]:
    """The keywords of a predictor of a part of near-field captures.

    What is seen has a margin as wide as light walks off, and needs no wider padding. The edges of stops cut at other
    frequencies than on the whole grid.
    """
    return {"captures": cut, "propagation": "compact", "has_weighted_stops": True}


def through_windows(windows: Sequence[tuple[slice, slice]], pictures: Picture) -> Picture:
    """What windows show of pictures (…, y, x), one below the other."""
    seen: Picture = np.concatenate([pictures[..., *window] for window in windows], axis=-2)  # type: ignore[assignment]
    return seen


def _displaced_speckles(context: SearchContext, cut: Captures) -> int:
    """Displacement of far fields from their prediction, in speckles; 0 where the middle still holds most of them."""
    comparison = context.data_weighted_comparison(context.split.coarse, 0.0)
    predicted = np.asarray(comparison.predictor(comparison.indices, {}).signal)
    light = np.where(comparison.weight > 0, comparison.light, np.float32(0.0))
    moved = np.abs(measure_displacement(light, predicted))
    if (moved <= _MAX_DISPLACEMENT * np.array(cut.shape)).all():
        return 0
    return math.ceil((moved / speckle_px(context.data.captures)).max())


def measure_missing_light(context: SearchContext, middle: SearchContext) -> Floats:
    """The middle's r.m.s. error over mean light, (capture,), measured with the nominal bench; 0 on a Fourier bench.

    A few of the searched captures, from smooth to rough, are predicted whole and cut; the others take the error of the
    next rougher capture.
    """
    if context.data.captures.is_fourier:
        return np.zeros(len(context.data.captures))
    known = _smooth_to_rough(middle, _CUT_CAPTURES)
    errors = context.run_parallel([partial(_error_of, context, middle, np.array([k])) for k in known])
    return _of_next_rougher(middle, known, np.array(errors))


def _smooth_to_rough(context: SearchContext, count: int) -> NDArray[np.intp]:
    """At most `count` of the captures that a search uses, the roughest first."""
    used, roughness = np.array(sorted(context.split.used)), pattern_roughness(context.data.captures)
    used = used[np.argsort(-roughness[used], kind="stable")]
    return np.asarray(used[np.linspace(0, len(used) - 1, min(len(used), count)).round().astype(int)])


def _of_next_rougher(context: SearchContext, known: NDArray[np.intp], errors: Floats) -> Floats:
    """The errors of some captures, and for each of the others that of the next rougher one of them, (capture,)."""
    roughness = pattern_roughness(context.data.captures)
    order = np.argsort(roughness[known], kind="stable")
    place = np.minimum(np.searchsorted(roughness[known][order], roughness), len(known) - 1)
    found = np.asarray(errors[order][place], dtype=np.float64)
    found[known] = errors
    return found


def _error_of(context: SearchContext, middle: SearchContext, index: NDArray[np.intp]) -> float:
    return _difference(*_seen_and_cut(context, middle, index, {}))


def _seen_and_cut(
    context: SearchContext, middle: SearchContext, index: NDArray[np.intp], values: FittedValues
) -> tuple[Images, Images]:
    """The middle (y, x) of one predicted picture, from all pixels of the modulators, and from those of the middle; or
    parts of it."""
    whole, cut = (np.asarray(c.predictor(index, values).signal)[0] for c in (context, middle))
    return through_windows(middle.windows, whole), cut


def _difference(picture: Images, other: Images) -> float:
    """R.m.s. difference of two pictures over mean light, but for a factor."""
    scaled = other * (np.vdot(other, picture) / np.vdot(other, other))
    return float(np.sqrt(np.square(picture - scaled).mean()) / picture.mean())


def without_light_from_beyond(context: SearchContext, middle: SearchContext, values: FittedValues) -> SearchContext:
    """The middle, or parts, from whose pictures what comes from beyond is subtracted, as these causes predict it.

    That part is the difference of whole predictions and the middle's, so that residuals at these causes are those of
    whole pictures. Other causes make another difference: what is left of it counts as noise, as large a part of it as
    the present error is of the light. Captures that no search uses stay as they are.
    """
    used = np.array(sorted(middle.split.used))
    beyond = context.run_parallel([partial(_light_from_beyond, context, middle, np.array([k]), values) for k in used])
    light = middle.data.light.copy()
    light[used] -= np.stack(beyond)
    corrected = replace(middle, data=replace(middle.data, light=light), missing_light=None)
    error = min(1.0, corrected.relative_model_error(values, corrected.split.held_out))
    missing = np.zeros(len(light)) if middle.missing_light is None else middle.missing_light
    share = np.ones(len(light))
    share[used] = error
    return replace(corrected, missing_light=share * missing)


def _light_from_beyond(
    context: SearchContext, middle: SearchContext, index: NDArray[np.intp], values: FittedValues
) -> Images:
    """Counts (y, x) in the middle of one picture that its own modulators' pixels don't explain."""
    gain = context.data_weighted_comparison(index, 0.0).fit_gains(values).gain[0]
    seen, cut = _seen_and_cut(context, middle, index, values)
    return np.asarray(gain * (seen - cut), dtype=np.float32)


def with_fitting_stops(context: SearchContext, weighted: PerThreadPredictor, values: FittedValues) -> SearchContext:
    """Whole pictures, predicted with the stops that fit better at these causes: sharp or weighted (`make_plan`).

    weighted: predicts with weighted stops. Where these fit better, a share of the difference between the two counts as
    noise: weighted stops on a grid aren't exact either.
    """
    known = _smooth_to_rough(context, _STOP_CAPTURES)
    jobs = [partial(_compare_stops, context, weighted, np.array([k]), values) for k in known]
    sharp, soft, difference = np.array(context.run_parallel(jobs)).T
    if soft.sum() >= sharp.sum():
        return context
    errors = _of_next_rougher(context, known, _STOP_ERROR * difference)
    missing = errors if context.missing_light is None else np.maximum(errors, context.missing_light)
    return replace(context, predictor=weighted, missing_light=missing)


def _compare_stops(
    context: SearchContext, weighted: PerThreadPredictor, index: NDArray[np.intp], values: FittedValues
) -> tuple[float, float, float]:
    """χ²/n of a capture with sharp and with weighted stops, and the difference of the two predictions."""
    comparison = context.model_weighted_comparison(index, values)
    others = comparison.with_predictor(weighted)
    pictures = [np.asarray(one.predictor(index, values).signal)[0] for one in (comparison, others)]
    return comparison.chi2_per_pixel(values), others.chi2_per_pixel(values), _difference(pictures[0], pictures[1])


def describe_middle(middle: SearchContext) -> str:
    """A sentence on where causes were searched, without its end."""
    captures = middle.data.captures
    of, shape = ("camera", captures.shape) if captures.is_fourier else ("modulator", captures.levels.shape[2:])
    return f"Causes were searched in the middle of the pictures, {shape[1]} × {shape[0]} {of} pixels"


def middle_captures(captures: Captures, config: RegionConfig, further_speckles: int = 0) -> Captures:
    """The middle of captures, however little it saves.

    The more captures there are, the fewer pixels across: in the near field modulator pixels, with a margin for light
    that walks off; on a Fourier bench speckles, with `further_speckles` on either side.
    """
    enough = math.ceil(math.sqrt(_ALL_PX / len(captures)))
    side = min(config.side_px, max(_MIN_SIDE_PX, enough))
    return central_region(captures, side, further_speckles if captures.is_fourier else config.further_px)


def pixel_ratio(whole: Captures, cut: Captures) -> float:
    """Pixels of the modulator over those of its middle; on a Fourier bench of the camera."""
    parts = (whole.images, cut.images) if whole.is_fourier else (whole.levels, cut.levels)
    return parts[0].size / parts[1].size


_STEP = 0.95  # between two sizes that are tried
_COMPLEX64 = 8  # bytes


def within_limits(captures: Captures, sampling: SamplingConfig, config: RegionConfig) -> tuple[Captures, list[str]]:
    """The captures, or their middle if whole pictures are beyond the limits of `config`; with a note on the cut.

    Raises UserError, with the numbers, where even the smallest middle that a search works with is too large.
    """
    cut, side_px = captures, float(max(captures.levels.shape[2:]))
    if captures.is_fourier:
        side_px = max(n / px for n, px in zip(captures.shape, speckle_px(captures), strict=True))
    while math.prod(cut.shape) > config.max_picture_pixels or grid_samples(cut, sampling) > config.max_grid_samples:
        side_px *= _STEP
        if side_px < config.side_px:
            rows, columns = cut.levels.shape[2:]
            needed, most = (n * _COMPLEX64 / 1e9 for n in (grid_samples(cut, sampling), config.max_grid_samples))
            raise UserError(
                "captures",
                f"a light field takes {needed:.2g} GB of memory, even with {columns} x {rows} pixels of each "
                "modulator, of which light walks off to the camera's middle",
                expected=f"at most {most:.2g} GB",
                remedy="bin the camera's pixels, or take planes nearer to the modulators",
            )
        cut = central_region(captures, math.floor(side_px))
    if cut is captures:
        return captures, []
    shapes = "{1} × {0} of {3} × {2} camera pixels".format(*cut.shape, *captures.shape)
    gigabytes = grid_samples(captures, sampling) * _COMPLEX64 / 1e9
    pixels = math.prod(captures.shape) / 1e6
    note = (
        f"Only the middle of the pictures was diagnosed, {shapes}: whole ones have {pixels:.3g} million pixels, and a "
        f"light field takes {gigabytes:.2g} GB of memory; up to {config.max_picture_pixels / 1e6:.3g} million and "
        f"{config.max_grid_samples * _COMPLEX64 / 1e9:.2g} GB are taken whole."
    )
    return cut.with_pictures(np.copy), [note]


def grid_samples(captures: Captures, sampling: SamplingConfig) -> int:
    """Samples of the largest grid on which light fields are computed."""
    rows, columns = captures.levels.shape[2:]
    if captures.is_fourier:
        seen_rows, seen_columns = captures.shape
        return max(columns * (rows + seen_rows), seen_rows * (columns + seen_columns))
    return sampling.padded_samples(captures)
