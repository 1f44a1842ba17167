"""Turns as operations on arrays, as matrices, and as each other's inverse."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.bench.captures.dataset import (
    ORIENTATIONS,
    SHAPE_KEEPING,
    inverse_orientation,
    nearest_orientation,
    orientation_matrix,
    oriented_shape,
    turned,
    undone,
)

PICTURE = np.arange(15).reshape(3, 5)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_undoing_a_turn_gives_the_picture_back(orientation: str) -> None:
    assert np.array_equal(undone(turned(PICTURE, orientation), orientation), PICTURE)
    assert np.array_equal(turned(PICTURE, orientation), undone(PICTURE, inverse_orientation(orientation)))


def test_a_quarter_turn_is_anticlockwise() -> None:
    assert np.array_equal(turned(PICTURE, "rotate_90"), np.rot90(PICTURE))


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_the_matrix_says_where_each_pixel_goes(orientation: str) -> None:
    after = turned(PICTURE, orientation)
    assert after.shape == oriented_shape((3, 5), orientation)
    assert (orientation in SHAPE_KEEPING) == (after.shape == PICTURE.shape)
    for row, column in np.ndindex(PICTURE.shape):
        place = orientation_matrix(orientation) @ [row - 1, column - 2] + (np.array(after.shape) - 1) / 2
        assert after[tuple(place.astype(int))] == PICTURE[row, column]


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_the_nearest_orientation_of_a_scaled_and_slightly_rotated_one_is_itself(orientation: str) -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    assert nearest_orientation(250.0 * np.array([[c, s], [-s, c]]) @ orientation_matrix(orientation)) == orientation


def test_the_eight_turns_differ() -> None:
    assert len({turned(np.arange(9).reshape(3, 3), orientation).tobytes() for orientation in ORIENTATIONS}) == 8
