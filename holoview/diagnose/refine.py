"""Joint fits of the causes of a trial: forgiving weights first, then the noise alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from holoview.diagnose.effect_fit import (
    CandidateFit,
    cost_or_inf,
    drop_negligible_values,
    local_fit,
    refine_hard_edges,
    refit_with_longer_steps,
    search_along_axes,
)
from holoview.diagnose.screening import relative_model_error
from holoview.diagnose.search_context import SearchContext

_FAR = 0.15  # r.m.s. residual over mean light; beyond, weights of the noise alone lead nowhere
_BETTER = 0.95  # cost that is worth refining the same causes again


def refine_fit(context: SearchContext, fit: CandidateFit, *, include_fine: bool = False) -> CandidateFit:
    """A joint fit of all causes of a trial on the fine captures: forgiving weights first, then the noise alone."""
    effects = [context.effects[name] for name in fit.causes]
    indices = context.split.fine
    off_by = relative_model_error(context, fit.values)
    values = fit.values
    if off_by > 0.02:
        forgiving = context.data_weighted_comparison(indices, min(0.5, 0.5 * off_by))
        found = local_fit(effects, values, forgiving, include_fine=include_fine)
        values = found.values
        if relative_model_error(context, values) > _FAR:
            return found
    comparison = context.model_weighted_comparison(indices, values)
    found = local_fit(effects, values, comparison, iterations=5, tolerance=1e-4, include_fine=include_fine)
    for improved in (refit_with_longer_steps, refine_hard_edges, drop_negligible_values):
        found = improved(effects, found, comparison)
    return found


def refine_along_axes(context: SearchContext, fit: CandidateFit) -> CandidateFit:
    """A refined trial on rougher captures, which show what is left: fitted, and looked for along its axes."""
    effects = [context.effects[name] for name in fit.causes]
    comparison = context.model_weighted_comparison(context.split.rough, fit.values)
    fitted = local_fit(effects, fit.values, comparison, iterations=3, tolerance=1e-4)
    best = min(replace(fit, cost=cost_or_inf(comparison, fit.values)), fitted, key=lambda t: t.cost)
    return search_along_axes(effects, best, comparison)


class RefinementQueue:
    """What was refined so far. Nothing is refined twice unless a later stage of the screen found better values."""

    def __init__(self, context: SearchContext) -> None:
        self.fits: list[CandidateFit] = []
        self._bench, self._start_costs = context, dict[tuple[str, ...], float]()

    def refine_new(self, fits: Sequence[CandidateFit]) -> bool:
        """Refines what is new of these; whether there was something."""
        fresh = [t for t in fits if t.cost < _BETTER * self._start_costs.get(t.causes, np.inf)]
        self._start_costs |= {t.causes: t.cost for t in fresh}
        self.fits += self._bench.run_parallel([partial(refine_fit, self._bench, t) for t in fresh])
        return bool(fresh)
