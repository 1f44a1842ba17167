"""How many fields a prediction adds incoherently, which is what it costs, and what the search of an effect costs.

Bandwidth, an extended source and flicker make one image of many fields: wavelengths × directions × moments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from holoview.diagnose.comparison import Comparison, Values
from holoview.diagnose.effect_fit import CandidateFit, cost_or_inf
from holoview.diagnose.search_context import SearchContext, field_samples
from holoview.model.effects.effect import BENCH_HOOKS, CAMERA_HOOKS, MODULATOR_HOOKS, Effect
from holoview.util.errors import UserError


def incoherent_field_count(context: SearchContext, values: Values) -> int:
    """Fields of one capture with these effects; 1 for values that no bench can have."""
    system, moments = context.system, 1
    nominal_lines = len(system.wavelengths_m)
    for name, own in values.items():
        effect = context.effects[name]
        try:
            complete = effect.parameter_values(own)
            system, moments = effect.actual_system(system, complete), moments * len(effect.exposure_samples(complete))
        except UserError:
            return 1
    return len(system.wavelengths_m) // nominal_lines * len(system.source.directions_rad) * moments


def max_field_count(context: SearchContext, effect: Effect) -> int:
    """Fields of one capture at the last point of an effect's scan."""
    points = list(effect.starting_points(context.system))
    return incoherent_field_count(context, {effect.id: points[-1]}) if points else 1


def search_cost(context: SearchContext, effect: Effect) -> float:
    """How much a search costs: points of its scan × fields of a prediction × how early it acts on the light."""
    config = context.config.screening
    points = len(list(effect.starting_points(context.system))) + config.points_per_parameter * len(effect.parameters)
    if any(effect.overrides(hook) for hook in (*BENCH_HOOKS, *MODULATOR_HOOKS) if hook != "laser_power"):
        return points * (config.upstream_cost * max_field_count(context, effect))
    on_camera = any(effect.overrides(hook) for hook in CAMERA_HOOKS)
    return points * (config.camera_pose_cost if on_camera else config.downstream_cost)


def is_costly_effect(context: SearchContext, effect: Effect) -> bool:
    """Whether predictions with this effect add many fields."""
    return max_field_count(context, effect) >= context.config.budget.costly_fields


def is_very_costly_effect(context: SearchContext, effect: Effect) -> bool:
    """Whether predictions with this effect add very many fields."""
    return max_field_count(context, effect) >= context.config.budget.very_costly_fields


def is_costly(context: SearchContext, fit: CandidateFit) -> bool:
    """Whether predictions with these values add many fields."""
    return incoherent_field_count(context, fit.values) >= context.config.budget.costly_fields


def is_slow(context: SearchContext, fit: CandidateFit) -> bool:
    """Whether a prediction with these values takes as long as a costly one of usual fields."""
    budget = context.config.budget
    size = max(1.0, field_samples(context.data.captures) / budget.usual_samples)
    return size * incoherent_field_count(context, fit.values) >= budget.costly_fields


def is_very_costly(context: SearchContext, fit: CandidateFit) -> bool:
    """Whether predictions with these values add very many fields."""
    return incoherent_field_count(context, fit.values) >= context.config.budget.very_costly_fields


def without_costly_fits(
    context: SearchContext, fits: Sequence[CandidateFit], comparison: Comparison
) -> list[CandidateFit]:
    """The fits in their order; of the costly ones only those that leave clearly less than all others.

    Lost contrast imitates whatever is unknown, so many fields are worth computing only where nothing simpler does as
    well.
    """
    costly = {id(f): is_costly(context, f) for f in fits}
    if not any(costly.values()):
        return list(fits)
    budget = context.config.budget
    left = {id(f): cost_or_inf(comparison, f.values) - comparison.pixel_count for f in fits}
    simple = [left[id(f)] for f in fits if not costly[id(f)]]
    by_chance = budget.costly_chance * comparison.pixel_count**0.5
    limit = max(budget.costly_excess_share * min(simple, default=math.inf), by_chance)
    return [f for f in fits if left[id(f)] <= limit or not costly[id(f)]]
