"""Causes of a diagnosis within what an alignment has left open: they refine the placement, and are no fault."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from holoview.rig.placement import EFFECT_PARAMETERS, Placement

_MOST_DEVIATIONS = 3.0


def within_alignment(placement: Placement, found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The ids of effects that are as small as the placement is uncertain. found: {id: {parameter: value}}, SI units."""
    return [effect for effect, values in found.items() if _is_within(placement, effect, values)]


def refinement_note(effects: Sequence[str]) -> str:
    """A sentence on effects within the alignment's uncertainties."""
    names, verb = " and ".join(effects), "refines" if len(effects) == 1 else "refine"
    return (
        f"{names} {verb} the placement: `rig align` left so much open (up to {_MOST_DEVIATIONS:.0f} standard "
        "deviations), so it need not be a fault of the bench."
    )


def _is_within(placement: Placement, effect: str, values: Mapping[str, Any]) -> bool:
    if effect == "distance":
        return _is_small(values["distance_error"], _sigma(placement, "stage_offset"))
    if effect == "plane_errors":
        planes = zip(values["distances"], values["errors"], strict=True)
        return all(_is_small(error, _plane_sigma(placement, z)) for z, error in planes)
    sigmas = {parameter: _sigma(placement, name) for name, parameter in EFFECT_PARAMETERS.items()}
    sigmas["stage.scale"] = _sigma(placement, "stage_scale")
    names = [f"{effect}.{parameter}" for parameter in values]
    return all(n in sigmas for n in names) and all(
        _is_small(value, sigmas[n]) for n, value in zip(names, values.values(), strict=True)
    )


def _plane_sigma(placement: Placement, distance_m: float) -> float:
    """Standard deviation of a distance (m), its zero and its scale taken as independent."""
    setting = placement.setting_m(distance_m)
    return math.hypot(_sigma(placement, "stage_offset"), setting * _sigma(placement, "stage_scale"))


def _sigma(placement: Placement, name: str) -> float:
    return placement.values[name].uncertainty if name in placement.values else 0.0


def _is_small(value: float, sigma: float) -> bool:
    return abs(value) <= _MOST_DEVIATIONS * sigma
