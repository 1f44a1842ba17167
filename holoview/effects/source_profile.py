"""The illumination isn't uniform over the first modulator."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.effects.starting_grids import square_grid
from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System
from holoview.util.units import format_rounded

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext


class SourceProfile(Effect):
    """amplitude = exp(−fall·|r|² + slope·r), with r in units of half the modulator's longer side.

    A Gaussian beam of waist w and centre c has fall = (half/w)² and slope = 2·fall·c/half. These parameters are zero
    for uniform illumination, where the waist is infinite and the centre undefined.
    """

    id = "source_profile"
    cause = "The illumination isn't flat: a Gaussian beam, or one that is off the centre."
    finding = "The illumination is {shape}."
    parameters = (
        Parameter("fall", "Fall of the amplitude's logarithm at the edge.", low=-2.0, high=8.0, prior=0.3),
        Parameter("slope_y", "Slope of the amplitude's logarithm in y.", low=-8.0, high=8.0, prior=0.2),
        Parameter("slope_x", "Slope of the amplitude's logarithm in x.", low=-8.0, high=8.0, prior=0.2),
    )
    acts_on = ("source",)
    varies_over_field = True

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [{"fall": fall} for fall in (0.2, 0.5, 1.0, 2.0, 4.0)] + square_grid("slope_y", "slope_x", 0.5, 0.5)

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        y, x = (place / context.half_width() for place in context.positions(transmission))
        logarithm = v["slope_y"] * y + v["slope_x"] * x - v["fall"] * (y * y + x * x)
        return transmission * logarithm.exp()

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        half = max(system.modulators[0].shape) * system.modulators[0].pitch_m / 2
        fall, slopes = v["fall"], (v["slope_y"], v["slope_x"])
        if fall <= 0.02:
            return {"shape": "brighter on one side" if any(slopes) else "brighter towards the edge"}
        centre = [format_rounded(slope / (2 * fall) * half, "um", 3) for slope in slopes]
        waist = format_rounded(half / fall**0.5, "mm", 3)
        return {
            "shape": f"a Gaussian beam of waist {waist} (1/e of amplitude), centred at y = {centre[0]}, x = {centre[1]}"
        }
