"""Patterns or pictures that are recorded mirrored or turned."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.records.correction import Correction, with_levels
from holoview.captures.turns import KEEP_SHAPE, TURNS, undone

Images = NDArray[Any]

TURN_WORDS = {
    "flip_x": "mirrored left to right",
    "flip_y": "upside down (mirrored top to bottom)",
    "rotate_180": "turned by 180°",
    "transpose": "with rows and columns exchanged",
    "rotate_90": "turned by 90° anticlockwise",
    "rotate_270": "turned by 90° clockwise",
    "anti_transpose": "mirrored at the other diagonal",
}
"""What a turn does, in words."""


@dataclass(frozen=True)
class SlmOrientation(Correction):
    """The patterns of one modulator are recorded mirrored or turned. slm: 0 or 1."""

    slm: int
    turn: str

    @property
    def effect(self) -> str:
        return f"slm{self.slm + 1}_orientation"

    @property
    def choice(self) -> str:
        return self.turn

    @property
    def sentence(self) -> str:
        return f"The patterns of modulator {self.slm + 1} are recorded {TURN_WORDS[self.turn]}."

    def apply(self, captures: Captures) -> Captures:
        return with_levels(captures, self.slm, undone(captures.levels[:, self.slm], self.turn))


@dataclass(frozen=True)
class CameraOrientation(Correction):
    """The camera's pictures are recorded mirrored or turned."""

    turn: str

    @property
    def effect(self) -> str:
        return "camera_orientation"

    @property
    def choice(self) -> str:
        return self.turn

    @property
    def sentence(self) -> str:
        return f"The camera's pictures are recorded {TURN_WORDS[self.turn]}."

    def apply(self, captures: Captures) -> Captures:
        return dataclasses.replace(captures, images=self.undone(captures.images))

    def undone(self, images: Images) -> Images:
        """Images (…, y, x) the right way up."""
        return undone(images, self.turn)


def orientation_candidates(captures: Captures) -> list[Correction]:
    """All orientations that the shapes allow.

    A modulator's patterns can be turned by 90° if they are square. The pictures can be if they are, or the modulators,
    and on a Fourier bench, where the camera's shape has nothing to do with the modulator's.
    """
    rows, columns = captures.levels.shape[2:]
    of_slms = TURNS[1:] if rows == columns else KEEP_SHAPE[1:]
    square_camera = captures.shape[0] == captures.shape[1]
    of_camera = TURNS[1:] if rows == columns or square_camera or captures.is_fourier else KEEP_SHAPE[1:]
    slms = [SlmOrientation(slm, turn) for slm in range(len(captures.slms)) for turn in of_slms]
    return [*slms, *(CameraOrientation(turn) for turn in of_camera)]
