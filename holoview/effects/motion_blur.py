"""The camera moves along a line during the exposure, which smears the picture."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.effects.starting_grids import half_circle
from holoview.model.effects.effect import Effect, StartKind
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext


class MotionBlur(Effect):
    """signal → signal convolved with a line from −length/2 to length/2: uniform motion during the exposure.

    Its spectrum is multiplied by sin(πf·length)/(πf·length), f in cycles per pixel (Goodman, Introduction to Fourier
    Optics, 3rd ed., 8.8.1). Motion there and back is the same, hence length_y ≥ 0. The nominal position is that in the
    middle of the exposure.
    """

    id = "motion_blur"
    cause = "The camera or its stage moves during the exposure, which smears the picture."
    finding = "The picture is smeared over {length} during the exposure, {length_y} (y) and {length_x} (x)."
    parameters = (
        Parameter("length_y", "Distance moved in y (rows) during an exposure.", "px", low=0.0, high=100.0, prior=1.0),
        Parameter(
            "length_x",
            "Distance moved in x (columns) during an exposure; positive where x grows with y.",
            "px",
            low=-100.0,
            high=100.0,
            prior=1.0,
        ),
    )
    start_kinds = (StartKind.SMEAR,)
    acts_on = ("camera",)
    order = 2

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Eight directions and two lengths; a diagnosis adds the line that the residuals show."""
        return [start for length in (2.0, 6.0) for start in half_circle("length_y", "length_x", length, 8)]

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        return context.smeared(image, (v["length_y"], v["length_x"]))

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"length": f"{math.hypot(v['length_y'], v['length_x']):.3g} px"}
