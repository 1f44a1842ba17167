"""The second modulator isn't imaged exactly onto the first: it is shifted, rotated or magnified."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.effects.alignment_base import Alignment, alignment_parameters
from holoview.effects.starting_grids import square_grid
from holoview.model.effects.effect import Needs
from holoview.model.effects.parameter import Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from holoview.model.effects.hook_contexts import Pose


class SlmAlignment(Alignment):
    """The pixel of modulator 2 that should be at r is at (1 + magnification)·R(rotation)·r + shift."""

    id = "slm_alignment"
    cause = "The second modulator isn't aligned with the first: it is shifted, turned or magnified."
    finding = (
        "Modulator 2 is shifted by {shift_y} (y) and {shift_x} (x), turned by {rotation} and magnified by {percent}."
    )
    parameters = alignment_parameters(1e-3, 0.2, (-28e-3, 28e-3, 3.5e-3), (-0.03, 0.03, 0.005))
    acts_on = ("modulator 2",)
    varies_over_field = True
    needs = Needs(modulators=2, fourier=False)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        pitch = system.modulators[0].pitch_m
        return [*square_grid("shift_y", "shift_x", 1.5 * pitch, 0.5 * pitch), *super().starting_points(system)]

    def slm2_pose(self, pose: Pose, v: Values) -> Pose:
        return self.moved(pose, v)
