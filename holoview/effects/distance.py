"""The focal planes aren't at their nominal distances from the last modulator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from holoview.model.effects.effect import DataProperties, Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System
from holoview.util.units import format_rounded


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
    degenerate_with: ClassVar = ("aberration2",)

    def degeneracies(self, properties: DataProperties) -> tuple[str, ...]:
        return ("slm_flatness",) if properties.is_fourier else self.degenerate_with

    def actual_system(self, system: System, v: Values) -> System:
        return system.with_(planes=np.maximum(system.planes_m + v["distance_error"], 0.0))

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        error = v["distance_error"]
        return {"amount": format_rounded(abs(error), "mm"), "side": "further from" if error >= 0 else "closer to"}
