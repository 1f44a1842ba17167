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

from holoview.diagnose.beams import MANY, most_beams
from holoview.diagnose.bench import Bench, Progress
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.displacement import Hints, hints
from holoview.diagnose.ghosts import copies
from holoview.diagnose.search import Trial, cost_of, local_fit, scan, search, slopes_of, trials_at_identity, with_edges
from holoview.diagnose.split import spread
from holoview.diagnose.unknowns import Found
from holoview.effects.effect import BENCH_HOOKS, CAMERA_HOOKS, MODULATOR_HOOKS, Effect

Look = Callable[[Effect], Trial]
Stage = Iterator[list[Trial]]

_TANGENT_BELOW, _LOCAL_BELOW = 0.05, 0.35  # r.m.s. residual over mean light
_TANGENT_FITS = 8
_LONG = 20.0  # times the step of tangents of many fields: over short ones irises' edges jump more than the rest changes
_STRAIGHT = 2.0  # χ²/n up to which nothing can lie beyond the reach of tangents
_BATCH = 8
_SCAN_CAPTURES = 2
_FEW_POINTS = 3  # of a scan where a prediction adds many fields; a local fit is begun only if one of them leaves
_WORTH_FITTING = 0.9  # of the cost without the effect


def mismatch(bench: Bench, values: Found, indices: NDArray[np.intp] | None = None) -> float:
    """How far a model is off: r.m.s. residual beyond the noise over the mean light; coarse captures when None."""
    comparison = bench.coarse_comparison(bench.split.coarse if indices is None else indices, 0.0)
    fitted = comparison.fit(values)
    usable = comparison.weight > 0
    inverse = np.where(usable, 1.0 / np.where(usable, comparison.weight, 1.0), 0.0)
    excess = np.square(fitted.residual * inverse).sum((1, 2)) - np.square(inverse).sum((1, 2))
    light = np.abs(np.where(usable, comparison.light, 0.0).sum((1, 2)))
    ratio = np.maximum(excess, 0.0) * comparison.pixels / np.maximum(light, 1e-9) ** 2
    return float(np.sqrt(ratio.mean()))


def screen(bench: Bench, base: Found, effects: Sequence[Effect], report: Progress, note: str) -> Iterator[Stage]:
    """Stages of batches of trials, each one effect on top of `base` with costs of one comparison; cheap effects first.

    Near the floor the most promising tangents; further off local fits; then, unless there is hardly anything to
    explain, scans over ranges. Far off scans alone.
    """
    off_by = mismatch(bench, base)
    comparison = bench.coarse_comparison(bench.split.coarse, min(off_by, 1.0))
    some = spread(bench.measured.captures, bench.split.coarse, _SCAN_CAPTURES)
    few = bench.coarse_comparison(some, min(off_by, 1.0))
    nothing = cost_of(comparison, base)
    ordered = sorted(effects, key=lambda e: (effort(bench, e), e.id))

    def batches(look: Look, note: str) -> Stage:
        for batch in _batches(ordered):
            yield _better(bench.map(look, batch, report, note), nothing)

    def nearly() -> Stage:
        doubled = copies(base, comparison)
        look = _scanned(bench, comparison, few, base, doubled)
        yield _better(bench.map(look, [e for e in ordered if doubled(e)], report, note), nothing)
        best = _promising(bench, base, [e for e in ordered if not doubled(e)], comparison, report, note)
        yield _better(bench.map(_local(bench, comparison, few, base, 4), best, report, note), nothing)

    if off_by < _TANGENT_BELOW:
        yield nearly()
        blind = bench.coarse_comparison(bench.split.coarse, 0.0)
        if cost_of(blind, base) < _STRAIGHT * blind.count:
            return
    elif off_by < _LOCAL_BELOW:
        yield batches(_local(bench, comparison, few, base, 4), note)
    look = _scanned(bench, comparison, few, base, _starts(bench, base, comparison))
    yield batches(look, f"{note}, over its range")


def effort(bench: Bench, effect: Effect) -> float:
    """How much a search costs: points of its scan × fields of a prediction × how early the light path changes."""
    points = list(effect.starts(bench.system))
    beams = most_beams(bench, effect)
    upstream = any(effect.changes(h) for h in (*BENCH_HOOKS, *MODULATOR_HOOKS) if h != "power")
    aims = any(effect.changes(h) for h in CAMERA_HOOKS)
    return (len(points) + 3 * len(effect.parameters)) * (4.0 * beams if upstream else 0.2 if aims else 2.0)


def _promising(
    bench: Bench, base: Found, effects: Sequence[Effect], comparison: Comparison, report: Progress, note: str
) -> list[Effect]:
    """The effects whose tangents explain most of the residual, the best first."""
    residual = comparison.residual(base)

    def gain(effect: Effect) -> float:
        start = {**base, effect.id: _identity(effect)}
        stretch = _LONG if most_beams(bench, effect) >= MANY else 1.0
        slopes = slopes_of(effect, start, comparison, residual, stretch=stretch)
        normal = (slopes @ slopes.T).astype(np.float64)
        right = (slopes @ residual).astype(np.float64)
        return float(right @ np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right)

    gains = bench.map(gain, effects, report, f"{note}, tangents")
    order = np.argsort(gains)[::-1][:_TANGENT_FITS]
    return [effects[k] for k in order if gains[k] > 0]


def _local(bench: Bench, comparison: Comparison, few: Comparison, base: Found, iterations: int) -> Look:
    """A local fit from the identity; of many fields from the best of a few points."""
    of_many = _of_many(bench, comparison, few, base, 1.0)

    def look(effect: Effect) -> Trial:
        if most_beams(bench, effect) >= MANY:
            return of_many(effect)
        start = {**base, effect.id: _identity(effect)}
        found = local_fit([effect], start, comparison, iterations=iterations)
        return Trial((*base, effect.id), found.values, found.cost)

    return look


def _scanned(bench: Bench, comparison: Comparison, few: Comparison, base: Found, starts: Hints) -> Look:
    """Scan on a few captures, local fits on all of the comparison's."""
    of_many = _of_many(bench, comparison, few, base, _WORTH_FITTING)

    def look(effect: Effect) -> Trial:
        if most_beams(bench, effect) >= MANY:
            return of_many(effect)
        trials = scan(effect, few, base, [*starts(effect), *effect.starts(bench.system)])
        return search(effect, comparison, base, [with_edges(effect, trials[0], few), *trials[1:]])

    return look


def _of_many(bench: Bench, comparison: Comparison, few: Comparison, base: Found, worth: float) -> Look:
    """Effects whose predictions add many fields: a few points and one fit on a few captures.

    The fit is begun only where a point leaves no more than a share `worth` of the cost without the effect.
    """

    def look(effect: Effect) -> Trial:
        points = list(effect.starts(bench.system))
        points = [points[(2 * k + 1) * len(points) // (2 * _FEW_POINTS)] for k in range(_FEW_POINTS)]
        trials = scan(effect, few, base, points)
        if trials[0].cost > worth * trials_at_identity(trials, effect):
            return Trial((*base, effect.id), trials[0].values, float("inf"))
        found = search(effect, few, base, trials, starts=1)
        return replace(found, cost=cost_of(comparison, found.values))

    return look


def _starts(bench: Bench, base: Found, comparison: Comparison) -> Hints:
    """Starting values that the pictures themselves suggest."""
    moved, doubled = hints(base, comparison), copies(base, comparison)
    return lambda effect: [*moved(effect), *doubled(effect)]


def _batches(effects: Sequence[Effect]) -> list[Sequence[Effect]]:
    return [effects[k : k + _BATCH] for k in range(0, len(effects), _BATCH)]


def _better(trials: Sequence[Trial], nothing: float) -> list[Trial]:
    return sorted((t for t in trials if t.cost < nothing), key=lambda t: t.cost)


def _identity(effect: Effect) -> dict[str, float]:
    return {p.name: p.identity for p in effect.parameters}
