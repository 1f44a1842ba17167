"""The camera's picture isn't rectified exactly: it is shifted, rotated or magnified."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from holoview.effects.alignment_base import Alignment, alignment_parameters
from holoview.model.effects.parameter import Parameter, Values

if TYPE_CHECKING:  # torch takes seconds to import
    from holoview.model.effects.hook_contexts import Pose


class CameraAlignment(Alignment):
    """What should be at r in the picture is at (1 + magnification)·R(rotation)·r + shift."""

    id = "camera_alignment"
    cause = "The camera's picture is shifted, turned or magnified."
    finding = (
        "The picture is shifted by {shift_y} (y) and {shift_x} (x), turned by {rotation} and magnified by {percent}."
    )
    parameters = (
        *alignment_parameters(10e-3, 0.5, (-35e-3, 35e-3, 5e-3), (-0.04, 0.04, 0.005)),
        Parameter(
            "softness",
            "Share of the picture that was rectified by linear interpolation between pixels, which blurs it.",
            low=0.0,
            high=1.0,
            prior=0.5,
            fine=True,
        ),
    )
    acts_on = ("camera",)
    varies_over_field = True

    def camera_pose(self, pose: Pose, v: Values) -> Pose:
        return dataclasses.replace(self.moved(pose, v), softness=v["softness"])
