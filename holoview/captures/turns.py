"""The eight ways in which a picture can be mirrored or turned without resampling, as operations on arrays.

A turned picture has its first row at the top; `rotate_90` is anticlockwise. Positions are (y, x) from the centre.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Images = NDArray[Any]

_UNDO: dict[str, Callable[[_Images], _Images]] = {
    "none": lambda a: a,
    "flip_x": lambda a: a[..., :, ::-1],
    "flip_y": lambda a: a[..., ::-1, :],
    "rotate_180": lambda a: a[..., ::-1, ::-1],
    "transpose": lambda a: np.swapaxes(a, -1, -2),
    "rotate_90": lambda a: np.rot90(a, -1, (-2, -1)),
    "rotate_270": lambda a: np.rot90(a, 1, (-2, -1)),
    "anti_transpose": lambda a: np.swapaxes(a, -1, -2)[..., ::-1, ::-1],
}

TURNS = tuple(_UNDO)
"""Their names; the first one changes nothing."""

KEEP_SHAPE = TURNS[:4]
"""Those that keep the numbers of rows and columns."""

_INVERSE = {"rotate_90": "rotate_270", "rotate_270": "rotate_90"}

_MATRICES: dict[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "none": ((1, 0), (0, 1)),
    "flip_x": ((1, 0), (0, -1)),
    "flip_y": ((-1, 0), (0, 1)),
    "rotate_180": ((-1, 0), (0, -1)),
    "transpose": ((0, 1), (1, 0)),
    "rotate_90": ((0, -1), (1, 0)),
    "rotate_270": ((0, 1), (-1, 0)),
    "anti_transpose": ((0, -1), (-1, 0)),
}


def undone(images: _Images, turn: str) -> _Images:
    """Images (…, y, x) the right way up that are turned so; a view of the same memory."""
    return _UNDO[turn](images)


def turned(images: _Images, turn: str) -> _Images:
    """Images (…, y, x) after a turn; a view of the same memory."""
    return _UNDO[inverse_turn(turn)](images)


def inverse_turn(turn: str) -> str:
    """The turn that undoes a turn."""
    return _INVERSE.get(turn, turn)


def turn_matrix(turn: str) -> NDArray[np.float64]:
    """The matrix (2, 2) that takes a position (y, x) to where a turn puts what is there."""
    return np.array(_MATRICES[turn], dtype=np.float64)


def nearest_turn(matrix: NDArray[np.float64]) -> str:
    """The turn whose matrix is most like this one (2, 2), whatever its scale."""
    return max(TURNS, key=lambda turn: float((turn_matrix(turn) * matrix).sum()))


def turned_shape(shape: tuple[int, int], turn: str) -> tuple[int, int]:
    """Rows and columns after a turn."""
    return shape if turn in KEEP_SHAPE else (shape[1], shape[0])
