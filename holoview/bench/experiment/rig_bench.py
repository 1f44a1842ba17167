"""The nominal bench of a rig as a system, and whether another system describes the same bench.

The alignment of a rig as a diagnosis needs it; causes within its uncertainty are no faults.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.nominal_bench import stated_keys
from holoview.bench.diagnose.calibration_prior import MAX_DEVIATIONS, is_within
from holoview.bench.diagnose.likelihood import Values
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.bench.rig.capture_plan import default_distances
from holoview.bench.rig.description import RigDescription, read_rig
from holoview.bench.rig.registration import Registration
from holoview.light.model.bench_parts import Source
from holoview.light.model.fields import to_mapping
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError

_SAME = 1e-6  # relative; the rounding of a value written to a file
_EYE_M = (390e-9, 830e-9)
_WHITE_LASERS = 3  # fewer can't be balanced to white
_OF_OPTIMISER = ("shared", "held", "step", "name")  # keys of elements that say nothing of the bench


def system_of_rig(rig: RigDescription) -> System:
    """The nominal bench with all lasers, at three planes within the stage's limits.

    Three lasers or more are balanced to white and seen by an eye, fewer by a mono camera. On a Fourier bench the lens
    isn't part of the system: its one plane is next to the modulator.
    """
    system = rig.blank_capture().nominal_system(list(rig.wavelengths_m), default_distances(rig).tolist())
    low, high = _EYE_M
    if len(rig.wavelengths_m) >= _WHITE_LASERS and low <= rig.wavelengths_m[0] and rig.wavelengths_m[-1] <= high:
        system = system.edit({"observer": "eye", "amplitudes": "white"})
    return system.edit({"name": rig.name})


def on_rig(system: System, rig: RigDescription) -> System:
    """A system that describes a rig, with the rig's levels where its modulators have none.

    Raises UserError, which names the differences, for a system of another bench, and for features that a camera behind
    a rig can't record: an eye, several directions of the source, planes and lasers that the rig doesn't reach or have.
    """
    if rig.bench.focal_length_m is not None:
        raise UserError(f"{rig.path}: geometry.focal_length", "a Fourier bench", expected="a bench in the near field")
    if system.eye is not None:
        raise UserError("eye", "with --rig", expected="no eye: the camera stands in the focal planes")
    if system.source != Source():
        raise UserError("source", "isn't a single wave on the axis", expected="one plane wave, as on the rig")
    for key, found, expected in _differences(system, rig):
        remedy = "use the rig's own bench (its TOML file as the preset), or correct one of them"
        raise UserError(key, f"is {found}", expected=f"{expected} as in {rig.path}", remedy=remedy)
    for λ in system.wavelengths_m:
        _laser(float(λ), rig)
    for z in system.planes_m:
        rig.limits.require_distance(float(z))
    if not (system.amplitudes > 0).any(axis=0).all():
        remedy = "leave it out of wavelengths"
        raise UserError("amplitudes", "a laser is off in every frame", expected="each on in some frame", remedy=remedy)
    return _with_levels(system, rig)


def _with_levels(system: System, rig: RigDescription) -> System:
    """A system with the rig's levels where its modulators have none."""
    place = "elements.{}.levels" if system.is_chain else "modulators.{}.levels"
    levels = {
        place.format(key): list(slm.shares) or slm.num_levels
        for slm, (key, modulator) in zip(rig.bench.slms, shown_by(system).items(), strict=True)
        if modulator.levels is None
    }
    return system.edit(levels) if levels else system


def shown_by(system: System) -> dict[Any, Any]:
    """What shows levels: modulators by their number from 0, elements of a chain by their name."""
    if not system.is_chain:
        return dict(enumerate(system.modulators))
    return {name: system.elements[system.part(name)] for name in system.drive_shapes}


def lasers_of(system: System, rig: RigDescription) -> list[float]:
    """The rig's wavelength of each laser of a system."""
    return [_laser(float(λ), rig) for λ in system.wavelengths_m]


def levels_of_drive(drive: Any, system: System) -> NDArray[np.uint16]:
    """The grey levels (frame, modulator, y, x) nearest to a drive; smaller patterns in the first rows and columns.

    drive: (frame, modulator, y, x), of a chain (frame, y, x) by element, where one frame may be all.
    """
    shapes = system.drive_shapes.values()
    size = (system.frames, len(shapes), *(max(shape[axis] for shape in shapes) for axis in (1, 2)))
    result = np.zeros(size, np.uint16)
    for i, (key, modulator) in enumerate(shown_by(system).items()):
        own = drive[key] if system.is_chain else drive[:, i]
        middles = (modulator.levels[1:] + modulator.levels[:-1]) / 2
        result[:, i, : own.shape[1], : own.shape[2]] = np.searchsorted(middles, own)
    return result


def drive_of_levels(levels: NDArray[np.unsignedinteger], system: System) -> Any:
    """The drive of every frame for grey levels (modulator, y, x): that of which `levels_of_drive` gives these."""
    drives = {}
    for name, shape, own, modulator in zip(
        system.drive_shapes, system.drive_shapes.values(), levels, shown_by(system).values(), strict=True
    ):
        shown = modulator.levels[own[: shape[1], : shape[2]]].astype(np.float32)
        drives[name] = np.broadcast_to(shown, shape).copy()
    return drives if system.is_chain else np.stack(list(drives.values()), axis=1)


def _differences(system: System, rig: RigDescription) -> list[tuple[str, str, str]]:
    """Key, value of the system, value of the rig, of all that differs."""
    bench, found = rig.bench, []
    if bench.chain is not None or system.is_chain:
        return _chain_differences(system, rig)
    if len(system.modulators) != len(bench.slms):
        return [("modulators", f"{len(system.modulators)} of them", f"{len(bench.slms)}")]
    for i, (slm, modulator) in enumerate(zip(bench.slms, system.modulators, strict=True)):
        if modulator.shape != rig.slm_shape:
            found.append((f"modulators.{i}.shape", str(list(modulator.shape)), str(list(rig.slm_shape))))
        for key, unit, own, other in (
            ("pitch", "um", modulator.pitch_m, slm.pitch_m),
            ("stroke", "nm", modulator.stroke_m, slm.opd_range_m),
        ):
            found += _unequal(f"modulators.{i}.{key}", [own], [other], unit)
        if modulator.levels is not None and len(modulator.levels) != slm.num_levels:
            found.append((f"modulators.{i}.levels", f"{len(modulator.levels)} levels", f"{slm.num_levels}"))
    if system.gap_m is not None:
        found += _unequal("gap", [system.gap_m], [bench.gap_m or 0.0], "mm")
    for key, own_relay, relay in (("relay1", system.relay1, bench.relay1), ("relay2", system.relay2, bench.relay2)):
        if stated_keys(own_relay) != stated_keys(relay):
            found.append((key, _described(stated_keys(own_relay)), _described(stated_keys(relay))))
    return found


def _chain_differences(system: System, rig: RigDescription) -> list[tuple[str, str, str]]:
    """As `_differences`, where one of them is a chain; how an optimiser moves patterns is no difference."""
    chain = rig.bench.chain
    if chain is None or system.element_names != chain.element_names:
        names = rig.slm_words if chain is None else chain.element_names
        return [("elements", ", ".join(system.element_names), ", ".join(names))]
    found, chain = [], _with_levels(chain, rig)
    for name, own, other in zip(system.element_names, system.elements, chain.elements, strict=True):
        ours, theirs = ({"kind": e.kind, **to_mapping(e)} for e in (own, other))
        for key in sorted({*ours, *theirs} - {*_OF_OPTIMISER, *(() if ours.get("levels") else ("levels",))}):
            if ours.get(key) != theirs.get(key):
                found.append((f"elements.{name}.{key}", f"{ours.get(key)}", f"{theirs.get(key)}"))
    if system.planes_from != chain.planes_from:
        found.append(("planes_from", f'"{system.planes_from}"', f'"{chain.planes_from}"'))
    return found


def _unequal(key: str, own: Sequence[float], other: Sequence[float], unit: str) -> list[tuple[str, str, str]]:
    return [
        (key, units.format_rounded(a, unit), units.format_rounded(b, unit))
        for a, b in zip(own, other, strict=True)
        if not np.isclose(a, b, rtol=_SAME, atol=0.0)
    ]


def _described(relay: dict[str, Any]) -> str:
    return ", ".join(f"{key} {value}" for key, value in relay.items()) or "without stops"


def _laser(wavelength_m: float, rig: RigDescription) -> float:
    nearest = min(rig.wavelengths_m, key=lambda λ: abs(λ - wavelength_m))
    if not np.isclose(nearest, wavelength_m, rtol=_SAME, atol=0.0):
        known = ", ".join(units.format_rounded(λ, "nm") for λ in rig.wavelengths_m)
        found = units.format_rounded(wavelength_m, "nm")
        raise UserError("wavelengths", found, expected=f"one of the rig's lasers: {known}")
    return nearest


def read_rig_system(path: Path) -> System:
    """The bench of rig.toml. Raises UserError for a wrong description."""
    return system_of_rig(read_rig(path))


# --- an aligned rig ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class KnownEffects:
    """Known effects of a bench: stated effects by name, and the places that `rig align` has found."""

    effects: Values
    registrations: Sequence[Registration]

    def added_to(self, known: Values) -> dict[str, dict[str, float]]:
        """Known effects with the stated effects; these count where both have a parameter."""
        result = {name: dict(values) for name, values in known.items()}
        for table in (*(registration.known_effects() for registration in self.registrations), self.effects):
            for name, values in table.items():
                result[name] = result.get(name, {}) | dict(values)
        return result

    def with_placement(self, placement: Registration | None) -> KnownEffects:
        """The same beside the placement of an aligned rig (else None); stated effects count where both have a value."""
        return self if placement is None else replace(self, registrations=[placement, *self.registrations])

    @property
    def uncertain(self) -> dict[str, dict[str, float]]:
        """Standard deviations of the effects that registrations know."""
        return {
            name: own for registration in self.registrations for name, own in registration.uncertain_effects().items()
        }

    def with_notes(self, found: Diagnosis) -> Diagnosis:
        """The diagnosis, with a note on causes within a registration's uncertainty."""
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
