"""The picture moves by whole pixels exactly, and turns and grows about its centre, near by and behind a lens."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.captures.dataset import Captures

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_a_shift_by_whole_pixels_moves_the_picture(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    moved = predicted(captures, {"camera_alignment": {"shift_y": 8e-6, "shift_x": -4e-6}})[0]
    torch.testing.assert_close(moved[2:, :-1], predicted(captures)[0, :-2, 1:], rtol=1e-7, atol=1e-9)


def test_softness_is_what_linear_interpolation_does(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    plain = predicted(captures)[0]
    soft = predicted(captures, {"camera_alignment": {"shift_x": 2e-6, "softness": 1.0}})[0]
    torch.testing.assert_close(soft[:, 1:], (plain[:, 1:] + plain[:, :-1]) / 2, rtol=1e-5, atol=1e-7)


def test_a_small_turn_moves_the_edge_by_angle_times_distance(make_session: Make, predicted: Predicted) -> None:
    """Beside the centre a turn is a shift: what is at (0, x) goes to (x·angle, x)."""
    captures, angle = make_session(1, modulators=1), 5e-3
    turned = predicted(captures, {"camera_alignment": {"rotation": angle}})[0]
    for column in (10, 45):
        at = (column - 27.5) * 4e-6
        shifted = predicted(captures, {"camera_alignment": {"shift_y": at * angle}})[0]
        band = (slice(15, 25), slice(column - 1, column + 2))
        torch.testing.assert_close(turned[band], shifted[band], rtol=0.03, atol=0.02)


def test_a_magnified_picture_behind_a_lens_is_that_of_a_longer_one(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier(1)
    longer = dataclasses.replace(captures, focal_length_m=0.1 * 1.05)
    found = predicted(captures, {"camera_alignment": {"magnification": 0.05}})
    torch.testing.assert_close(found, predicted(longer), rtol=1e-7, atol=1e-9)


def test_a_turned_picture_behind_a_lens_is_that_of_a_turned_pattern(make_fourier: Make, predicted: Predicted) -> None:
    """Small angles: the zero order of a shifted camera, where a turn is a shift."""
    captures = make_fourier(1, levels=np.zeros((1, 1, 20, 28), np.uint8))
    moved = predicted(captures, {"camera_alignment": {"shift_x": 200e-6, "rotation": 0.3}})[0]
    at = np.unravel_index(int(moved.argmax()), moved.shape)
    assert tuple(int(i) for i in at) == (30, 60)  # turned first, then moved
    assert float(moved.max()) == pytest.approx(20 * 28, rel=0.02)
