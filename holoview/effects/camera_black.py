"""The camera's black level differs from its nominal value."""

from __future__ import annotations

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values


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
