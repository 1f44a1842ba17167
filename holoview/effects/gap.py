"""The distance between the modulators differs from its nominal value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from holoview.model.effects.effect import Effect, Needs
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System
from holoview.util.units import format_rounded


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
    degenerate_with: ClassVar = ("aberration1",)
    needs = Needs(modulators=2, fourier=False)

    def actual_system(self, system: System, v: Values) -> System:
        assert system.gap_m is not None
        return system.with_(gap=system.gap_m + v["gap_error"])

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        assert system.gap_m is not None
        actual = system.gap_m + v["gap_error"]
        return {"actual": format_rounded(actual, "mm"), "nominal": format_rounded(system.gap_m, "mm")}
