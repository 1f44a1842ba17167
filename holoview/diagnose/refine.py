"""Joint fits of several causes, and the best candidates polished near the noise floor.

refine_fit          all causes of a candidate, with weights that tolerate errors of the model, then with the noise's
free_fine_parameters, refine_leaders_along_axes
                    the best candidates polished, where they are near the floor
fit_to_the_end      the best ones fitted until nothing is gained. A search stops once a candidate is near enough to the
                    floor to be named. Its values may still be outside their intervals: along the valley of two
                    parameters that do nearly the same, least squares take many steps, and jumps of irises on a grid
                    end them early
prefer_fewer_numbers the simplest name: of effects that no data can tell apart, the one with fewer numbers. A wrong gap
                    is a defocus of relay 1, one of the aberrations that it may have: gap states it by one number,
                    aberration1 by many. A search may come to either first, alone or together with other causes. A
                    second line that has most of the light isn't an offset of the wavelength, but comes so near that a
                    search may not look further
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from holoview.diagnose.fit import (
    CandidateFit,
    FittedValues,
    cost_or_inf,
    drop_negligible_values,
    local_fit,
    number_count,
    refine_hard_edges,
    refit,
    refit_with_longer_steps,
    search_along_axes,
)
from holoview.diagnose.judge import (
    Decision,
    HeldOutScore,
    SearchResult,
    chance_excess,
    rank_on_held_out,
    score_on_held_out,
)
from holoview.diagnose.screening import fit_over_range, is_slow, is_very_costly
from holoview.diagnose.search_context import SearchContext
from holoview.model.effects.effect import Effect


def refine_fit(context: SearchContext, fit: CandidateFit, *, include_fine: bool = False) -> CandidateFit:
    """A joint fit of all causes on the fine captures; with tolerant weights alone where that leaves a large error.

    It isn't worse on the coarse captures than the fit that it began with, unless both leave a small error there.
    """
    config = context.config.fits
    effects = [context.effects[name] for name in fit.causes]
    if (error := context.relative_model_error(fit.values)) > config.tolerant_min_error:
        fit, error = _fit_tolerantly(context, effects, fit, error, include_fine)
        if error > config.far_error:
            return fit
    comparison = context.model_weighted_comparison(context.split.fine, fit.values)
    refined = local_fit(
        effects,
        fit.values,
        comparison,
        config,
        iterations=config.final_iterations,
        tolerance=config.final_tolerance,
        include_fine=include_fine,
    )
    for improve in (refit_with_longer_steps, refine_hard_edges, drop_negligible_values):
        refined = improve(effects, refined, comparison, config)
    if error > config.tolerant_min_error and context.relative_model_error(refined.values) > error:
        return fit
    return refined


def _fit_tolerantly(
    context: SearchContext, effects: Sequence[Effect], fit: CandidateFit, error: float, include_fine: bool
) -> tuple[CandidateFit, float]:
    """A fit that tolerates a share of the present error, and the error that it leaves; repeated while that is large.

    Each repetition tolerates less, so that a large fault is approached from further away than one fit comes from.
    Rough captures can lead astray where another cause is missing; a fit that leaves more than before isn't taken.
    """
    config = context.config.fits
    for _ in range(config.tolerant_rounds):
        comparison = context.half_tolerant_comparison(context.split.fine, error)
        fitted = local_fit(effects, fit.values, comparison, config, include_fine=include_fine)
        before, left = error, context.relative_model_error(fitted.values)
        if left < before:
            fit, error = fitted, left
        if error <= config.far_error or left > config.tolerant_gain * before:
            break
    return fit, error


def refine_along_axes(context: SearchContext, fit: CandidateFit) -> CandidateFit:
    """A refined fit on rougher captures, which show smaller errors: fitted, then searched along its axes."""
    config = context.config.fits
    effects = [context.effects[name] for name in fit.causes]
    comparison = context.model_weighted_comparison(context.split.rough, fit.values)
    refitted = refit(effects, fit.values, comparison, config)
    best = min(replace(fit, cost=cost_or_inf(comparison, fit.values)), refitted, key=lambda f: f.cost)
    return search_along_axes(effects, best, comparison, config)


class RefinementQueue:
    """The fits refined so far. The same causes are refined again only from values that cost clearly less."""

    def __init__(self, context: SearchContext) -> None:
        self.fits: list[CandidateFit] = []
        self._context, self._start_costs = context, dict[tuple[str, ...], float]()

    def refine_new(self, fits: Sequence[CandidateFit]) -> bool:
        """Refines those that are new; whether there were any."""
        better = self._context.config.fits.better_cost
        fresh = [f for f in fits if f.cost < better * self._start_costs.get(f.causes, np.inf)]
        self._start_costs |= {f.causes: f.cost for f in fresh}
        self.fits += self._context.run_parallel([partial(refine_fit, self._context, f) for f in fresh])
        return bool(fresh)


def free_fine_parameters(context: SearchContext, result: SearchResult, *, is_costly_far: bool = True) -> SearchResult:
    """The best candidate with its fine parameters freed, where it is near but not at the floor, and they help.

    is_costly_far: also of a costly one, or of large fields, that isn't quite near.
    """
    best = result.best
    effects = [context.effects[name] for name in best.causes]
    has_fine = any(p.secondary for e in effects for p in e.parameters)
    if explains_everything(context, result) or not has_fine or not _is_near(context, best.fit):
        return result
    if not (is_costly_far or _is_affordable(context, best)):
        return result
    freed = refine_fit(context, best.fit, include_fine=True)
    score = score_on_held_out(freed, result.comparison, result.tolerant_comparison)
    gained = (best.chi2_per_pixel - score.chi2_per_pixel) * result.pixel_count
    max_excess = context.config.selection.max_fine_excess_share * best.excess
    if gained < context.config.verdict.min_delta_chi2 or score.excess > max_excess:
        return result
    return rank_on_held_out(context, [freed, *(c.fit for c in result.candidates[1:])])


def refine_leaders_along_axes(
    context: SearchContext, result: SearchResult, *, is_costly_far: bool = True
) -> SearchResult:
    """The best candidates searched along their axes, where they are near the floor but not at it.

    What is far off lacks a cause: with it, other values of the causes that it has would be best. is_costly_far: also
    costly ones, and those of large fields, that aren't quite near.
    """
    config = context.config.selection
    for _ in range(config.axis_rounds):
        if result.best.chi2_per_pixel < config.floor_chi2:
            break
        max_excess = config.explains_nothing_share * result.nominal.excess
        helpful = [
            c.fit
            for c in result.candidates[: config.axis_candidates]
            if c.excess < max_excess and (is_costly_far or _is_affordable(context, c))
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
        if result.best.excess > config.axis_gain_share * before:
            break
    return result


def _is_affordable(context: SearchContext, score: HeldOutScore) -> bool:
    """Whether a candidate is quite near the floor, or takes little time."""
    return score.chi2_per_pixel < context.config.ranking.near_chi2 or not is_slow(context, score.fit)


def _is_near(context: SearchContext, fit: CandidateFit) -> bool:
    """Whether a fit leaves a small error, or a small part of the nominal bench's error."""
    config = context.config.selection
    limit = min(config.near_error_share * context.relative_model_error({}), config.max_near_error)
    return context.relative_model_error(fit.values) < max(config.near_error, limit)


def explains_everything(context: SearchContext, result: SearchResult) -> bool:
    """Whether the best candidate leaves no more than jitter."""
    return result.best.chi2_per_pixel < context.config.verdict.jitter_chi2


def is_settled(context: SearchContext, result: SearchResult) -> bool:
    """Whether so little is left that other causes can't leave much less."""
    config = context.config.selection
    return result.best.excess < min(config.settled_excess, config.settled_share * result.nominal.excess)


def is_at_floor(context: SearchContext, result: SearchResult) -> bool:
    """Whether so little is left that no further cause is searched."""
    return result.best.chi2_per_pixel < context.config.selection.floor_chi2


def fit_to_the_end(context: SearchContext, result: SearchResult) -> SearchResult:
    """The result with its best candidates fitted to the end, if they are near the floor but not at it.

    Candidates that come about as close to the floor are fitted too, so that no rival loses for want of a fit.
    """
    excess, config = result.best.excess, context.config
    is_near = chance_excess(result.pixel_count, config.verdict) < excess < config.verdict.explained_excess
    if not (result.candidates and is_near) or context.budget_exhausted:
        return result
    limit = config.verdict.rival_factor * max(excess, config.verdict.rival_excess)
    close = [c.fit for c in result.candidates[: config.selection.last_fits] if c.excess < limit]
    jobs = [partial(_fitted_to_the_end, context, fit) for fit in close if not is_very_costly(context, fit)]
    if not jobs:
        return result
    return rank_on_held_out(context, [*context.run_parallel(jobs), *(c.fit for c in result.candidates)])


def _fitted_to_the_end(context: SearchContext, fit: CandidateFit) -> CandidateFit:
    """A fit of all causes on the rougher captures, by least squares and then along its axes."""
    config, comparison = context.config.fits, context.model_weighted_comparison(context.split.rough, fit.values)
    effects = [context.effects[name] for name in fit.causes]
    fitted = local_fit(
        effects,
        fit.values,
        comparison,
        config,
        iterations=config.last_iterations,
        tolerance=config.last_tolerance,
    )
    return search_along_axes(effects, fitted, comparison, config)


def prefer_fewer_numbers(context: SearchContext, result: SearchResult) -> SearchResult:
    """The result with fits in which a cause of the best candidate is replaced by an equal, or a like, of fewer numbers.

    Ranked with the others, such a fit comes first if it explains the held-out captures as well.
    """
    best = result.best
    jobs = [
        partial(_fit_over_range, context, best.fit.without(cause).values, simple, _first_values(result, simple))
        for cause in best.causes
        for simple in sorted(_simpler_names(context, cause))
        if simple not in best.causes
    ]
    if not jobs:
        return result
    return rank_on_held_out(context, [*context.run_parallel(jobs), *(c.fit for c in result.candidates)])


def wider_names(context: SearchContext, decision: Decision) -> list[tuple[str, ...]]:
    """The causes that are named, with one of them replaced by an equal of more numbers, which contains it."""
    causes = decision.best.causes if decision.best else ()
    return [
        tuple(wide if name == cause else name for name in causes)
        for cause in causes
        for wide in sorted(context.equivalents.get(cause, ()))
        if number_count(context.effects[wide]) > number_count(context.effects[cause])
    ]


def _simpler_names(context: SearchContext, cause: str) -> set[str]:
    """Effects of fewer numbers that are the same physics as a cause, or that the cause imitates."""
    names = {*context.equivalents.get(cause, ()), *context.effects[cause].degenerate_limit} & context.effects.keys()
    return {name for name in names if number_count(context.effects[name]) < number_count(context.effects[cause])}


def _first_values(result: SearchResult, name: str) -> list[dict[str, float]]:
    """The values of an effect in the best candidate that has it."""
    return [c.fit.values[name] for c in result.candidates if name in c.fit.values][:1]


def _fit_over_range(
    context: SearchContext, base: FittedValues, name: str, starts: list[dict[str, float]]
) -> CandidateFit:
    """An effect on top of a base: over its range and from other starts, then all causes together."""
    return refine_fit(context, fit_over_range(context, base, context.effects[name], starts))
