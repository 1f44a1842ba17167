"""Known effects that were measured: their errors are fitted before causes are searched, within their uncertainties.

An alignment finds planes to a few µm; captures show a tenth of that. Without correction such errors look like causes;
fitted to the nominal bench alone, they absorb a part of a fault. So they are fitted beside the nominal bench and beside
each of the best single causes, with the uncertainties as a Gaussian prior. The fit that predicts held-out captures best
counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import takewhile

import numpy as np

from holoview.bench.diagnose.fit import (
    FINAL_TOLERANCE,
    CandidateFit,
    FittedValues,
    FreeParameters,
    free_parameters_of,
    has_list,
    residual_function,
)
from holoview.bench.diagnose.intervals import format_number
from holoview.bench.diagnose.judge import (
    NOMINAL_FIT,
    SearchResult,
    first_per_cause_set,
    jitter_excess,
    rank_on_held_out,
)
from holoview.bench.diagnose.likelihood import Values
from holoview.bench.diagnose.power_law import changes_only_power
from holoview.bench.diagnose.refine import FINAL_ITERATIONS, TOLERANT_MIN_ERROR
from holoview.bench.diagnose.screening import screen_effects, without_costly_fits
from holoview.bench.diagnose.search import MAX_FURTHER_EXCESS_SHARE
from holoview.bench.diagnose.search_context import SearchContext, SearchEnded
from holoview.light.numerics.minimise import ResidualFunction, ResidualVector, Vector, levenberg_marquardt
from holoview.util.progress import ProgressCallback

_BASES = 3  # [fits] Single causes beside which the errors are fitted, at most.
_AS_GOOD_COST = 1.5
"""[1] Cost of such a cause over the best cause's, at most. Evidence: on the virtual rig, stroke and stroke_map within
1.02, the next cause 1.9."""
MAX_DEVIATIONS = 3.0
"""[σ of the alignment] A larger correction is no error of the measurement, but a cause to be named. Evidence: one
normal deviate in 400 is larger."""
_LEAST_SHARE = 0.01
"""[1] Of the excess χ²/n that causes leave, by how much more is left at most without what isn't uncertain in them.
Evidence: a reason: as for causes that do nothing."""
_LISTED = 3  # [corrections] Named in the note. Evidence: none needed: the others are in the JSON.

Uncertainties = Mapping[str, Mapping[str, float]]
"""{effect id: {parameter: standard deviation}}, SI units."""


def known_corrections(
    context: SearchContext, uncertain: Uncertainties, progress: ProgressCallback
) -> FittedValues | None:
    """The corrections of known effects, {effect: {parameter: value}}; empty where no capture asks for a correction.

    context: with the known effects in its nominal bench. None where the context's time was over before.
    """
    placed = {name: own for name, own in uncertain.items() if name in context.effects}
    try:
        with _ended_in_time(context):
            nothing = rank_on_held_out(context, [])
            if not placed or nothing.best.excess < jitter_excess(nothing.pixel_count):
                return {}
            fits = [_fit_beside(context, NOMINAL_FIT, placed)]
            ranked = rank_on_held_out(context, fits)
            if ranked.best.excess > jitter_excess(ranked.pixel_count):
                bases = _single_causes(context, placed, progress)
                fits += context.run_parallel([partial(_fit_beside, context, base, placed) for base in bases])
                ranked = rank_on_held_out(context, fits)
            best = ranked.best.fit
            if best.causes != fits[0].causes:  # a cause has numbers of its own, which always leave a little less
                alone = next(score for score in ranked.candidates if score.causes == fits[0].causes)
                if ranked.best.excess > MAX_FURTHER_EXCESS_SHARE * alone.excess:
                    best = alone.fit
    except SearchEnded:
        return None
    return _within_uncertainties(best.values, placed)


def corrections_alone(context: SearchContext, uncertain: Uncertainties) -> FittedValues:
    """The errors of known effects, fitted beside the nominal bench alone, whatever they leave: no noise is believed.

    Empty where the context's time was over before.
    """
    placed = {name: own for name, own in uncertain.items() if name in context.effects}
    try:
        with _ended_in_time(context):
            found = _fit_beside(context, NOMINAL_FIT, placed).values
    except SearchEnded:
        return {}
    return _within_uncertainties(found, placed)


def errors_of_estimates(result: SearchResult, uncertain: Uncertainties, known: Values) -> FittedValues | None:
    """The causes of the best candidate that are no more than errors of uncertain numbers, which aren't known effects
    yet; None where there are none. What nobody was uncertain of in such an effect (a rotation) must not matter.
    """
    best, others = result.best.fit.values, {name: own for name, own in uncertain.items() if name not in known}
    found = {
        name: {parameter: value for parameter, value in own.items() if parameter in others[name]}
        for name, own in best.items()
        if name in others
    }
    found = _within_uncertainties(found, others)
    left = result.comparison.chi2_per_pixel({**best, **found}) - result.comparison.chi2_per_pixel(best)
    most = max(jitter_excess(result.pixel_count), _LEAST_SHARE * result.best.excess)
    return found if found and left < most else None


@contextmanager
def _ended_in_time(context: SearchContext) -> Iterator[None]:
    """Predictions end with the context's search meanwhile. Raises SearchEnded then."""
    end, context.predictor.end = context.predictor.end, context.end
    try:
        yield
    finally:
        context.predictor.end = end


def correction_notes(corrections: FittedValues | None, uncertain: Uncertainties) -> tuple[str, ...]:
    """A sentence on the corrections, if there are any, with the largest of them in standard deviations."""
    if corrections is None:
        return ("Known effects stayed as they were measured: the time for their correction was over; give it more.",)
    deviations = {
        (name, parameter): abs(value) / uncertain[name][parameter]
        for name, own in corrections.items()
        for parameter, value in own.items()
    }
    if not deviations:
        return ()
    largest = sorted(deviations, key=lambda one: -deviations[one])[:_LISTED]
    texts = [f"{name}.{p} by {format_number(name, p, corrections[name][p])}" for name, p in largest]
    others = ", others by less" if len(deviations) > _LISTED else ""
    return (f"Known effects were corrected within their uncertainties: {', '.join(texts)}{others}.",)


def _within_uncertainties(values: FittedValues, placed: Uncertainties) -> FittedValues:
    """The fitted values that may be errors of the measurement."""
    return {
        name: own for name, own in values.items() if name in placed and is_within(own, placed[name], MAX_DEVIATIONS)
    }


def _single_causes(context: SearchContext, placed: Uncertainties, progress: ProgressCallback) -> list[CandidateFit]:
    """The best single causes at a first look, but for the same physics as an uncertain effect."""
    alike = {other for name in placed for other in (name, *context.equivalents.get(name, ()))}
    effects = [e for e in context.effects.values() if not (e.id in alike or changes_only_power(e) or has_list(e))]
    queue = screen_effects(context, {}, effects, progress, "known effects")
    first_round = takewhile(lambda batch: not batch.ends_round, queue)
    fits = first_per_cause_set(sorted((fit for batch in first_round for fit in batch.fits), key=lambda f: f.cost))
    unbiased = context.data_weighted_comparison(context.split.coarse, 0.0)
    cheap = without_costly_fits(context, fits, unbiased)[:_BASES]
    return [fit for fit in cheap if fit.cost < _AS_GOOD_COST * cheap[0].cost]


def _fit_beside(context: SearchContext, base: CandidateFit, placed: Uncertainties) -> CandidateFit:
    """A cause and the errors of known effects, fitted together: first tolerant of a remaining error, then twice not,
    because the weights of a wrong black level hold the first of these fits back."""
    indices, values = context.split.fine, dict(base.values)
    causes = (*base.causes, *placed)
    error = context.relative_model_error(values)
    listed = free_parameters_of([context.effects[name] for name in causes], values).entries
    free = FreeParameters(tuple((e, p) for e, p in listed if e not in placed or p.name in placed[e]))
    bounds, cost = free.bounds(), base.cost
    for is_tolerant in (True, False, False) if error > TOLERANT_MIN_ERROR else (False,):
        comparison = (
            context.half_tolerant_comparison(indices, error)
            if is_tolerant
            else context.model_weighted_comparison(indices, values)
        )
        function = _with_prior(residual_function(free, values, comparison), free, placed)
        iterations, tolerance = FINAL_ITERATIONS, FINAL_TOLERANCE
        minimum = levenberg_marquardt(function, free.pack(values), bounds, iterations=iterations, tolerance=tolerance)
        values, cost = free.unpack(minimum.x, values), minimum.cost
    return CandidateFit(causes, values, cost)


def _with_prior(function: ResidualFunction, free: FreeParameters, placed: Uncertainties) -> ResidualFunction:
    """The residuals, followed by the errors of known effects over their standard deviations."""
    prior = np.array([placed[e][p.name] / p.prior if e in placed else np.inf for e, p in free.entries])

    def extended(x: Vector) -> ResidualVector:
        return np.concatenate([function(x).ravel(), ((x - free.identity) / prior).astype(np.float32)])

    return extended


def is_within(values: Mapping[str, float], sigmas: Mapping[str, float], deviations: float) -> bool:
    """Whether all values are within so many standard deviations of zero; without a deviation a value has to be 0."""
    return all(abs(value) <= deviations * sigmas.get(name, 0.0) for name, value in values.items())
