"""First look at every effect, on the smoothest captures, on top of causes that are already known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from holoview.diagnose.bench import Bench, Progress
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.displacement import hints
from holoview.diagnose.search import Trial, cost_of, local_fit, scan, search
from holoview.diagnose.unknowns import Found
from holoview.effects.effect import Effect

_TANGENT_BELOW = 0.05  # residual ÷ mean light, r.m.s.; below, speckle responds linearly and no scan is needed


def mismatch(bench: Bench, values: Found) -> float:
    """How far a model is off: r.m.s. residual beyond the noise over the mean light, on the coarse captures."""
    comparison = bench.coarse_comparison(bench.split.coarse, 0.0)
    fitted = comparison.fit(values)
    usable = comparison.weight > 0
    inverse = np.where(usable, 1.0 / np.where(usable, comparison.weight, 1.0), 0.0)
    excess = np.square(fitted.residual * inverse).sum((1, 2)) - np.square(inverse).sum((1, 2))
    light = np.abs(np.where(usable, comparison.light, 0.0).sum((1, 2)))
    ratio = np.maximum(excess, 0.0) * comparison.pixels / np.maximum(light, 1e-9) ** 2
    return float(np.sqrt(ratio.mean()))


def screen(bench: Bench, base: Found, effects: Sequence[Effect], report: Progress, note: str) -> list[Trial]:
    """The best trial of each effect on top of `base`, best first.

    Small mismatch: a local fit from the identity. Large: a scan over the range first; coarse weights either way.
    """
    off_by = mismatch(bench, base)
    comparison = bench.coarse_comparison(bench.split.coarse, min(off_by, 1.0))
    moved = hints(bench, base, comparison) if off_by >= _TANGENT_BELOW else None

    def look(effect: Effect) -> Trial:
        if moved is not None:
            trials = scan(bench, effect, comparison, base, moved(effect))
            return search(bench, effect, comparison, base, trials)
        identity = {p.name: p.identity for p in effect.parameters}
        trial = local_fit([effect], {**base, effect.id: identity}, comparison, iterations=2)
        return Trial((*base, effect.id), trial.values, trial.cost)

    nothing = cost_of(comparison, base)
    trials = bench.map(look, effects, report, note)
    return sorted((t for t in trials if t.cost < nothing), key=lambda t: t.cost)


def excess_of(trial: Trial, comparison: Comparison) -> float:
    """χ²/n − 1 of a trial in its own comparison."""
    return trial.cost / comparison.count - 1.0
