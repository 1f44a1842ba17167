"""Base class of the alignment effects of the second modulator and of the camera."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from holoview.model.effects.hook_contexts import Pose

Scan = tuple[float, float, float]


def alignment_parameters(
    reach_m: float, reach: float, rotation_scan: Scan, magnification_scan: Scan
) -> tuple[Parameter, ...]:
    """Shift, rotation and magnification within ±`reach_m`, ±`reach` rad and ±`reach`."""
    return (
        Parameter("shift_y", "Shift in y (rows).", "um", low=-reach_m, high=reach_m, prior=4e-6),
        Parameter("shift_x", "Shift in x (columns).", "um", low=-reach_m, high=reach_m, prior=4e-6),
        Parameter("rotation", "Turn from +x to +y.", "mrad", low=-reach, high=reach, prior=5e-3, scan=rotation_scan),
        Parameter(
            "magnification", "Relative enlargement.", low=-reach, high=reach, prior=5e-3, scan=magnification_scan
        ),
    )


class Alignment(Effect):
    """What should be at r is at (1 + magnification)·R(rotation)·r + shift."""

    @staticmethod
    def moved(pose: Pose, v: Values) -> Pose:
        """The pose after a further shift, rotation and magnification."""
        return dataclasses.replace(
            pose,
            shift_m=(pose.shift_m[0] + v["shift_y"], pose.shift_m[1] + v["shift_x"]),
            rotation_rad=pose.rotation_rad + v["rotation"],
            magnification=pose.magnification * (1 + v["magnification"]),
        )

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"percent": f"{100 * v['magnification']:.3g} %"}
