"""Distances that differ from their nominal values: the gap between the modulators, and those of the focal planes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from holoview.light.model.effects.effect import DataProperties, Effect, Needs, Parameter, Values
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.units import format_rounded

_ROUNDING_M = 1e-15  # of a difference of distances below 1 m, which may miss 0


class Distance(Effect):
    """plane → plane + distance_error. Equivalent to defocus of relay 2, on a Fourier bench to a curved modulator."""

    id = "distance"
    cause = (
        "The camera's plane is closer to the last modulator or further from it than stated, or relay 2 is defocused."
    )
    finding = "The camera's plane is {amount} {side} the last modulator than its nominal distance."
    parameters = (
        Parameter(
            "distance_error",
            "Added to the distance of every plane.",
            "mm",
            low=-20e-3,
            high=20e-3,
            prior=0.2e-3,
            scan=(-0.6e-3, 0.6e-3, 0.1e-3),
        ),
    )
    acts_on = ("relay 2",)
    on_chain = ("phase", "amplitude", "complex")
    degenerate_with: ClassVar = ("aberration2",)

    def degeneracies(self, properties: DataProperties) -> tuple[str, ...]:
        return ("slm_flatness",) if properties.is_fourier else self.degenerate_with

    def actual_system(self, system: System, v: Values) -> System:
        planes_m = system.planes_m + v["distance_error"]
        if not system.is_field and (nearest_m := float(planes_m.min())) < -_ROUNDING_M:
            nominal, before = format_rounded(nearest_m - v["distance_error"], "mm"), format_rounded(-nearest_m, "mm")
            found = f"brings the plane at {nominal} to {before} before the last modulator"
            raise UserError("distance_error", found, expected="planes behind it", remedy="lower it, or move the planes")
        return system.with_(planes=planes_m if system.is_field else np.maximum(planes_m, 0.0))

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        error = v["distance_error"]
        return {"amount": format_rounded(abs(error), "mm"), "side": "further from" if error >= 0 else "closer to"}


class Gap(Effect):
    """gap → gap + gap_error. Equivalent to defocus of relay 1."""

    id = "gap"
    cause = "The gap between the modulators is longer or shorter than its nominal value (or relay 1 is defocused)."
    finding = "The gap is {actual}, not {nominal}."
    parameters = (
        Parameter(
            "gap_error", "Added to the gap.", "mm", low=-5e-3, high=5e-3, prior=0.2e-3, scan=(-0.5e-3, 0.5e-3, 0.1e-3)
        ),
    )
    acts_on = ("relay 1",)
    element_kinds = ("space",)
    degenerate_with: ClassVar = ("aberration1",)
    needs = Needs(modulators=2, fourier=False)

    def actual_system(self, system: System, v: Values) -> System:
        assert system.gap_m is not None
        return system.with_(gap=system.gap_m + v["gap_error"])

    def actual_element(self, system: System, element: str, v: Values) -> System:
        index = system.part(element)
        nominal_m: float | None = system.elements[index].distance_m  # type: ignore[attr-defined]  # of a space
        if nominal_m is None:
            found = "is the way to the planes, which has no distance of its own"
            raise UserError(element, found, expected="a space with one", remedy="use the effect distance")
        return system.edit({f"elements.{index}.distance": nominal_m + v["gap_error"]})

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        assert system.gap_m is not None
        actual = system.gap_m + v["gap_error"]
        return {"actual": format_rounded(actual, "mm"), "nominal": format_rounded(system.gap_m, "mm")}
