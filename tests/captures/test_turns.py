"""Turns as operations on arrays, as matrices, and as each other's inverse."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.captures.turns import (
    KEEP_SHAPE,
    TURNS,
    inverse_turn,
    nearest_turn,
    turn_matrix,
    turned,
    turned_shape,
    undone,
)

PICTURE = np.arange(15).reshape(3, 5)


@pytest.mark.parametrize("turn", TURNS)
def test_undoing_a_turn_gives_the_picture_back(turn: str) -> None:
    assert np.array_equal(undone(turned(PICTURE, turn), turn), PICTURE)
    assert np.array_equal(turned(PICTURE, turn), undone(PICTURE, inverse_turn(turn)))


def test_a_quarter_turn_is_anticlockwise() -> None:
    assert np.array_equal(turned(PICTURE, "rotate_90"), np.rot90(PICTURE))


@pytest.mark.parametrize("turn", TURNS)
def test_the_matrix_says_where_each_pixel_goes(turn: str) -> None:
    after = turned(PICTURE, turn)
    assert after.shape == turned_shape((3, 5), turn)
    assert (turn in KEEP_SHAPE) == (after.shape == PICTURE.shape)
    for row, column in np.ndindex(PICTURE.shape):
        place = turn_matrix(turn) @ [row - 1, column - 2] + (np.array(after.shape) - 1) / 2
        assert after[tuple(place.astype(int))] == PICTURE[row, column]


@pytest.mark.parametrize("turn", TURNS)
def test_the_nearest_turn_of_a_scaled_and_slightly_rotated_one_is_itself(turn: str) -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    assert nearest_turn(250.0 * np.array([[c, s], [-s, c]]) @ turn_matrix(turn)) == turn


def test_the_eight_turns_differ() -> None:
    assert len({turned(np.arange(9).reshape(3, 3), turn).tobytes() for turn in TURNS}) == 8
