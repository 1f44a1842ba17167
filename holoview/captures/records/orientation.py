"""Patterns or pictures that are recorded mirrored or turned."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.records.correction import Correction, with_levels

Images = NDArray[Any]

_UNDO: dict[str, Callable[[Images], Images]] = {
    "flip_x": lambda a: a[..., :, ::-1],
    "flip_y": lambda a: a[..., ::-1, :],
    "rotate_180": lambda a: a[..., ::-1, ::-1],
    "transpose": lambda a: np.swapaxes(a, -1, -2),
    "rotate_90": lambda a: np.rot90(a, -1, (-2, -1)),
    "rotate_270": lambda a: np.rot90(a, 1, (-2, -1)),
    "anti_transpose": lambda a: np.swapaxes(a, -1, -2)[..., ::-1, ::-1],
}
"""What puts images (…, y, x) right that were recorded so. `rotate_90` is anticlockwise, the first row being the top."""

_WORDS = {
    "flip_x": "mirrored left to right",
    "flip_y": "upside down (mirrored top to bottom)",
    "rotate_180": "turned by 180°",
    "transpose": "with rows and columns exchanged",
    "rotate_90": "turned by 90° anticlockwise",
    "rotate_270": "turned by 90° clockwise",
    "anti_transpose": "mirrored at the other diagonal",
}

_KEEP_SHAPE = ("flip_x", "flip_y", "rotate_180")


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
        return f"The patterns of modulator {self.slm + 1} are recorded {_WORDS[self.turn]}."

    def apply(self, captures: Captures) -> Captures:
        return with_levels(captures, self.slm, _UNDO[self.turn](captures.levels[:, self.slm]))


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
        return f"The camera's pictures are recorded {_WORDS[self.turn]}."

    def apply(self, captures: Captures) -> Captures:
        return dataclasses.replace(captures, images=self.undone(captures.images))

    def undone(self, images: Images) -> Images:
        """Images (…, y, x) the right way up."""
        return _UNDO[self.turn](images)


def orientation_candidates(captures: Captures) -> list[Correction]:
    """All orientations that the shapes allow.

    A modulator's patterns can be turned by 90° if they are square. The pictures can be if they are, or the modulators,
    and on a Fourier bench, where the camera's shape has nothing to do with the modulator's.
    """
    rows, columns = captures.levels.shape[2:]
    of_slms = tuple(_UNDO) if rows == columns else _KEEP_SHAPE
    square_camera = captures.shape[0] == captures.shape[1]
    of_camera = tuple(_UNDO) if rows == columns or square_camera or captures.is_fourier else _KEEP_SHAPE
    slms = [SlmOrientation(slm, turn) for slm in range(len(captures.slms)) for turn in of_slms]
    return [*slms, *(CameraOrientation(turn) for turn in of_camera)]
