"""Pictures that aren't sharp: blurred, smeared by a movement during the exposure, or with a weak shifted copy."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, StartKind, Values, half_circle
from holoview.light.model.system import System

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import CameraContext


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


class MotionBlur(Effect):
    """The mean picture of a camera whose place goes evenly from −length/2 to length/2 during the exposure.

    The spectrum of the light is multiplied by sin(πf·length)/(πf·length), f in cycles per pixel (Goodman, Introduction
    to Fourier Optics, 3rd ed., 8.8.1), before the pixels sample it: finer light than they resolve is smeared too, and
    light from beyond the picture moves in. Motion there and back is the same, hence length_y ≥ 0. The nominal position
    is that in the middle of the exposure.
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

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Eight directions and two lengths; a diagnosis adds the line that the residuals show."""
        return [start for length in (2.0, 6.0) for start in half_circle("length_y", "length_x", length, 8)]

    def camera_motion(self, length_px: tuple[float, float], v: Values) -> tuple[float, float]:
        return length_px[0] + v["length_y"], length_px[1] + v["length_x"]

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"length": f"{math.hypot(v['length_y'], v['length_x']):.3g} px"}


_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1))


def _copy_shift(name: str, doc: str) -> Parameter:
    return Parameter(name, doc, "px", low=-500.0, high=500.0, prior=10.0, modifies=("strength",))


class Ghost(Effect):
    """signal(y, x) → signal(y, x) + strength·signal(y − shift_y, x − shift_x), in camera pixels."""

    id = "ghost"
    cause = "A reflection adds a weak, shifted copy of the picture."
    finding = "A ghost of {strength} of the picture's brightness lies {shift_y} (y) and {shift_x} (x) beside it."
    parameters = (
        Parameter("strength", "Brightness of the copy.", low=0.0, high=1.0, prior=0.05),
        _copy_shift("shift_y", "Shift of the copy in y (rows)."),
        _copy_shift("shift_x", "Shift of the copy in x (columns)."),
    )
    start_kinds = (StartKind.GHOST,)
    acts_on = ("camera",)
    order = 1

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Copies in eight directions; a diagnosis adds the peaks of the residual's correlation with the picture."""
        return [{"strength": 0.1, "shift_y": 8.0 * y, "shift_x": 8.0 * x} for y, x in _DIRECTIONS]

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        return image + v["strength"] * context.shifted(image, (v["shift_y"], v["shift_x"]))
