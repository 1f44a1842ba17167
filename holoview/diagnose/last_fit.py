"""The last fit: the best candidates fitted until nothing is gained, where more is left than chance leaves.

A search stops once a candidate is near enough to the floor to be named. Its values may still be outside their
intervals: along the valley of two parameters that do nearly the same, least squares take many steps, and jumps of
irises on a grid end them early.
"""

from __future__ import annotations

from functools import partial

from holoview.diagnose.effect_fit import CandidateFit, local_fit
from holoview.diagnose.field_count import is_very_costly
from holoview.diagnose.fit_improvements import search_along_axes
from holoview.diagnose.held_out_ranking import SearchResult, rank_on_held_out
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.verdict import chance_excess


def fit_to_the_end(context: SearchContext, result: SearchResult) -> SearchResult:
    """The result with its best candidates fitted to the end, if they are near the floor but not at it.

    Candidates that come about as close to the floor are fitted too, so that no rival loses for want of a fit.
    """
    excess, config = result.best.excess, context.config
    is_near = chance_excess(result.pixel_count, config.verdict) < excess < config.verdict.explained_excess
    if not (result.candidates and is_near) or context.budget_exhausted or context.leads is not None:
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
