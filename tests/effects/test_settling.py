"""What is shown lies between the pattern before and the pattern that was sent; without a pattern before, nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.plan import make_plan
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.light.optics.torch_effects import TorchEffects
from tests.diagnose.conftest import small_system

Make = Callable[..., Captures]
Predicted = Callable[..., torch.Tensor]
HALF = {"settling": {"share1": 0.5, "share2": 0.5}}


def _even(captures: Captures) -> Captures:
    """With even levels, of which the mean of two is a level too."""
    return dataclasses.replace(captures, levels=captures.levels // 2 * 2)


def test_the_optical_path_relaxes_from_the_one_before() -> None:
    context = ModulatorContext(0, 500e-9, 800e-9, 8e-6, (3, 4), 1)
    now, before = (torch.rand(3, 4, generator=torch.Generator().manual_seed(s)).double() for s in (1, 2))
    effects = TorchEffects({"settling": {"share1": 0.25}})
    found = effects.modulator_transmission(now, context, torch.complex128, before=before)
    path = 800e-9 * (0.75 * now + 0.25 * before)
    assert torch.allclose(found, torch.polar(torch.ones_like(path), 2 * torch.pi * path / 500e-9), rtol=0, atol=1e-12)
    without = TorchEffects({}).modulator_transmission(now, context, torch.complex128)
    assert torch.equal(effects.modulator_transmission(now, context, torch.complex128), without)
    second = dataclasses.replace(context, number=1)
    assert torch.equal(effects.modulator_transmission(now, second, torch.complex128, before=before), without)


def test_the_share_that_remains_has_the_adjoint_of_autograd() -> None:
    context, effects = ModulatorContext(0, 500e-9, 800e-9, 8e-6, (3, 4), 1), TorchEffects(HALF)
    patterns = [torch.rand(3, 4, dtype=torch.float64, requires_grad=True) for _ in range(2)]
    assert torch.autograd.gradcheck(
        lambda now, before: effects.modulator_transmission(now, context, torch.complex128, before=before), patterns
    )


def test_half_settled_captures_are_those_of_the_mean_patterns(make_session: Make, predicted: Predicted) -> None:
    captures = _even(make_session(3))
    found = predicted(captures, HALF)
    levels = captures.levels
    means = np.stack([levels[0], *((levels[k - 1] // 2 + levels[k] // 2) for k in (1, 2))])
    expected = predicted(dataclasses.replace(captures, levels=means))
    assert torch.allclose(found, expected, rtol=1e-9, atol=1e-9 * float(expected.max()))
    assert torch.equal(found[0], predicted(captures)[0])  # nothing was shown before the first


def test_on_a_fourier_bench_too(make_fourier: Make, predicted: Predicted) -> None:
    captures = _even(make_fourier(2))
    means = np.stack([captures.levels[0], captures.levels[0] // 2 + captures.levels[1] // 2])
    expected = predicted(dataclasses.replace(captures, levels=means))
    found = predicted(captures, {"settling": {"share1": 0.5}})
    assert torch.allclose(found, expected, rtol=1e-9, atol=1e-9 * float(expected.max()))


def test_a_part_of_a_session_knows_what_was_shown_before(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(4)
    whole = predicted(captures, HALF)
    assert torch.equal(predicted(captures.subset([3, 1]), HALF), whole[[3, 1]])
    assert torch.equal(predicted(captures.subset([0, 2, 3]).subset([2, 0]), HALF), whole[[3, 0]])


def test_it_needs_no_more_than_captures_to_be_remembered(make_session: Make) -> None:
    """A predictor's cache tells apart patterns before, shares and captures."""
    captures = make_session(3)
    shared = Predictor(captures)
    for share in (0.1, 0.2, 0.0, 0.1):
        for k in range(3):
            effects = {"settling": {"share1": share, "share2": 0.1}}
            assert torch.equal(shared([k], effects).signal, Predictor(captures)([k], effects).signal)


@pytest.mark.parametrize("frames", [1, 3])
def test_frames_repeat_so_that_the_last_comes_before_the_first(frames: int) -> None:
    system = small_system(frames=frames, amplitudes="white")
    drive = np.random.default_rng(2).integers(0, 8, system.drive_shape) * 2 / 15
    plans = [make_plan(system.edit({"effects": effects})) for effects in (HALF, {})]
    drives = drive, (drive + np.roll(drive, 1, axis=0)) / 2
    found, expected = (
        compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, given), double=True))[0]
        for plan, given in zip(plans, drives, strict=True)
    )
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * float(expected.max()))
