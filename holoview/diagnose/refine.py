"""Joint fits of several causes: first with weights that tolerate errors of the model, then with those of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from holoview.diagnose.effect_fit import CandidateFit, cost_or_inf, local_fit, refit
from holoview.diagnose.fit_improvements import (
    drop_negligible_values,
    refine_hard_edges,
    refit_with_longer_steps,
    search_along_axes,
)
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
