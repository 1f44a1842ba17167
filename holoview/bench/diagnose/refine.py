"""Joint fits of several causes, and the best candidates polished near the noise floor.

refine_fit          all causes of a candidate, with weights that tolerate errors of the model, then with the noise's
free_fine_parameters, refine_leaders_along_axes
                    the best candidates polished, where they are near the floor
fit_to_the_end      the best candidates fitted until nothing is gained. A search stops once a candidate is near enough
                    to the floor to be named. Its values may still be outside their intervals, though it predicts
                    held-out captures to the noise: along the valley of two parameters that do nearly the same, least
                    squares take many steps, and jumps of irises on a grid end them early
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from holoview.bench.diagnose.fit import (
    EDGE_EVALUATIONS,
    FINAL_TOLERANCE,
    CandidateFit,
    cost_or_inf,
    drop_negligible_values,
    local_fit,
    refine_hard_edges,
    refit,
    refit_with_longer_steps,
    search_along_axes,
    search_within_steps,
)
from holoview.bench.diagnose.judge import (
    FLOOR_CHI2,
    JITTER_CHI2,
    NEAR_CHI2,
    RIVAL_EXCESS,
    RIVAL_FACTOR,
    HeldOutScore,
    SearchResult,
    chance_excess,
    rank_on_held_out,
    score_on_held_out,
)
from holoview.bench.diagnose.screening import COSTLY_FIELDS, is_very_costly, prediction_cost, usual_budget
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.effects.effect import Effect

FINAL_ITERATIONS = 5  # [1] Iterations of the last joint fit.
_LAST_ITERATIONS = 20
"""[1] Iterations of the last fit of a candidate near the floor. Evidence: measured: before it, the two parameters of
crosstalk were 11 and 21 % off with χ²/n 1.0196; after it 0.01 and 0.02 %, and 0.9935."""
_LAST_GAIN = 0.1
"""[Δχ²] The last fit ends after an iteration that gains less. Evidence: derivation: a standard deviation costs 1.
Crosstalk that fitted held-out captures to the noise was 450 from the least in the rougher captures, and outside its
interval."""
TOLERANT_MIN_ERROR = 0.02
"""[error] Below it no tolerant fit precedes the fit with weights of the noise; paired with `_NEAR_ERROR`."""
FAR_ERROR = 0.15
"""[error] A tolerant fit that leaves more isn't refined. Evidence: weights of the noise lead nowhere there."""
_TOLERANT_ROUNDS = 6
"""[1] Tolerant fits one after another, while the last leaves a large error. Evidence: measured: two aberrations of
0.35 µm left 0.18 of the light after one, 0.019 after two. Of 12 draws with three of 0.4 µm, 6 ended at them from a
fifth of their values, 9 from a third, and of 20 all from half."""
_TOLERANT_GAIN = 0.95
"""[1] A further tolerant fit follows only if the last lowered the error below this share. Evidence: measured: causes
that were wrong left 0.99 or more."""
_EDGES_ERROR_SHARE = 0.5
"""[1] Hard edges are searched in a tolerant fit that leaves less than this share of the nominal model's error.
Evidence: a reason: it takes up to 200 predictions of each capture. Measured: an iris beside a tilt left 0.2."""
_BETTER_COST = 0.95  # [1] The same causes are refined again from values that cost less than this share.
_AXIS_CANDIDATES = 2  # [candidates] Searched along their axes.
_AXIS_ROUNDS = 2  # [1] Rounds of that.
_AXIS_GAIN_SHARE = 0.9
"""[1] The second round along the axes follows if the first left less than this share of the excess. Evidence: a round
for two causes takes a tenth of a minute."""
_LAST_FITS = 3
"""[candidates] Fitted to the end at most, where they are near the floor. Evidence: the cost; the best and two
rivals."""
_NEAR_ERROR_SHARE = 0.2
"""[1] A candidate is polished if its error is below this share of the nominal model's. Evidence: a candidate that stays
far off lacks a cause, with which other values would be best."""
_NEAR_ERROR = 0.02  # [error] A candidate below this error is polished too; paired with `TOLERANT_MIN_ERROR`.
_MAX_NEAR_ERROR = 0.1
"""[error] The error of the nominal model counts at most as this much for `_NEAR_ERROR_SHARE`. Evidence: of pairs with
errors above 1, searches along the axes of the first cause, which left an error of 0.2, took a third of the time and
gained nothing."""
_EXPLAINS_NOTHING_SHARE = 0.9  # [1] Candidates that leave more than this share of the nominal excess aren't polished.
_SETTLED_EXCESS = 0.1
"""[χ²/n] No further stage of the screening, and no further base, if the best excess is below this. Evidence: scans of
ranges bring nothing so close."""
SETTLED_SHARE = 0.05
"""[1] The best excess must also be below this share of the nominal excess; a further cause that leaves less than this
share of its base's excess ends a screening."""
_FINE_CANDIDATES = 3
"""[candidates] Whose secondary parameters are freed at most. Evidence: a drawn Fourier bench: a wavefront with coma was
second by its first three numbers, behind a map of strokes."""
_MAX_FINE_EXCESS_SHARE = 0.9  # [1] Fine parameters stay free if they leave less than this share of the excess.
_MAX_FAR_FINE_EXCESS_SHARE = 0.5
"""[1] The same far from the floor. Evidence: a reason: there many numbers lower the excess whatever is wrong; what
takes half of it does more than a further cause usually does."""


def refine_fit(context: SearchContext, fit: CandidateFit, *, include_fine: bool = False) -> CandidateFit:
    """A joint fit of all causes on the fine captures; with tolerant weights alone where that leaves a large error.

    It isn't worse on the coarse captures than its starting values, unless both leave a small error there.
    """
    effects = [context.effects[name] for name in fit.causes]
    if (error := context.relative_model_error(fit.values)) > TOLERANT_MIN_ERROR:
        fit, error = _fit_tolerantly(context, effects, fit, error, include_fine)
        if error > FAR_ERROR:
            return fit
    comparison = context.model_weighted_comparison(context.split.fine, fit.values)
    refined = local_fit(
        effects,
        fit.values,
        comparison,
        iterations=FINAL_ITERATIONS,
        tolerance=FINAL_TOLERANCE,
        include_fine=include_fine,
    )
    is_affordable = EDGE_EVALUATIONS * len(context.split.fine) <= usual_budget(context)
    edges = [refine_hard_edges] if is_affordable and len(context.windows) <= 1 else []  # else the middle has found them
    for improve in (refit_with_longer_steps, search_within_steps, *edges, drop_negligible_values):
        refined = improve(effects, refined, comparison)
    if error > TOLERANT_MIN_ERROR and context.relative_model_error(refined.values) > error:
        return fit
    return refined


def _fit_tolerantly(
    context: SearchContext, effects: Sequence[Effect], fit: CandidateFit, error: float, include_fine: bool
) -> tuple[CandidateFit, float]:
    """A fit that tolerates a share of the present error, and the error that it leaves; repeated while that is large.

    Each repetition tolerates less, so that a large fault is reached from further away than by one fit. Rough captures
    can lead astray where another cause is missing: a fit with a larger error than before isn't taken. Where least
    squares end far off, though much of the error is explained, hard edges are searched exactly.
    """
    edges_limit = _EDGES_ERROR_SHARE * context.relative_model_error({})
    for _ in range(_TOLERANT_ROUNDS):
        comparison = context.half_tolerant_comparison(context.split.fine, error)
        fitted = local_fit(effects, fit.values, comparison, include_fine=include_fine)
        before, left = error, context.relative_model_error(fitted.values)
        if _TOLERANT_GAIN * before < left and FAR_ERROR < before < edges_limit:
            fitted = refine_hard_edges(effects, fit, comparison)
            left = context.relative_model_error(fitted.values)
        if left < before:
            fit, error = fitted, left
        if error <= FAR_ERROR or left > _TOLERANT_GAIN * before:
            break
    return fit, error


def refine_along_axes(context: SearchContext, fit: CandidateFit) -> CandidateFit:
    """A refined fit on rougher captures, which show smaller errors: fitted, then searched along its axes."""
    effects = [context.effects[name] for name in fit.causes]
    comparison = context.model_weighted_comparison(context.split.rough, fit.values)
    refitted = refit(effects, fit.values, comparison)
    best = min(replace(fit, cost=cost_or_inf(comparison, fit.values)), refitted, key=lambda f: f.cost)
    return search_along_axes(effects, best, comparison)


class RefinementQueue:
    """The fits refined so far. The same causes are refined again only from values that cost clearly less."""

    def __init__(self, context: SearchContext) -> None:
        self.fits: list[CandidateFit] = []
        self._context, self._start_costs = context, dict[tuple[str, ...], float]()

    def refine_new(self, fits: Sequence[CandidateFit]) -> bool:
        """Refines the new fits; returns whether there were any."""
        better = _BETTER_COST
        fresh = [f for f in fits if f.cost < better * self._start_costs.get(f.causes, np.inf)]
        self._start_costs |= {f.causes: f.cost for f in fresh}
        self.fits += self._context.run_parallel([partial(refine_fit, self._context, f) for f in fresh])
        return bool(fresh)


def free_fine_parameters(context: SearchContext, result: SearchResult, *, also_costly: bool = True) -> SearchResult:
    """The result with secondary parameters freed of the best candidate, and of others that come about as close, if it
    isn't at the floor and if these parameters lower the excess: by much, where a candidate isn't near the floor.
    also_costly: free them as well in candidates that are costly, or have large fields, and aren't very near the floor.
    """
    limit = RIVAL_FACTOR * result.best.excess
    leaders = [
        c
        for c in result.candidates[:_FINE_CANDIDATES]
        if c.excess <= limit
        and any(p.secondary for name in c.causes for p in context.effects[name].parameters)
        and (also_costly or _is_affordable(context, c))
    ]
    if explains_everything(result) or not leaders:
        return result
    freed = context.run_parallel([partial(refine_fit, context, c.fit, include_fine=True) for c in leaders])
    better = dict[tuple[str, ...], CandidateFit]()
    for fit, before in zip(freed, leaders, strict=True):
        score = score_on_held_out(fit, result.comparison, result.tolerant_comparison)
        gained = (before.chi2_per_pixel - score.chi2_per_pixel) * result.pixel_count
        share = _MAX_FINE_EXCESS_SHARE if _is_near(context, before.fit) else _MAX_FAR_FINE_EXCESS_SHARE
        left, left_before = (one.excess - context.left_by_samples for one in (score, before))
        if gained >= context.config.verdict.min_delta_chi2 and left <= share * left_before:
            better[before.causes] = fit
    fits = [better.get(c.causes, c.fit) for c in result.candidates]
    return rank_on_held_out(context, fits) if better else result


def refine_leaders_along_axes(
    context: SearchContext, result: SearchResult, *, also_costly: bool = True
) -> SearchResult:
    """The best candidates searched along their axes, where they are near the floor but not at it.

    A candidate that is far off lacks a cause, with which other values of its present causes would be best. also_costly:
    search candidates as well that are costly, or have large fields, and are somewhat further from the floor.
    """
    for _ in range(_AXIS_ROUNDS):
        if result.best.chi2_per_pixel < FLOOR_CHI2:
            break
        max_excess = _EXPLAINS_NOTHING_SHARE * result.nominal.excess
        helpful = [
            c.fit
            for c in result.candidates[:_AXIS_CANDIDATES]
            if c.excess < max_excess and (also_costly or _is_affordable(context, c))
        ]
        leaders = [f for f in helpful if not is_very_costly(context, f) and _is_near(context, f)]
        if not leaders:
            break
        refined = context.run_parallel([partial(refine_along_axes, context, f) for f in leaders])
        better = [new for new, old in zip(refined, leaders, strict=True) if new.values != old.values]
        if not better:
            break
        before = result.best.excess
        result = rank_on_held_out(context, [*better, *(c.fit for c in result.candidates)])
        if result.best.excess > _AXIS_GAIN_SHARE * before:
            break
    return result


def _is_affordable(context: SearchContext, score: HeldOutScore) -> bool:
    """Whether a candidate is very near the floor, or its fits take little time."""
    return score.chi2_per_pixel < NEAR_CHI2 or prediction_cost(context, score.fit.values) < COSTLY_FIELDS


def _is_near(context: SearchContext, fit: CandidateFit) -> bool:
    """Whether a fit leaves a small error, or a small part of the nominal bench's error."""
    limit = min(_NEAR_ERROR_SHARE * context.relative_model_error({}), _MAX_NEAR_ERROR)
    return context.relative_model_error(fit.values) < max(_NEAR_ERROR, limit)


def explains_everything(result: SearchResult) -> bool:
    """Whether the best candidate leaves no more than jitter."""
    return result.best.chi2_per_pixel < JITTER_CHI2


def is_settled(result: SearchResult) -> bool:
    """Whether so little excess is left that other causes can't leave much less."""
    return result.best.excess < min(_SETTLED_EXCESS, SETTLED_SHARE * result.nominal.excess)


def is_at_floor(result: SearchResult) -> bool:
    """Whether so little excess is left that no further cause is searched."""
    return result.best.chi2_per_pixel < FLOOR_CHI2


def fit_to_the_end(context: SearchContext, result: SearchResult) -> SearchResult:
    """The result with its best candidate fitted to the end, if it is near the floor.

    Unless it is at the floor, candidates that come about as close are fitted too, so that no rival loses for want of a
    fit. The last fit counts even where an earlier fit predicts the held-out captures better by chance.
    """
    excess, config = result.best.excess, context.config
    if not result.candidates or excess > config.verdict.explained_excess or context.budget_exhausted:
        return result
    limit = RIVAL_FACTOR * max(excess, RIVAL_EXCESS)
    count = 1 if excess < chance_excess(result.pixel_count) else _LAST_FITS
    close = [c for c in result.candidates[:count] if c.excess < limit and not is_very_costly(context, c.fit)]
    last = context.run_parallel([partial(_fitted_to_the_end, context, c.fit) for c in close])
    tolerance = config.verdict.min_delta_chi2 * max(1.0, result.best.chi2_per_pixel) / result.pixel_count
    better = [
        fit
        for fit, c in zip(last, close, strict=True)
        if result.comparison.chi2_per_pixel(fit.values) < c.chi2_per_pixel + tolerance
    ]
    replaced = {frozenset(fit.causes) for fit in better}
    others = [c.fit for c in result.candidates if frozenset(c.causes) not in replaced]
    return rank_on_held_out(context, [*better, *others]) if better else result


def _fitted_to_the_end(context: SearchContext, fit: CandidateFit) -> CandidateFit:
    """A fit of all causes on the rougher captures, by least squares, within their steps and then along its axes."""
    comparison = context.model_weighted_comparison(context.split.rough, fit.values)
    effects = [context.effects[name] for name in fit.causes]
    iterations, tolerance = _LAST_ITERATIONS, _LAST_GAIN / comparison.pixel_count
    fitted = local_fit(effects, fit.values, comparison, iterations=iterations, tolerance=tolerance)
    fitted = search_within_steps(effects, fitted, comparison, iterations=iterations, tolerance=tolerance)
    return replace(search_along_axes(effects, fitted, comparison), is_final=True)
