"""Light that isn't the lasers' reaches the camera: lamps, screens, daylight."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext

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
