"""Joint fits of the causes of a trial: forgiving weights first, then the noise alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from holoview.diagnose.bench import Bench
from holoview.diagnose.screen import mismatch
from holoview.diagnose.search import Trial, cost_of, lengthened, local_fit, looked_along, sharpened, simplified

_FAR = 0.15  # r.m.s. residual over mean light; beyond, weights of the noise alone lead nowhere
_BETTER = 0.95  # cost that is worth refining the same causes again


def refined(bench: Bench, trial: Trial, *, fine: bool = False) -> Trial:
    """A joint fit of all causes of a trial on the fine captures: forgiving weights first, then the noise alone."""
    effects = [bench.effects[name] for name in trial.causes]
    indices = bench.split.fine
    off_by = mismatch(bench, trial.values)
    values = trial.values
    if off_by > 0.02:
        forgiving = bench.coarse_comparison(indices, min(0.5, 0.5 * off_by))
        found = local_fit(effects, values, forgiving, fine=fine)
        values = found.values
        if mismatch(bench, values) > _FAR:
            return found
    comparison = bench.judged_by(indices, values)
    found = local_fit(effects, values, comparison, iterations=5, tolerance=1e-4, fine=fine)
    for improved in (lengthened, sharpened, simplified):
        found = improved(effects, found, comparison)
    return found


def searched_along(bench: Bench, trial: Trial) -> Trial:
    """A refined trial on rougher captures, which show what is left: fitted, and looked for along its axes."""
    effects = [bench.effects[name] for name in trial.causes]
    comparison = bench.judged_by(bench.split.rough, trial.values)
    fitted = local_fit(effects, trial.values, comparison, iterations=3, tolerance=1e-4)
    best = min(replace(trial, cost=cost_of(comparison, trial.values)), fitted, key=lambda t: t.cost)
    return looked_along(effects, best, comparison)


class Refined:
    """What was refined so far. Nothing is refined twice unless a later stage of the screen found better values."""

    def __init__(self, bench: Bench) -> None:
        self.trials: list[Trial] = []
        self._bench, self._begun = bench, dict[tuple[str, ...], float]()

    def add(self, trials: Sequence[Trial]) -> bool:
        """Refines what is new of these; whether there was something."""
        fresh = [t for t in trials if t.cost < _BETTER * self._begun.get(t.causes, np.inf)]
        self._begun |= {t.causes: t.cost for t in fresh}
        self.trials += self._bench.side_by_side([partial(refined, self._bench, t) for t in fresh])
        return bool(fresh)
