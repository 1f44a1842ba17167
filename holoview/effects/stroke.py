"""The modulators' stroke, the optical path of full drive, differs from its nominal value."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System
from holoview.util.units import format_rounded


class Stroke(Effect):
    """stroke → stroke·(1 + stroke_error ± difference), + for the first modulator and − for the second.

    The same everywhere on a modulator: the mean of a `stroke_map`.
    """

    id = "stroke"
    cause = "The modulators' stroke (the optical path of full drive) isn't its nominal value."
    finding = "The stroke is {strokes}, not {nominal}."
    parameters = (
        Parameter(
            "stroke_error", "Relative error of the stroke.", low=-0.9, high=2.0, prior=0.1, scan=(-0.5, 0.5, 0.05)
        ),
        Parameter(
            "difference",
            "Half the relative difference of the two strokes.",
            low=-0.5,
            high=0.5,
            prior=0.05,
            secondary=True,
        ),
    )
    acts_on = ("modulator 1", "modulator 2")
    degenerate_with: ClassVar = ("stroke_map",)

    def actual_system(self, system: System, v: Values) -> System:
        modulators = tuple(
            dataclasses.replace(m, stroke_m=m.stroke_m * (1 + v["stroke_error"] + sign * v["difference"]))
            for m, sign in zip(system.modulators, (1, -1), strict=False)
        )
        return dataclasses.replace(system, modulators=modulators)

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        strokes = [format_rounded(m.stroke_m, "nm") for m in self.actual_system(system, v).modulators]
        return {
            "strokes": " and ".join(dict.fromkeys(strokes)),
            "nominal": format_rounded(system.modulators[0].stroke_m, "nm"),
        }
