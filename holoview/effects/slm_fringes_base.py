"""Base class of the fringes that a modulator's cover glass makes, a weak etalon that light passes twice or more."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

from holoview.effects.fringe_depths import depth_parameters, describe_fringes, fringe_depths, wedge_starts
from holoview.model.effects.effect import Effect, StartKind
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext


class SlmFringes(Effect):
    """Fringes of one modulator's cover glass.

    modulator: 0 for the first.
    """

    modulator: ClassVar[int]
    finding = (
        "Fringes of depth {depth} lie over {modulator}; {fringes_y} (y) and {fringes_x} (x) of them fit onto it at "
        "550 nm: the cover glass is a wedge."
    )
    parameters = (
        Parameter(
            "path_y",
            "By how much the round trip in the glass is longer at the modulator's lower edge than at its upper edge.",
            "um",
            low=-2e-3,
            high=2e-3,
            prior=5e-6,
        ),
        Parameter(
            "path_x",
            "By how much the round trip in the glass is longer at the modulator's right edge than at its left edge.",
            "um",
            low=-2e-3,
            high=2e-3,
            prior=5e-6,
        ),
        *depth_parameters("the modulator's centre"),
    )
    start_kinds = (StartKind.MODULATOR_FRINGES,)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """A few wedges; a diagnosis adds those of the fringes that it sees in the residuals."""
        return wedge_starts()

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        cos, sin = fringe_depths(self.id, context.laser, v)
        if not cos and not sin:
            return transmission
        y, x = context.positions(transmission)
        half_y, half_x = (n * context.pitch_m / 2 for n in context.whole_shape)
        phase = (math.pi / context.wavelength_m) * (v["path_y"] / half_y * y + v["path_x"] / half_x * x)
        real = (cos * phase.cos() - sin * phase.sin()) / 2
        imaginary = (cos * phase.sin() + sin * phase.cos()) / 2
        return transmission * (1 + real + 1j * imaginary)

    def cache_values(self, v: Values, laser: int) -> tuple[float, ...]:
        """The wedge, and the depth at this laser alone."""
        depths = fringe_depths(self.id, laser, v)
        return (v["path_y"], v["path_x"], *depths) if any(depths) else ()

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {**describe_fringes(v), "modulator": f"modulator {self.modulator + 1}"}
