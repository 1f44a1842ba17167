"""Causes of a diagnosis within what an alignment has left open: they refine the placement, and are no fault."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from holoview.rig.placement import Placement

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
    sigmas = placement.uncertain_effects()
    if effect == "plane_errors":
        offset, scale = sigmas["distance"]["distance_error"], sigmas["stage"]["scale"]
        allowed = [math.hypot(offset, placement.setting_m(z) * scale) for z in values["distances"]]
        errors = list(values["errors"])
    else:
        own = sigmas.get(effect, {})
        allowed, errors = [own.get(name, 0.0) for name in values], list(values.values())
    return all(abs(error) <= _MOST_DEVIATIONS * sigma for error, sigma in zip(errors, allowed, strict=True))
