"""Causes of a diagnosis within what an alignment has left open: they refine the placement, and are no fault."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from holoview.diagnose.calibration_prior import MAX_DEVIATIONS, is_within
from holoview.rig.placement import Placement

_MOST_DEVIATIONS = MAX_DEVIATIONS


def within_alignment(placement: Placement, found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The ids of effects that are as small as the placement is uncertain. found: {id: {parameter: value}}, SI units."""
    return [effect for effect, values in found.items() if _is_within(placement, effect, values)]


def diagnosis_options(placement: Placement | None) -> dict[str, Mapping[str, Mapping[str, float]]]:
    """What `diagnose` is told of a rig: known effects and their uncertainties; nothing of one that wasn't aligned."""
    if placement is None:
        return {"known": {}, "uncertain": {}}
    return {"known": placement.known_effects(), "uncertain": placement.uncertain_effects()}


def refinement_note(effects: Sequence[str]) -> str:
    """A sentence on effects within the alignment's uncertainties."""
    names, verb = " and ".join(effects), "refines" if len(effects) == 1 else "refine"
    return (
        f"{names} {verb} the placement: `rig align` left so much open (up to {_MOST_DEVIATIONS:.0f} standard "
        "deviations), so it need not be a fault of the bench."
    )


def _is_within(placement: Placement, effect: str, values: Mapping[str, Any]) -> bool:
    sigmas = placement.uncertain_effects()
    if effect != "plane_errors":
        return is_within(values, sigmas.get(effect, {}), _MOST_DEVIATIONS)
    offset, scale = sigmas["distance"]["distance_error"], sigmas["stage"]["scale"]
    planes = {str(z): math.hypot(offset, placement.setting_m(z) * scale) for z in values["distances"]}
    return is_within(dict(zip(planes, values["errors"], strict=True)), planes, _MOST_DEVIATIONS)
