"""First look at every effect, on the smoothest captures, on top of causes that are already known.

Three ways, by how far the model is off. Nearly there: the tangent at the identity tells what each effect could gain,
and only the most promising are fitted. Medium: a local fit of each from its identity. Far: a scan over each effect's
range first, since decorrelated speckle has no slope that points home. Effects come in batches, the cheapest first, so
that the caller can stop as soon as one explains everything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.capture_split import spread_over_wavelengths
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.displacement_starts import StartProvider, displacement_starts
from holoview.diagnose.effect_fit import (
    CandidateFit,
    cost_at_identity,
    cost_or_inf,
    effect_jacobian,
    find_hard_edges,
    fit_from_scan,
    local_fit,
    scan_effect,
)
from holoview.diagnose.field_count import MANY, max_field_count
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.ghost_starts import ghost_starts
from holoview.diagnose.search_context import SearchContext
from holoview.model.effects.effect import BENCH_HOOKS, CAMERA_HOOKS, MODULATOR_HOOKS, Effect
from holoview.util.progress import ProgressCallback

EffectFitter = Callable[[Effect], CandidateFit]
FitBatches = Iterator[list[CandidateFit]]

_TANGENT_BELOW, _LOCAL_BELOW = 0.05, 0.35  # r.m.s. residual over mean light
_TANGENT_FITS = 8
_LONG = 20.0  # times the step of tangents of many fields: over short ones irises' edges jump more than the rest changes
_STRAIGHT = 2.0  # χ²/n up to which nothing can lie beyond the reach of tangents
_BATCH = 8
_SCAN_CAPTURES = 2
_FEW_POINTS = 3  # of a scan where a prediction adds many fields; a local fit is begun only if one of them leaves
_WORTH_FITTING = 0.9  # of the cost without the effect


def relative_model_error(
    context: SearchContext, values: FittedValues, indices: NDArray[np.intp] | None = None
) -> float:
    """How far a model is off: r.m.s. residual beyond the noise over the mean light; coarse captures when None."""
    comparison = context.data_weighted_comparison(context.split.coarse if indices is None else indices, 0.0)
    fitted = comparison.fit_gains(values)
    usable = comparison.weight > 0
    inverse = np.where(usable, 1.0 / np.where(usable, comparison.weight, 1.0), 0.0)
    excess = np.square(fitted.residual * inverse).sum((1, 2)) - np.square(inverse).sum((1, 2))
    light = np.abs(np.where(usable, comparison.light, 0.0).sum((1, 2)))
    ratio = np.maximum(excess, 0.0) * comparison.pixels_per_capture / np.maximum(light, 1e-9) ** 2
    return float(np.sqrt(ratio.mean()))


def screen_effects(
    context: SearchContext, base: FittedValues, effects: Sequence[Effect], progress: ProgressCallback, note: str
) -> Iterator[FitBatches]:
    """Stages of batches of trials, each one effect on top of `base` with costs of one comparison; cheap effects first.

    Near the floor the most promising tangents; further off local fits; then, unless there is hardly anything to
    explain, scans over ranges. Far off scans alone.
    """
    off_by = relative_model_error(context, base)
    comparison = context.data_weighted_comparison(context.split.coarse, min(off_by, 1.0))
    some = spread_over_wavelengths(context.data.captures, context.split.coarse, _SCAN_CAPTURES)
    few = context.data_weighted_comparison(some, min(off_by, 1.0))
    nothing = cost_or_inf(comparison, base)
    ordered = sorted(effects, key=lambda e: (search_cost(context, e), e.id))

    def batches(look: EffectFitter, note: str) -> FitBatches:
        for batch in _batches(ordered):
            yield _improving(context.map_effects(look, batch, progress, note), nothing)

    def nearly() -> FitBatches:
        doubled = ghost_starts(base, comparison)
        look = _scan_fitter(context, comparison, few, base, doubled)
        yield _improving(context.map_effects(look, [e for e in ordered if doubled(e)], progress, note), nothing)
        best = _best_by_tangent(context, base, [e for e in ordered if not doubled(e)], comparison, progress, note)
        yield _improving(
            context.map_effects(_local_fitter(context, comparison, few, base, 4), best, progress, note), nothing
        )

    if off_by < _TANGENT_BELOW:
        yield nearly()
        blind = context.data_weighted_comparison(context.split.coarse, 0.0)
        if cost_or_inf(blind, base) < _STRAIGHT * blind.pixel_count:
            return
    elif off_by < _LOCAL_BELOW:
        yield batches(_local_fitter(context, comparison, few, base, 4), note)
    look = _scan_fitter(context, comparison, few, base, _starts(context, base, comparison))
    yield batches(look, f"{note}, over its range")


def search_cost(context: SearchContext, effect: Effect) -> float:
    """How much a search costs: points of its scan × fields of a prediction × how early the light path changes."""
    points = list(effect.starting_points(context.system))
    beams = max_field_count(context, effect)
    upstream = any(effect.overrides(h) for h in (*BENCH_HOOKS, *MODULATOR_HOOKS) if h != "laser_power")
    aims = any(effect.overrides(h) for h in CAMERA_HOOKS)
    return (len(points) + 3 * len(effect.parameters)) * (4.0 * beams if upstream else 0.2 if aims else 2.0)


def _best_by_tangent(
    context: SearchContext,
    base: FittedValues,
    effects: Sequence[Effect],
    comparison: Comparison,
    progress: ProgressCallback,
    note: str,
) -> list[Effect]:
    """The effects whose tangents explain most of the residual, the best first."""
    residual = comparison.residual(base)

    def gain(effect: Effect) -> float:
        start = {**base, effect.id: _identity(effect)}
        stretch = _LONG if max_field_count(context, effect) >= MANY else 1.0
        slopes = effect_jacobian(effect, start, comparison, residual, step_factor=stretch)
        normal = (slopes @ slopes.T).astype(np.float64)
        right = (slopes @ residual).astype(np.float64)
        return float(right @ np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right)

    gains = context.map_effects(gain, effects, progress, f"{note}, tangents")
    order = np.argsort(gains)[::-1][:_TANGENT_FITS]
    return [effects[k] for k in order if gains[k] > 0]


def _local_fitter(
    context: SearchContext, comparison: Comparison, few: Comparison, base: FittedValues, iterations: int
) -> EffectFitter:
    """A local fit from the identity; of many fields from the best of a few points."""
    of_many = _costly_fitter(context, comparison, few, base, 1.0)

    def look(effect: Effect) -> CandidateFit:
        if max_field_count(context, effect) >= MANY:
            return of_many(effect)
        start = {**base, effect.id: _identity(effect)}
        found = local_fit([effect], start, comparison, iterations=iterations)
        return CandidateFit((*base, effect.id), found.values, found.cost)

    return look


def _scan_fitter(
    context: SearchContext, comparison: Comparison, few: Comparison, base: FittedValues, starts: StartProvider
) -> EffectFitter:
    """Scan on a few captures, local fits on all of the comparison's."""
    of_many = _costly_fitter(context, comparison, few, base, _WORTH_FITTING)

    def look(effect: Effect) -> CandidateFit:
        if max_field_count(context, effect) >= MANY:
            return of_many(effect)
        trials = scan_effect(effect, few, base, [*starts(effect), *effect.starting_points(context.system)])
        return fit_from_scan(effect, comparison, base, [find_hard_edges(effect, trials[0], few), *trials[1:]])

    return look


def _costly_fitter(
    context: SearchContext, comparison: Comparison, few: Comparison, base: FittedValues, worth: float
) -> EffectFitter:
    """Effects whose predictions add many fields: a few points and one fit on a few captures.

    The fit is begun only where a point leaves no more than a share `worth` of the cost without the effect.
    """

    def look(effect: Effect) -> CandidateFit:
        points = list(effect.starting_points(context.system))
        points = [points[(2 * k + 1) * len(points) // (2 * _FEW_POINTS)] for k in range(_FEW_POINTS)]
        trials = scan_effect(effect, few, base, points)
        if trials[0].cost > worth * cost_at_identity(trials, effect):
            return CandidateFit((*base, effect.id), trials[0].values, float("inf"))
        found = fit_from_scan(effect, few, base, trials, max_starts=1)
        return replace(found, cost=cost_or_inf(comparison, found.values))

    return look


def _starts(context: SearchContext, base: FittedValues, comparison: Comparison) -> StartProvider:
    """Starting values that the pictures themselves suggest."""
    moved, doubled = displacement_starts(base, comparison), ghost_starts(base, comparison)
    return lambda effect: [*moved(effect), *doubled(effect)]


def _batches(effects: Sequence[Effect]) -> list[Sequence[Effect]]:
    return [effects[k : k + _BATCH] for k in range(0, len(effects), _BATCH)]


def _improving(fits: Sequence[CandidateFit], baseline_cost: float) -> list[CandidateFit]:
    return sorted((t for t in fits if t.cost < baseline_cost), key=lambda t: t.cost)


def _identity(effect: Effect) -> dict[str, float]:
    return {p.name: p.identity for p in effect.parameters}
