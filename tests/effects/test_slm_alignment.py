"""A modulator that moved by a pixel shows its pattern a pixel further; turns and magnification are about the centre."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest
import torch

from holoview.captures.dataset import Captures
from holoview.model.effects.hook_contexts import ModulatorContext, Pose
from holoview.model.effects.registry import get_effect

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
