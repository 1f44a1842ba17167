"""How many fields a prediction adds up: bandwidth, an extended source and flicker make one picture of many."""

from __future__ import annotations

import math
from collections.abc import Sequence

from holoview.diagnose.comparison import Comparison, Values
from holoview.diagnose.effect_fit import CandidateFit, cost_or_inf
from holoview.diagnose.search_context import SearchContext
from holoview.model.effects.effect import Effect
from holoview.util.errors import UserError

MANY, VERY_MANY = 5, 25
_CLEARLY = 0.4  # of the excess
_BY_CHANCE = 5.0  # times √n: 3.5 σ of a χ²


def incoherent_field_count(context: SearchContext, values: Values) -> int:
    """Fields of one capture with these effects: wavelengths × directions × moments; 1 where such a bench can't be."""
    system, moments = context.system, 1
    lines = len(system.wavelengths_m)
    for name, own in values.items():
        effect = context.effects[name]
        try:
            complete = effect.parameter_values(own)
            system, moments = effect.bench(system, complete), moments * len(effect.exposure_samples(complete))
        except UserError:
            return 1
    return len(system.wavelengths_m) // lines * len(system.source.directions_rad) * moments


def max_field_count(context: SearchContext, effect: Effect) -> int:
    """Fields of one capture at the far end of an effect's scan."""
    points = list(effect.starting_points(context.system))
    return incoherent_field_count(context, {effect.id: points[-1]}) if points else 1


def without_costly_fits(
    context: SearchContext, fits: Sequence[CandidateFit], comparison: Comparison
) -> list[CandidateFit]:
    """The trials in their order, of those with many fields only such as leave clearly less than all others.

    Lost contrast imitates whatever is unknown; pictures of many fields pay only where nothing simpler does as well.
    """
    many = {id(t): is_costly(context, t) for t in fits}
    if not any(many.values()):
        return list(fits)
    left = {id(t): cost_or_inf(comparison, t.values) - comparison.pixel_count for t in fits}
    simple = [left[id(t)] for t in fits if not many[id(t)]]
    limit = max(_CLEARLY * min(simple, default=math.inf), _BY_CHANCE * comparison.pixel_count**0.5)
    return [t for t in fits if left[id(t)] <= limit or not many[id(t)]]


def is_costly(context: SearchContext, fit: CandidateFit) -> bool:
    """Whether a trial's predictions take long."""
    return incoherent_field_count(context, fit.values) >= MANY
