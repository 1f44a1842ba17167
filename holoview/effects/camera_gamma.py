"""The camera isn't linear in light."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext


class CameraGamma(Effect):
    """signal → signal^(1 + exponent), before the black level. A constant factor is part of the fitted gain."""

    id = "camera_gamma"
    cause = "The camera's response isn't linear in light."
    finding = "The camera's signal rises as light to the {total}."
    parameters = (
        Parameter(
            "exponent", "Added to the exponent 1 of light.", low=-0.8, high=2.0, prior=0.1, scan=(-0.5, 0.6, 0.1)
        ),
    )
    acts_on = ("camera",)
    order = 9

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        return image.clamp_min(1e-12) ** (1 + v["exponent"])

    def finding_fields(self, system: object, v: Values) -> dict[str, str]:
        return {"total": f"{1 + v['exponent']:.3f}"}
