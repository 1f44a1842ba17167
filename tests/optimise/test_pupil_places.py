"""Optimising for several places of the eye's pupil: the loss is the mean over them, and so is its gradient."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.optimise.problem import EvaluationRequest, Problem
from holoview.optimise.settings import Settings

Bench = Callable[..., hv.System]

EYE = {"eyepiece": "5 mm", "pupil": "0.5 mm", "accommodation": ["0 D", "4 D"]}
PLACES = ((0.0, -0.1e-3), (0.05e-3, 0.1e-3), (-0.1e-3, 0.0))


def _stack(system: hv.System, seed: int) -> np.ndarray:
    plan = hv.make_plan(system)
    return np.random.default_rng(seed).random((len(plan.planes_m), *plan.grid.shape, 3), dtype=np.float32)


def _evaluation(problem: Problem, system: hv.System, noise: Callable[..., torch.Tensor]) -> tuple[float, torch.Tensor]:
    path_m = noise(3, *system.drive_shape) * 800e-9
    found = problem.evaluate(path_m, system.amplitudes, EvaluationRequest(path_gradient=True))
    assert found.path_gradient is not None
    return found.loss, found.path_gradient


@pytest.mark.parametrize(
    "more", [{}, {"stiles_crawford": True, "chromatic_axis": "pupil"}], ids=["stop", "pupil function"]
)
def test_the_loss_is_the_mean_over_the_places(
    bench: Bench, noise: Callable[..., torch.Tensor], double_problem: Callable[..., Problem], more: dict[str, Any]
) -> None:
    system = bench(eye=EYE | more)
    assert system.eye is not None
    parts, stacks = [], []
    for seed, place in enumerate(PLACES):
        moved = system.with_(eye=system.eye.moved_to(place))
        stacks.append(_stack(moved, seed))
        parts.append(_evaluation(double_problem(moved, stacks[-1], Settings()), moved, noise))
    together = double_problem(system, np.concatenate(stacks), Settings(pupil_places_m=PLACES))
    loss, gradient = _evaluation(together, system, noise)
    assert loss == pytest.approx(np.mean([part[0] for part in parts]), rel=1e-12)
    expected = torch.stack([part[1] for part in parts]).mean(dim=0)
    assert torch.linalg.vector_norm(gradient - expected) <= 1e-12 * torch.linalg.vector_norm(expected)


def test_settings_with_places_survive_a_checkpoint() -> None:
    assert Settings(pupil_places_m=([0.0, 1e-3],)) == Settings(pupil_places_m=((0.0, 1e-3),))  # type: ignore[arg-type]


def test_places_without_an_eye_and_with_free_wavelengths_are_refused(bench: Bench) -> None:
    system = bench()
    with pytest.raises(hv.UserError, match="pupil places: without an eye"):
        Problem(system, np.concatenate([_stack(system, 0)] * 3), Settings(pupil_places_m=PLACES))
    with pytest.raises(hv.UserError, match="wavelengths with several places"):
        Settings(free=("patterns", "wavelengths"), pupil_places_m=PLACES)


def test_a_stack_is_needed_for_every_place(bench: Bench) -> None:
    system = bench(eye=EYE)
    with pytest.raises(hv.UserError, match=r"\(plane, y, x, 3\) = \(6, "):
        Problem(system, _stack(system, 0), Settings(pupil_places_m=PLACES))
