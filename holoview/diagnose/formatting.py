"""Values with their intervals in customary units, to two digits of the interval: "0.1081 ± 0.0012 mm"."""

from __future__ import annotations

import math

from holoview.diagnose.uncertainty import Interval
from holoview.model.effects.parameter import Parameter
from holoview.model.effects.registry import get_effect
from holoview.util import units


def format_value(effect_id: str, parameter: str, interval: Interval) -> str:
    """Value ± half the width of its interval, and the unit, of a parameter of an effect."""
    whole = parameter.partition("[")[0]  # of an entry of a list, the list
    p = next(p for p in get_effect(effect_id).parameters if p.name == whole)
    value, half = (_number(p, x) for x in (interval.value, interval.half_width))
    if not math.isfinite(half):
        return f"{value:.3g} ± unknown {p.display_unit}".rstrip()
    decimals = max(0, min(12, 1 - math.floor(math.log10(half)))) if half > 0 else 6
    return f"{value:.{decimals}f} ± {half:.{decimals}f} {p.display_unit}".rstrip()


def format_number(effect_id: str, parameter: str, value: float) -> str:
    """A value to three digits, and its unit."""
    p = next(p for p in get_effect(effect_id).parameters if p.name == parameter)
    return f"{_number(p, value):.3g} {p.display_unit}".rstrip()


def _number(p: Parameter, value: float) -> float:
    """The value in the unit that the parameter is written in."""
    if not p.is_quantity or not math.isfinite(value):
        return value
    return float(units.format_exact(value, p.display_unit).split()[0])
