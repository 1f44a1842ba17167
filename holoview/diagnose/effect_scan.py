"""Scans of one effect's range, and fits from the best points.

Derivatives at the identity value show the cause of a small error. A large one decorrelates the speckle, and the true
value is then found only by a scan of the effect's range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.config import FitConfig
from holoview.diagnose.effect_fit import CandidateFit, cost_or_inf, hard_edge_mask, local_fit, residuals_and_start
from holoview.diagnose.free_parameters import FittedValues, free_parameters_of, identity_values
from holoview.model.effects.effect import Effect
from holoview.numerics.nelder_mead import nelder_mead


def scan_effect(
    effect: Effect,
    comparison: Comparison,
    base: FittedValues,
    starts: Sequence[Mapping[str, float]],
    config: FitConfig,
) -> list[CandidateFit]:
    """The effect at its identity and at `starts` on top of `base`, the lowest cost first; nothing is fitted.

    Where several parameters have a scan of their own, a second cycle varies each from the best point of the first.
    """
    causes, identity = (*base, effect.id), identity_values(effect)
    points = [dict(identity), *({**identity, **point} for point in starts)]
    fits = _evaluate_points(comparison, causes, base, effect.id, points)
    several = sum(p.scan is not None for p in effect.parameters) > 1
    if several and fits[0].cost < config.second_cycle_cost * cost_at_identity(fits, effect):
        best = fits[0].values[effect.id]
        combined = [{**best, **_off_identity(point, identity)} for point in points[1:]]
        fresh = [point for point in combined if point not in points]
        fits = sorted([*fits, *_evaluate_points(comparison, causes, base, effect.id, fresh)], key=lambda f: f.cost)
    return fits


def cost_at_identity(fits: Sequence[CandidateFit], effect: Effect) -> float:
    """The cost of the point of a scan at which the effect is off."""
    identity = identity_values(effect)
    return next(f.cost for f in fits if f.values[effect.id] == identity)


def fit_from_scan(
    effect: Effect,
    comparison: Comparison,
    base: FittedValues,
    fits: Sequence[CandidateFit],
    config: FitConfig,
    max_starts: int | None = None,
) -> CandidateFit:
    """The best local fit of one effect, its base unchanged, from the best points of a scan.

    Of an effect with many parameters from one, which is the best on all captures of the comparison: a few of them can't
    tell opposite wedges apart.
    """
    if sum(not p.secondary for p in effect.parameters) >= config.single_start_parameters:
        best_few = [f for f in fits if np.isfinite(f.cost)][: config.compared_starts]
        starts = sorted(best_few, key=lambda s: cost_or_inf(comparison, s.values))[:1]
    else:
        starts = _separated_starts(fits, effect, config, config.starts if max_starts is None else max_starts)
    best = min((local_fit([effect], s.values, comparison, config) for s in starts), key=lambda f: f.cost)
    return CandidateFit((*base, effect.id), best.values, best.cost)


def fit_rival_parameters(
    effect: Effect, comparison: Comparison, base: FittedValues, fits: Sequence[CandidateFit], config: FitConfig
) -> CandidateFit:
    """The best local fit of one effect, its base unchanged, of all parameters together from the best of one alone.

    Each parameter is fitted alone from its best point of a scan.
    """
    identity, alone = identity_values(effect), []
    for p in effect.parameters:
        own = [f for f in fits if _off_identity(f.values[effect.id], identity).keys() == {p.name}]
        fixed = frozenset((effect.id, other.name) for other in effect.parameters if other is not p)
        alone += [local_fit([effect], f.values, comparison, config, fixed=fixed) for f in own[:1]]
    best = min(alone, key=lambda f: f.cost)
    together = local_fit([effect], best.values, comparison, config)
    return CandidateFit((*base, effect.id), together.values, together.cost)


def find_hard_edges(effect: Effect, fit: CandidateFit, comparison: Comparison, config: FitConfig) -> CandidateFit:
    """A point of a scan with the effect's hard edges found by a simplex; unchanged where the effect has none."""
    free = free_parameters_of([effect], fit.values)
    edges = hard_edge_mask(free)
    if not edges.any():
        return fit
    function, start = residuals_and_start(free, fit, comparison)
    bounds = free.bounds(config.steps)
    minimum = nelder_mead(function, start, bounds, edges, config.scan_edge_size, config.edge_evaluations)
    return CandidateFit(fit.causes, free.unpack(minimum.x, fit.values), minimum.cost)


def _evaluate_points(
    comparison: Comparison, causes: tuple[str, ...], base: FittedValues, own: str, points: Sequence[dict[str, float]]
) -> list[CandidateFit]:
    """The effect `own` at each point on top of the base, the lowest cost first."""
    fits = []
    for point in points:
        values = {**base, own: dict(point)}
        fits.append(CandidateFit(causes, values, cost_or_inf(comparison, values)))
    return sorted(fits, key=lambda f: f.cost)


def _off_identity(point: Mapping[str, float], identity: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in point.items() if value != identity[name]}


def _separated_starts(
    fits: Sequence[CandidateFit], effect: Effect, config: FitConfig, max_starts: int
) -> list[CandidateFit]:
    """The best points of a scan with finite costs that aren't neighbours."""
    chosen: list[CandidateFit] = []
    for fit in fits:
        separate = all(_scan_distance(fit, other, effect) > config.start_separation for other in chosen)
        if np.isfinite(fit.cost) and separate:
            chosen.append(fit)
        if len(chosen) == max_starts:
            break
    return chosen


def _scan_distance(a: CandidateFit, b: CandidateFit, effect: Effect) -> float:
    """The largest difference of a parameter in steps of its scan; of different lists infinite."""
    steps = {p.name: p.scan[2] if p.scan else p.prior for p in effect.parameters}
    first, second = a.values[effect.id], b.values[effect.id]
    if any(isinstance(value, tuple) for value in first.values()):
        return 0.0 if first == second else math.inf
    return max(abs(first[name] - second[name]) / step for name, step in steps.items())
