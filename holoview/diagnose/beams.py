"""How many fields a prediction adds up: bandwidth, an extended source and flicker make one picture of many."""

from __future__ import annotations

import math
from collections.abc import Sequence

from holoview.diagnose.bench import Bench
from holoview.diagnose.comparison import Comparison, Values
from holoview.diagnose.search import Trial, cost_of
from holoview.effects.effect import Effect
from holoview.errors import UserError

MANY, VERY_MANY = 5, 25
_CLEARLY = 0.4  # of the excess
_BY_CHANCE = 5.0  # times √n: 3.5 σ of a χ²


def beams(bench: Bench, values: Values) -> int:
    """Fields of one capture with these effects: wavelengths × directions × moments; 1 where such a bench can't be."""
    system, moments = bench.system, 1
    lines = len(system.wavelengths_m)
    for name, own in values.items():
        effect = bench.effects[name]
        try:
            complete = effect.values(own)
            system, moments = effect.bench(system, complete), moments * len(effect.moments(complete))
        except UserError:
            return 1
    return len(system.wavelengths_m) // lines * len(system.source.directions_rad) * moments


def most_beams(bench: Bench, effect: Effect) -> int:
    """Fields of one capture at the far end of an effect's scan."""
    points = list(effect.starts(bench.system))
    return beams(bench, {effect.id: points[-1]}) if points else 1


def affordable(bench: Bench, trials: Sequence[Trial], comparison: Comparison) -> list[Trial]:
    """The trials in their order, of those with many fields only such as leave clearly less than all others.

    Lost contrast imitates whatever is unknown; pictures of many fields pay only where nothing simpler does as well.
    """
    many = {id(t): has_many(bench, t) for t in trials}
    if not any(many.values()):
        return list(trials)
    left = {id(t): cost_of(comparison, t.values) - comparison.count for t in trials}
    simple = [left[id(t)] for t in trials if not many[id(t)]]
    limit = max(_CLEARLY * min(simple, default=math.inf), _BY_CHANCE * comparison.count**0.5)
    return [t for t in trials if left[id(t)] <= limit or not many[id(t)]]


def has_many(bench: Bench, trial: Trial) -> bool:
    """Whether a trial's predictions take long."""
    return beams(bench, trial.values) >= MANY
