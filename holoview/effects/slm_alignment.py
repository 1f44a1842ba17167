"""The second modulator isn't imaged exactly onto the first: it is moved, turned or magnified."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.effects.starting_grids import square_grid
from holoview.model.effects.effect import Effect, Needs
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:
    from holoview.model.effects.hook_contexts import Pose


class SlmAlignment(Effect):
    """Modulator 2's pixel that should be at r is at (1 + magnification)·R(rotation) r + shift."""

    id = "slm_alignment"
    cause = "The second modulator isn't aligned with the first: it is shifted, turned or magnified."
    finding = (
        "Modulator 2 is shifted by {shift_y} (y) and {shift_x} (x), turned by {rotation} and magnified by {percent}."
    )
    parameters = (
        Parameter("shift_y", "Shift in y (rows).", "um", low=-1e-3, high=1e-3, prior=4e-6),
        Parameter("shift_x", "Shift in x (columns).", "um", low=-1e-3, high=1e-3, prior=4e-6),
        Parameter(
            "rotation", "Turn from +x to +y.", "mrad", low=-0.2, high=0.2, prior=5e-3, scan=(-28e-3, 28e-3, 3.5e-3)
        ),
        Parameter("magnification", "Relative enlargement.", low=-0.2, high=0.2, prior=5e-3, scan=(-0.03, 0.03, 0.005)),
    )
    acts_on = ("modulator 2",)
    needs = Needs(modulators=2, fourier=False)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        pitch = system.modulators[0].pitch_m
        return [*square_grid("shift_y", "shift_x", 1.5 * pitch, 0.5 * pitch), *super().starting_points(system)]

    def slm2_pose(self, pose: Pose, v: Values) -> Pose:
        return dataclasses.replace(
            pose,
            shift_m=(pose.shift_m[0] + v["shift_y"], pose.shift_m[1] + v["shift_x"]),
            rotation_rad=pose.rotation_rad + v["rotation"],
            magnification=pose.magnification * (1 + v["magnification"]),
        )

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"percent": f"{100 * v['magnification']:.3g} %"}
