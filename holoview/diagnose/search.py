"""The best values of one effect, or of several together: a scan over its range, then a local fit.

A tangent at the identity value tells the cause of small errors. Large ones decorrelate the speckle, and the true value
is then found only by looking along the effect's range: `scan`. Hard edges have no slopes: golden section.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.levenberg import (
    Function,
    Minimum,
    Residuals,
    Vector,
    along_axis,
    golden_section,
    jacobian,
    levenberg_marquardt,
)
from holoview.diagnose.simplex import downhill
from holoview.diagnose.unknowns import Found, Unknowns, unknowns
from holoview.effects.effect import Effect
from holoview.errors import UserError

Held = frozenset[tuple[str, str]]

_LOCAL_STARTS, _MANY = 2, 4
_NEGLIGIBLE = 0.02  # of the prior; so small a value stays at its identity unless the captures insist
_INSISTS = 9.0  # Δχ² of a parameter: 3 σ
_STRETCH, _FEW = 5.0, 2
_AT_FLOOR, _REACH, _POINTS, _ALONG = 1.01, 10.0, 17, 10  # χ²/n; steps of a difference; evaluations
_EDGES_FOUND = 0.9  # of the cost at the start: then it is worth finding them exactly
_FAR_EDGE, _FIRST_EDGE, _LAST_EDGE, _EDGE_EVALUATIONS = 1.0, 0.5, 0.05, 100  # of the prior
_SHARP_ITERATIONS = 3
_GAIN_OF_A_CYCLE = 0.99  # a second round over the parameters is worth it when the first lowered the cost below this


@dataclass(frozen=True)
class Trial:
    """Causes with values, and their cost (Σ residual²) in the comparison that they were fitted in."""

    causes: tuple[str, ...]
    values: Found
    cost: float

    @property
    def free(self) -> int:
        """How many numbers it takes."""
        return sum(len(values) for values in self.values.values())

    def without(self, name: str) -> Trial:
        """The same with one cause off, as it is: neither fitted nor compared again."""
        values = {cause: own for cause, own in self.values.items() if cause != name}
        return Trial(tuple(cause for cause in self.causes if cause != name), values, float("inf"))


def cost_of(comparison: Comparison, values: Mapping[str, Mapping[str, float]]) -> float:
    """Σ residual², infinite where such a bench can't be (a gap below zero, say)."""
    try:
        return float(comparison.fit(values).squares.sum())
    except UserError:
        return float("inf")


def scan(effect: Effect, comparison: Comparison, base: Found, starts: Sequence[Mapping[str, float]]) -> list[Trial]:
    """Trials at the identity and at `starts` on top of `base`, best first.

    Where several parameters have a scan of their own, a second round varies each from the best point of the first.
    """
    causes = (*base, effect.id)
    identity = {p.name: p.identity for p in effect.parameters}
    points = [dict(identity), *({**identity, **p} for p in starts)]
    trials = _tried(comparison, causes, base, effect.id, points)
    several = sum(p.scan is not None for p in effect.parameters) > 1
    if several and trials[0].cost < _GAIN_OF_A_CYCLE * trials_at_identity(trials, effect):
        best = trials[0].values[effect.id]
        more = [{**best, **_moved(point, identity)} for point in points[1:]]
        fresh = [point for point in more if point not in points]
        trials = sorted([*trials, *_tried(comparison, causes, base, effect.id, fresh)], key=lambda t: t.cost)
    return trials


def trials_at_identity(trials: Sequence[Trial], effect: Effect) -> float:
    """The cost of the trial in which the effect is off."""
    identity = {p.name: p.identity for p in effect.parameters}
    return next(t.cost for t in trials if t.values[effect.id] == identity)


def local_fit(
    effects: Sequence[Effect],
    start: Found,
    comparison: Comparison,
    *,
    iterations: int = 6,
    tolerance: float = 2e-3,
    fine: bool = False,
    stretch: float = 1.0,
    held: Held = frozenset(),
) -> Trial:
    """Levenberg–Marquardt on all parameters of the effects from `start`, then a simplex where all are hard edges.

    fine: the fine ones too. stretch: of the steps of its differences. held: (effect, parameter) that stay as they are.
    """
    free = unknowns(effects, fine=fine)
    varied = Unknowns(tuple((e, p) for e, p in free.entries if (e, p.name) not in held))
    values, cost = start, cost_of(comparison, start)
    if len(varied):
        function, bounds = residual_of(varied, start, comparison), varied.bounds().stretched(stretch)
        minimum = levenberg_marquardt(function, varied.pack(start), bounds, iterations=iterations, tolerance=tolerance)
        if _sharp(varied).all() and minimum.cost < _EDGES_FOUND * cost:
            minimum = downhill(function, minimum, bounds, _sharp(varied), _FIRST_EDGE, _EDGE_EVALUATIONS)
        values, cost = varied.unpack(minimum.x, start), minimum.cost
    return Trial(tuple(e.id for e in effects), values, cost)


def search(
    effect: Effect, comparison: Comparison, base: Found, trials: Sequence[Trial], starts: int = _LOCAL_STARTS
) -> Trial:
    """Local fits of the effect alone from the best points of a scan."""
    fits = [local_fit([effect], t.values, comparison) for t in _apart(trials, effect, starts)]
    best = min(fits, key=lambda t: t.cost)
    return Trial((*base, effect.id), best.values, best.cost)


def residual_of(free: Unknowns, base: Found, comparison: Comparison) -> Function:
    """The residuals as a function of the vector; a bench that can't be answers with the residuals of no light."""

    def function(x: Vector) -> Residuals:
        try:
            return comparison.residual(free.unpack(x, base))
        except UserError:
            return comparison.no_light

    return function


def slopes_of(
    effect: Effect, values: Found, comparison: Comparison, residual: np.ndarray, *, stretch: float = 1.0
) -> np.ndarray:
    """Slopes (parameter, pixel) of the residuals by the effect's parameters at `values`, in units of the priors.

    stretch: of the steps of its differences.
    """
    free = unknowns([effect])
    bounds = free.bounds().stretched(stretch)
    return jacobian(residual_of(free, values, comparison), free.pack(values), residual, bounds)


def _tried(
    comparison: Comparison, causes: tuple[str, ...], base: Found, own: str, points: Sequence[dict[str, float]]
) -> list[Trial]:
    trials = []
    for point in points:
        values = {**base, own: dict(point)}
        trials.append(Trial(causes, values, cost_of(comparison, values)))
    return sorted(trials, key=lambda t: t.cost)


def _moved(point: Mapping[str, float], identity: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in point.items() if value != identity[name]}


def _apart(trials: Sequence[Trial], effect: Effect, starts: int) -> list[Trial]:
    """The best trials to start from: finite, not next to each other in the scan; one where there are many numbers."""
    chosen: list[Trial] = []
    starts = starts if sum(not p.fine for p in effect.parameters) < _MANY else 1
    for trial in trials:
        if np.isfinite(trial.cost) and all(_distance(trial, other, effect) > 1.5 for other in chosen):
            chosen.append(trial)
        if len(chosen) == starts:
            break
    return chosen


def _distance(a: Trial, b: Trial, effect: Effect) -> float:
    """The largest difference of a parameter in steps of its scan."""
    steps = {p.name: p.scan[2] if p.scan else p.prior for p in effect.parameters}
    first, second = a.values[effect.id], b.values[effect.id]
    return max(abs(first[name] - second[name]) / step for name, step in steps.items())


def with_edges(effect: Effect, trial: Trial, comparison: Comparison) -> Trial:
    """A trial of a scan with the effect's hard edges looked for by a simplex; as it is where it has none."""
    free = unknowns([effect])
    sharp = _sharp(free)
    if not sharp.any():
        return trial
    function, start = _beginning(free, trial, comparison)
    found = downhill(function, start, free.bounds(), sharp, _FAR_EDGE, _EDGE_EVALUATIONS)
    return Trial(trial.causes, free.unpack(found.x, trial.values), found.cost)


def sharpened(effects: Sequence[Effect], trial: Trial, comparison: Comparison) -> Trial:
    """Parameters with hard edges by a simplex, then by a smaller one; the others fitted again between the two."""
    free = unknowns(effects)
    sharp = _sharp(free)
    if not sharp.any():
        return trial
    (function, start), bounds = _beginning(free, trial, comparison), free.bounds()
    best = downhill(function, start, bounds, sharp, _FIRST_EDGE, _EDGE_EVALUATIONS)
    if not sharp.all():
        found = levenberg_marquardt(function, best.x, bounds, iterations=_SHARP_ITERATIONS, tolerance=1e-3)
        best = min(best, found, key=lambda m: m.cost)
    best = downhill(function, best, bounds, sharp, _LAST_EDGE, _EDGE_EVALUATIONS)
    return Trial(trial.causes, free.unpack(best.x, trial.values), best.cost)


def _beginning(free: Unknowns, trial: Trial, comparison: Comparison) -> tuple[Function, Minimum]:
    """The residuals as a function of the unknowns, and where a trial lies in it."""
    at = Minimum(free.pack(trial.values), trial.cost, comparison.residual(trial.values), 0)
    return residual_of(free, trial.values, comparison), at


def _sharp(free: Unknowns) -> NDArray[np.bool_]:
    return np.array([p.sharp for _, p in free.entries], dtype=bool)


def lengthened(effects: Sequence[Effect], trial: Trial, comparison: Comparison) -> Trial:
    """Few parameters once more with longer steps: where edges of irises jump, short differences find no slope."""
    if len(unknowns(effects)) > _FEW:
        return trial
    longer = local_fit(effects, trial.values, comparison, iterations=3, tolerance=1e-4, stretch=_STRETCH)
    return min(trial, longer, key=lambda t: t.cost)


def looked_along(effects: Sequence[Effect], trial: Trial, comparison: Comparison) -> Trial:
    """What stopped short of the floor, along each axis of effects with few parameters; fitted again from there."""
    free = unknowns(effects)
    each = Counter(effect for effect, _ in free.entries)
    axes = [i for i, (effect, _) in enumerate(free.entries) if each[effect] <= _FEW]
    if not axes or trial.cost < _AT_FLOOR * comparison.count:
        return trial
    (function, found), bounds = _beginning(free, trial, comparison), free.bounds()
    for axis in axes:
        step = float(bounds.step[axis])
        near = along_axis(function, found.x, bounds, axis, step * np.linspace(-_REACH, _REACH, _POINTS))
        found = min(found, near, key=lambda m: m.cost)
        moved = golden_section(function, found.x, bounds, axis, 2 * step * _REACH / (_POINTS - 1), evaluations=_ALONG)
        found = min(found, moved, key=lambda m: m.cost)
    if found.cost >= trial.cost:
        return trial
    again = local_fit(effects, free.unpack(found.x, trial.values), comparison, iterations=3, tolerance=1e-4)
    return min(Trial(trial.causes, free.unpack(found.x, trial.values), found.cost), again, key=lambda t: t.cost)


def simplified(effects: Sequence[Effect], trial: Trial, comparison: Comparison) -> Trial:
    """Without negligible values that the captures don't insist on, the others fitted again.

    Fewer numbers say the same; and a picture that isn't turned at all needs no interpolation.
    """
    values, cost, held = trial.values, trial.cost, set()
    for e, p in unknowns(effects, fine=True).entries:
        away = abs(values.get(e, {}).get(p.name, p.identity) - p.identity)
        if not 0.0 < away < _NEGLIGIBLE * p.prior:
            continue
        without = {**values, e: {**values[e], p.name: p.identity}}
        if (less := cost_of(comparison, without)) < cost + _INSISTS * max(1.0, cost / comparison.count):
            values, cost = without, less
            held.add((e, p.name))
    if not held:
        return trial
    fitted = local_fit(effects, values, comparison, iterations=3, tolerance=1e-4, held=frozenset(held))
    return Trial(trial.causes, fitted.values, fitted.cost)
