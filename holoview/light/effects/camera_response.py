"""The counts of a camera: its response to light, its black level, and light that isn't the lasers'."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.system import System

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import CameraContext


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


class CameraBlack(Effect):
    """counts → counts + black."""

    id = "camera_black"
    cause = "The camera adds a constant: a wrong black level, or stray light."
    finding = "The camera's black level is off by {black}."
    parameters = (
        Parameter(
            "black", "Added to every pixel.", "counts", low=-4096.0, high=65535.0, prior=10.0, scan=(-60.0, 120.0, 20.0)
        ),
    )
    acts_on = ("camera",)

    def black_level_offset(self, v: Values) -> float:
        return float(v["black"])


_LEVELS = (60.0, 200.0, 600.0, 2000.0, 6000.0)


class Ambient(Effect):
    """counts → counts + max(level + slope_y·y + slope_x·x, 0)·exposure time; y and x go from −1 to 1 over the picture.

    It doesn't depend on the lasers' power, and it has its own shot noise. A black level differs from it in that it
    doesn't grow with the exposure time.
    """

    id = "ambient"
    cause = "Light that isn't the lasers' reaches the camera: of lamps, screens or windows."
    finding = (
        "Light of the room adds {level} in the picture's centre, {slope_y} more at its lower edge and {slope_x} more "
        "at its right edge."
    )
    parameters = (
        Parameter("level", "In the picture's centre.", "counts/s", low=0.0, high=1e7, prior=600.0),
        Parameter(
            "slope_y", "More at the lower edge, less at the upper edge.", "counts/s", low=-1e7, high=1e7, prior=200.0
        ),
        Parameter(
            "slope_x", "More at the right edge, less at the left edge.", "counts/s", low=-1e7, high=1e7, prior=200.0
        ),
    )
    acts_on = ("camera",)
    varies_over_field = True

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [{"level": level} for level in _LEVELS]

    def ambient_light(self, counts_per_s: Tensor, context: CameraContext, v: Values) -> Tensor:
        y, x = context.positions(counts_per_s)
        return counts_per_s + (v["level"] + v["slope_y"] * y + v["slope_x"] * x).clamp_min(0)
