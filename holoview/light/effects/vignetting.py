"""The picture gets darker towards its edges, or towards those of a sensor of which it is a part."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import CameraContext


_NEARLY_GAUSSIAN = 0.01
"""The |bend − 1| up to which the fall-off is computed from a series, whose next term is 1e-6·q⁴/4."""


class Vignetting(Effect):
    """signal → signal·(1 + (bend − 1)·q)^(1/(1 − bend)) with q = fall_y·y² + fall_x·x² − slope_y·y − slope_x·x.

    y and x go from −1 to 1 over the picture. bend 0 is a parabola, 1 − q, as from edges that cut off the pupil; bend 1
    is a Gaussian, exp(−q); and bend 1.5 is cos⁴ of the field angle θ, with tan²θ = q/2. Cut out about another point
    than its middle, as from a larger sensor, each has the same bend, and slopes, up to a factor that the gain has: for
    the parabola 1 − fall·|r − c|² the slope is 2·fall·c.
    """

    id = "vignetting"
    cause = "The camera's picture gets darker towards its edges, or those of the sensor of which it is a part."
    finding = "The picture falls off by {fall_y} (y) and {fall_x} (x) of its brightness towards its edges{centre}."
    parameters = (
        Parameter("fall_y", "Share lost at the upper and lower edge, if bend is 0.", low=-1.0, high=0.95, prior=0.1),
        Parameter("fall_x", "Share lost at the left and right edge, if bend is 0.", low=-1.0, high=0.95, prior=0.1),
        Parameter("slope_y", "Share more at the lower edge, less at the upper edge.", low=-1.0, high=1.0, prior=0.05),
        Parameter("slope_x", "Share more at the right edge, less at the left edge.", low=-1.0, high=1.0, prior=0.05),
        Parameter(
            "bend",
            "From a parabola, 0, over a Gaussian, 1, to cos⁴, 1.5.",
            low=-2.0,
            high=3.0,
            prior=1.0,
            secondary=True,
        ),
    )
    acts_on = ("camera",)
    varies_over_field = True

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [{"fall_y": fall, "fall_x": fall} for fall in (-0.15, -0.05, 0.05, 0.15, 0.25, 0.35)]

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        y, x = context.positions(image)
        q = v["fall_y"] * y.square() + v["fall_x"] * x.square() - v["slope_y"] * y - v["slope_x"] * x
        bend = v["bend"]
        if abs(bend - 1) < _NEARLY_GAUSSIAN:
            return image * ((bend - 1) * q * q / 2 - (bend - 1) ** 2 * q * q * q / 3 - q).exp()
        return image * (1 + (bend - 1) * q).clamp_min(0) ** (1 / (1 - bend))

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        if not v["slope_y"] and not v["slope_x"]:
            return {"centre": ""}
        lower, right = (f"{v[name]:.3g}" for name in ("slope_y", "slope_x"))
        return {"centre": f", and is brighter on one side: by {lower} at the lower, {right} at the right edge"}
