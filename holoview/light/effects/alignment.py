"""The second modulator isn't imaged exactly onto the first, or the camera's picture isn't rectified exactly."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Needs, Parameter, Values, square_grid
from holoview.light.model.system import System

if TYPE_CHECKING:
    from holoview.light.model.effects.hook_contexts import Pose


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
    """A point that should be at r is at (1 + magnification)·R(rotation)·r + shift."""

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


class SlmAlignment(Alignment):
    """The pixel of modulator 2 that should be at r is at (1 + magnification)·R(rotation)·r + shift."""

    id = "slm_alignment"
    cause = "The second modulator isn't aligned with the first: it is shifted, turned or magnified."
    finding = (
        "Modulator 2 is shifted by {shift_y} (y) and {shift_x} (x), turned by {rotation} and magnified by {percent}."
    )
    parameters = alignment_parameters(1e-3, 0.2, (-28e-3, 28e-3, 3.5e-3), (-0.03, 0.03, 0.005))
    acts_on = ("modulator 2",)
    instead = "`misplaced`, with the element that it moves"
    varies_over_field = True
    needs = Needs(modulators=2, fourier=False)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        pitch = system.modulators[0].pitch_m
        return [*square_grid("shift_y", "shift_x", 1.5 * pitch, 0.5 * pitch), *super().starting_points(system)]

    def slm2_pose(self, pose: Pose, v: Values) -> Pose:
        return self.moved(pose, v)


class CameraAlignment(Alignment):
    """A point that should be at r in the picture is at (1 + magnification)·R(rotation)·r + shift."""

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
            secondary=True,
        ),
    )
    acts_on = ("camera",)
    varies_over_field = True

    def camera_pose(self, pose: Pose, v: Values) -> Pose:
        return dataclasses.replace(self.moved(pose, v), softness=v["softness"])
