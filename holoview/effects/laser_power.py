"""A laser's light isn't proportional to the power that was set."""

from __future__ import annotations

from typing import Any

from holoview.model.effects.effect import Effect, Needs
from holoview.model.effects.parameter import Parameter, Values


class LaserPower(Effect):
    """emitted = power^(1 + exponent), both relative to the nominal power."""

    id = "laser_power"
    cause = "The lasers' light doesn't rise in proportion to the power that was set."
    finding = "The lasers' light rises as power to the {total}."
    parameters = (
        Parameter(
            "exponent", "Added to the exponent 1 of the power.", low=-0.9, high=3.0, prior=0.1, scan=(-0.5, 0.8, 0.1)
        ),
    )
    acts_on = ("source",)
    needs = Needs(powers=2)

    def laser_power(self, power: Any, v: Values) -> Any:
        return power ** (1 + v["exponent"])

    def finding_fields(self, system: Any, v: Values) -> dict[str, str]:
        return {"total": f"{1 + v['exponent']:.3f}"}
