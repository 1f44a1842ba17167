"""The best candidates polished, where they are near the floor; and how near a search has come to it."""

from __future__ import annotations

from functools import partial

from holoview.diagnose.effect_fit import CandidateFit
from holoview.diagnose.field_count import is_slow, is_very_costly
from holoview.diagnose.held_out_ranking import HeldOutScore, SearchResult, rank_on_held_out, score_on_held_out
from holoview.diagnose.refine import refine_along_axes, refine_fit
from holoview.diagnose.search_context import SearchContext


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
