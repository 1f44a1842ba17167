"""Base class of the irises of both relays: a wrong radius and a decentred aperture."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

from holoview.effects.starting_grids import square_grid
from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System
from holoview.util.units import format_rounded

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import RelayContext

PARAMETERS = (
    Parameter(
        "radius_error",
        "Relative error of the radius.",
        low=-0.9,
        high=4.0,
        prior=0.1,
        scan=(-0.5, 0.5, 0.1),
        sharp=True,
    ),
    Parameter("decentre_y", "Shift in y, in nominal radii.", low=-2.0, high=2.0, prior=0.1, sharp=True),
    Parameter("decentre_x", "Shift in x, in nominal radii.", low=-2.0, high=2.0, prior=0.1, sharp=True),
)


class Iris(Effect):
    """Aperture na → na·(1 + radius_error), with its centre at the direction sines na·(decentre_y, decentre_x)."""

    relay: ClassVar[str]
    parameters = PARAMETERS

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [*super().starting_points(system), *square_grid("decentre_y", "decentre_x", 0.4, 0.2)]

    def bench(self, system: System, v: Values) -> System:
        """The iris itself if it is centred, else the smallest centred one that contains it; `pupil` does the rest."""
        relay = getattr(system, self.relay)
        decentre = (v["decentre_y"] ** 2 + v["decentre_x"] ** 2) ** 0.5
        iris_na = min(relay.iris_na * (1 + v["radius_error"] + decentre), 1.0)
        return dataclasses.replace(system, **{self.relay: dataclasses.replace(relay, iris_na=iris_na)})

    def pupil(self, pupil: Tensor, context: RelayContext, v: Values) -> Tensor:
        centre_y, centre_x = (context.iris_na * v[name] for name in ("decentre_y", "decentre_x"))
        if centre_y == 0 and centre_x == 0:
            return pupil
        radius = context.iris_na * (1 + v["radius_error"])
        return pupil * ((context.sine_y - centre_y) ** 2 + (context.sine_x - centre_x) ** 2 <= radius**2)

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        na = getattr(system, self.relay).iris_na
        decentre = (v["decentre_y"], v["decentre_x"])
        y, x = (format_rounded(na * shift, "mrad", 3) for shift in decentre)
        beside = f", off its centre by {y} (y) and {x} (x)"
        return {
            "actual": f"{na * (1 + v['radius_error']):.4g}",
            "nominal": f"{na:.4g}",
            "beside": beside * any(decentre),
        }
