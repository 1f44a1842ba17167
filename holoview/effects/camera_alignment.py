"""The camera's picture isn't rectified exactly: it is moved, turned or magnified."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:
    from holoview.model.effects.hook_contexts import Pose


class CameraAlignment(Effect):
    """What should be at r in the picture is at (1 + magnification)·R(rotation) r + shift."""

    id = "camera_alignment"
    cause = "The camera's picture is shifted, turned or magnified."
    finding = (
        "The picture is shifted by {shift_y} (y) and {shift_x} (x), turned by {rotation} and magnified by {percent}."
    )
    parameters = (
        Parameter("shift_y", "Shift in y (rows).", "um", low=-10e-3, high=10e-3, prior=4e-6),
        Parameter("shift_x", "Shift in x (columns).", "um", low=-10e-3, high=10e-3, prior=4e-6),
        Parameter(
            "rotation", "Turn from +x to +y.", "mrad", low=-0.5, high=0.5, prior=5e-3, scan=(-35e-3, 35e-3, 5e-3)
        ),
        Parameter("magnification", "Relative enlargement.", low=-0.5, high=0.5, prior=5e-3, scan=(-0.04, 0.04, 0.005)),
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

    def camera_pose(self, pose: Pose, v: Values) -> Pose:
        return dataclasses.replace(
            pose,
            shift_m=(pose.shift_m[0] + v["shift_y"], pose.shift_m[1] + v["shift_x"]),
            rotation_rad=pose.rotation_rad + v["rotation"],
            magnification=pose.magnification * (1 + v["magnification"]),
            softness=v["softness"],
        )

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"percent": f"{100 * v['magnification']:.3g} %"}
