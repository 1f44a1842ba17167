"""A reflection adds a weak, shifted copy of the picture."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect, StartKind
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import CameraContext

_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1))


class Ghost(Effect):
    """signal(y, x) → signal(y, x) + strength·signal(y − shift_y, x − shift_x), in camera pixels."""

    id = "ghost"
    cause = "A reflection adds a weak, shifted copy of the picture."
    finding = "A ghost of {strength} of the picture's brightness lies {shift_y} (y) and {shift_x} (x) beside it."
    parameters = (
        Parameter("strength", "Brightness of the copy.", low=0.0, high=1.0, prior=0.05),
        Parameter("shift_y", "Shift of the copy in y (rows).", "px", low=-500.0, high=500.0, prior=10.0),
        Parameter("shift_x", "Shift of the copy in x (columns).", "px", low=-500.0, high=500.0, prior=10.0),
    )
    start_kinds = (StartKind.GHOST,)
    acts_on = ("camera",)
    order = 1

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Copies in eight directions; a diagnosis adds the peaks of the residual's correlation with the picture."""
        return [{"strength": 0.1, "shift_y": 8.0 * y, "shift_x": 8.0 * x} for y, x in _DIRECTIONS]

    def image(self, image: Tensor, context: CameraContext, v: Values) -> Tensor:
        return image + v["strength"] * context.shifted(image, (v["shift_y"], v["shift_x"]))
