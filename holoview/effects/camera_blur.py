"""The camera's picture is blurred in intensity, by its optics or by light that spreads between pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext


class CameraBlur(Effect):
    """signal → signal convolved with a Gaussian of standard deviation `sigma` camera pixels."""

    id = "camera_blur"
    cause = "The camera blurs: its optics, or light that spreads between its pixels."
    finding = "The camera's picture is blurred by {sigma} (standard deviation)."
    parameters = (
        Parameter(
            "sigma",
            "Standard deviation of the blur.",
            "px",
            low=0.0,
            high=20.0,
            prior=0.5,
            scan=(0.4, 3.0, 0.2),
            even_symmetric=True,
        ),
    )
    acts_on = ("camera",)
    order = 2

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        return context.blurred(image, v["sigma"])
