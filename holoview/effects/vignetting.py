"""The picture gets darker towards its edges."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext


class Vignetting(Effect):
    """signal → signal·(1 − fall_y·y² − fall_x·x²), with y and x from −1 to 1 over the picture."""

    id = "vignetting"
    cause = "The camera's picture gets darker towards its edges."
    finding = "The picture falls off by {fall_y} (y) and {fall_x} (x) of its brightness towards its edges."
    parameters = (
        Parameter("fall_y", "Share lost at the upper and lower edge.", low=-1.0, high=0.95, prior=0.1),
        Parameter("fall_x", "Share lost at the left and right edge.", low=-1.0, high=0.95, prior=0.1),
    )
    acts_on = ("camera",)
    varies_over_field = True

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [{"fall_y": fall, "fall_x": fall} for fall in (-0.15, -0.05, 0.05, 0.15, 0.25, 0.35)]

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        y, x = context.positions(image)
        return image * (1 - v["fall_y"] * y.square() - v["fall_x"] * x.square()).clamp_min(0)
