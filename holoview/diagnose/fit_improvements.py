"""What improves a joint fit that least squares left too early: longer steps, hard edges, axes, fewer parameters.

Each function takes a fit of the effects in a comparison and returns one that costs no more; only
`drop_negligible_values` may return one that costs slightly more, with fewer parameters.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.config import FitConfig
from holoview.diagnose.effect_fit import (
    CandidateFit,
    cost_or_inf,
    hard_edge_mask,
    refit,
    residual_parts,
    residuals_and_start,
)
from holoview.diagnose.free_parameters import free_parameters_of
from holoview.model.effects.effect import Effect
from holoview.numerics.least_squares import axis_scan, levenberg_marquardt, minimise_along_axis
from holoview.numerics.nelder_mead import nelder_mead


def refit_with_longer_steps(
    effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison, config: FitConfig
) -> CandidateFit:
    """Few parameters fitted again with longer difference steps, which see past the jumps of irises on a grid."""
    if len(free_parameters_of(effects, fit.values)) > config.few_parameters:
        return fit
    longer = refit(effects, fit.values, comparison, config, step_factor=config.longer_step_factor)
    return min(fit, longer, key=lambda f: f.cost)


def refine_hard_edges(
    effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison, config: FitConfig
) -> CandidateFit:
    """Hard edges by a large simplex, then all parameters by least squares, then hard edges by a small simplex."""
    free = free_parameters_of(effects, fit.values)
    edges = hard_edge_mask(free)
    if not edges.any():
        return fit
    (function, start), bounds = residuals_and_start(free, fit, comparison), free.bounds(config.steps)
    best = nelder_mead(function, start, bounds, edges, config.first_edge_size, config.edge_evaluations)
    if not edges.all():
        smooth = levenberg_marquardt(
            function,
            best.x,
            bounds,
            iterations=config.edge_iterations,
            tolerance=config.edge_tolerance,
            parts=residual_parts(free, fit.values, comparison),
        )
        best = min(best, smooth, key=lambda m: m.cost)
    best = nelder_mead(function, best, bounds, edges, config.last_edge_size, config.edge_evaluations)
    return CandidateFit(fit.causes, free.unpack(best.x, fit.values), best.cost)


def search_along_axes(
    effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison, config: FitConfig
) -> CandidateFit:
    """While χ² exceeds the noise: a search along each axis of effects with few parameters, then a fit from there."""
    free = free_parameters_of(effects, fit.values)
    counts = Counter(effect for effect, _ in free.entries)
    axes = [i for i, (effect, _) in enumerate(free.entries) if counts[effect] <= config.few_parameters]
    if not axes or fit.cost < config.axis_max_chi2 * comparison.pixel_count:
        return fit
    (function, best), bounds = residuals_and_start(free, fit, comparison), free.bounds(config.steps)
    offsets = np.linspace(-config.axis_reach, config.axis_reach, config.axis_points)
    for axis in axes:
        step = float(bounds.step[axis])
        best = min(best, axis_scan(function, best.x, bounds, axis, step * offsets), key=lambda m: m.cost)
        spacing = 2 * step * config.axis_reach / (config.axis_points - 1)
        moved = minimise_along_axis(function, best.x, bounds, axis, spacing, evaluations=config.axis_evaluations)
        best = min(best, moved, key=lambda m: m.cost)
    if best.cost >= fit.cost:
        return fit
    found = CandidateFit(fit.causes, free.unpack(best.x, fit.values), best.cost)
    return min(found, refit(effects, found.values, comparison, config), key=lambda f: f.cost)


def drop_negligible_values(
    effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison, config: FitConfig
) -> CandidateFit:
    """Sets negligible values to their identity unless the captures insist on them, and fits the others again."""
    values, cost, fixed = fit.values, fit.cost, set()
    for e, p in free_parameters_of(effects, fit.values, include_fine=True).entries:
        away = abs(p.read(values.get(e, {})) - p.identity)  # NaN for entries of lists, which have no identity
        if not 0.0 < away < config.negligible * p.prior:
            continue
        without = {**values, e: p.written(values[e], p.identity)}
        allowed = cost + config.insistence * max(1.0, cost / comparison.pixel_count)
        if (cost_without := cost_or_inf(comparison, without)) < allowed:
            values, cost = without, cost_without
            fixed.add((e, p.name))
    if not fixed:
        return fit
    fitted = refit(effects, values, comparison, config, fixed=frozenset(fixed))
    return CandidateFit(fit.causes, fitted.values, fitted.cost)
