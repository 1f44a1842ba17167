"""A modulator or a camera that moved shows its pattern or picture moved; turns and growth are about the centre."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.light.model.effects.hook_contexts import ModulatorContext, Pose
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
AT = ModulatorContext(1, 520e-9, 780e-9, 8e-6, (12, 16), 2)


def test_a_shift_by_a_pixel_moves_the_pattern_by_a_pixel() -> None:
    values = torch.rand(12, 16, generator=torch.Generator().manual_seed(1)).double()
    found = AT.warped(values, Pose(shift_m=(8e-6, -16e-6)))
    torch.testing.assert_close(found[4:-4, 4:-4], AT.sampled(values).roll((2, -4), (0, 1))[4:-4, 4:-4])


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        (Pose(rotation_rad=0.1), lambda y, x: 0.9950042 * x + 0.0998334 * y),  # read at R⁻¹ r
        (Pose(magnification=1.02), lambda y, x: x / 1.02),
    ],
)
def test_a_ramp_turns_and_grows_about_the_centre(pose: Pose, expected: Callable[..., torch.Tensor]) -> None:
    y, x = AT.positions(torch.zeros(24, 32).double())
    ramp = x.expand(24, 32)
    found = AT.warped(ramp, pose)
    torch.testing.assert_close(found[8:-8, 8:-8], expected(y, x).expand(24, 32)[8:-8, 8:-8], rtol=1e-6, atol=1e-12)


def test_only_modulator_2_moves(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    flat = captures.levels.copy()
    flat[:, 1] = 7
    uniform = dataclasses.replace(captures, levels=flat)
    moved = {"slm_alignment": {"shift_y": 3e-6, "rotation": 0.01}}
    torch.testing.assert_close(predicted(uniform, moved), predicted(uniform))
    assert not torch.allclose(predicted(captures, moved), predicted(captures), rtol=0.05)


def test_it_says_where_the_modulator_is(make_session: Make) -> None:
    said = get_effect("slm_alignment").format_finding(
        make_session().nominal_system(), {"shift_y": 4.8e-6, "magnification": 0.01}
    )
    assert said.startswith("Modulator 2 is shifted by 4.8 um (y) and 0 um (x)") and said.endswith("magnified by 1 %.")


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
