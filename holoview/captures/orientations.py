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

ORIENTATIONS = tuple(_UNDO)
"""Their names; the first one changes nothing."""

SHAPE_KEEPING = ORIENTATIONS[:4]
"""The orientations that keep the numbers of rows and columns."""

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


def undone(images: _Images, orientation: str) -> _Images:
    """Images (…, y, x) the right way up that have an orientation; a view of the same memory."""
    return _UNDO[orientation](images)


def turned(images: _Images, orientation: str) -> _Images:
    """Upright images (…, y, x) in an orientation; a view of the same memory."""
    return _UNDO[inverse_orientation(orientation)](images)


def inverse_orientation(orientation: str) -> str:
    """The orientation that undoes another one."""
    return _INVERSE.get(orientation, orientation)


def orientation_matrix(orientation: str) -> NDArray[np.float64]:
    """The matrix (2, 2) that takes a position (y, x) to its place in the orientation."""
    return np.array(_MATRICES[orientation], dtype=np.float64)


def nearest_orientation(matrix: NDArray[np.float64]) -> str:
    """The orientation whose matrix is most like a given one (2, 2), whatever its scale."""
    return max(ORIENTATIONS, key=lambda orientation: float((orientation_matrix(orientation) * matrix).sum()))


def oriented_shape(shape: tuple[int, int], orientation: str) -> tuple[int, int]:
    """Rows and columns of an upright shape in an orientation."""
    return shape if orientation in SHAPE_KEEPING else (shape[1], shape[0])
