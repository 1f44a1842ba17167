"""The alignment of a rig as a diagnosis needs it; causes within its uncertainty are no faults."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from holoview.diagnose.calibration_prior import MAX_DEVIATIONS, is_within
from holoview.diagnose.likelihood import Values
from holoview.diagnose.report.diagnosis import Diagnosis
from holoview.rig.registration import Registration


@dataclass(frozen=True)
class KnownEffects:
    """Known effects of a bench: stated effects by name, and the places that `rig align` has found."""

    effects: Values
    registrations: Sequence[Registration]

    def added_to(self, known: Values) -> dict[str, dict[str, float]]:
        """Known effects with the stated ones; these count where both have a parameter."""
        result = {name: dict(values) for name, values in known.items()}
        for table in (*(registration.known_effects() for registration in self.registrations), self.effects):
            for name, values in table.items():
                result[name] = result.get(name, {}) | dict(values)
        return result

    @property
    def uncertain(self) -> dict[str, dict[str, float]]:
        """Standard deviations of what registrations know."""
        return {
            name: own for registration in self.registrations for name, own in registration.uncertain_effects().items()
        }

    def with_notes(self, found: Diagnosis) -> Diagnosis:
        """The diagnosis, with a note on causes that lie within what a registration has left open."""
        within = [name for registration in self.registrations for name in within_alignment(registration, found.values)]
        notes = (*found.notes, refinement_note(within)) if within else found.notes
        return replace(found, notes=notes)


def within_alignment(registration: Registration, found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The ids of effects as small as the registration is uncertain. found: {id: {parameter: value}}, SI units."""
    return [effect for effect, values in found.items() if _is_within(registration, effect, values)]


def diagnosis_options(registration: Registration | None) -> dict[str, Mapping[str, Mapping[str, float]]]:
    """Options of `diagnose`: known effects of a rig and their uncertainties; empty for a rig that wasn't aligned."""
    if registration is None:
        return {"known": {}, "uncertain": {}}
    return {"known": registration.known_effects(), "uncertain": registration.uncertain_effects()}


def refinement_note(effects: Sequence[str]) -> str:
    """A sentence on effects within the alignment's uncertainties."""
    names, verb = " and ".join(effects), "refines" if len(effects) == 1 else "refine"
    return (
        f"{names} {verb} the placement: `rig align` left so much open (up to {MAX_DEVIATIONS:.0f} standard "
        "deviations), so it need not be a fault of the bench."
    )


def _is_within(registration: Registration, effect: str, values: Mapping[str, Any]) -> bool:
    sigmas = registration.uncertain_effects()
    if effect != "plane_errors":
        return is_within(values, sigmas.get(effect, {}), MAX_DEVIATIONS)
    offset, scale = sigmas["distance"]["distance_error"], sigmas["stage"]["scale"]
    planes = {str(z): math.hypot(offset, registration.setting_m(z) * scale) for z in values["distances"]}
    return is_within(dict(zip(planes, values["errors"], strict=True)), planes, MAX_DEVIATIONS)
