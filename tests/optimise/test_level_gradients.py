"""Secants to the neighbouring level: which neighbour, the gradient, and the change that a pixel causes by itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.holograms.optimise.level_gradients import (
    LevelSteps,
    gauss_newton_diagonal,
    secant_gradient,
    steps_to_neighbour_level,
)
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.variables import PatternVariables
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.optics.slm import nearest_level
from tests.optimise.conftest import carry_back, intensity_at

Bench = Callable[..., System]
Noise = Callable[..., torch.Tensor]
FRAME, LASER = 1, 1
WAVELENGTH_M = 532e-9
LEVELS = [0, 0.05, 0.3, 0.35, 0.9, 1]


def _modulator(levels: Any) -> Modulator:
    return Modulator(pitch_m=8e-6, shape=(6, 7), stroke_m=825e-9, levels=levels)


# --- which neighbour ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("levels", [2, 3, 16, LEVELS], ids=str)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_neighbour_is_the_next_level_on_the_side_of_the_drive(
    levels: Any, dtype: torch.dtype, noise: Noise
) -> None:
    modulator = _modulator(levels)
    assert modulator.levels is not None
    table = torch.tensor(modulator.levels, dtype=dtype)
    drive = noise(0, 3, 1, 6, 7).to(dtype)
    steps = steps_to_neighbour_level(drive, (modulator,))
    assert steps is not None
    shown = nearest_level(drive, modulator)
    assert torch.equal(torch.sign(steps), torch.sign(drive - shown))
    for here, step in zip(shown.flatten(), steps.flatten(), strict=True):
        index = int((table - here).abs().argmin())
        assert float(step) == float(table[index + int(torch.sign(step))] - here)


def test_a_drive_on_a_level_looks_up_and_on_the_last_one_down() -> None:
    drive = torch.tensor(LEVELS, dtype=torch.float64).reshape(1, 1, 2, 3)
    steps = steps_to_neighbour_level(drive, (_modulator(LEVELS),))
    assert steps is not None
    np.testing.assert_allclose(steps.flatten(), [0.05, 0.25, 0.05, 0.55, 0.1, -0.1], rtol=1e-12)


def test_a_continuous_modulator_has_no_neighbours_beside_one_of_levels(noise: Noise) -> None:
    drive = noise(0, 2, 2, 6, 7)
    steps = steps_to_neighbour_level(drive, (_modulator(None), _modulator(4)))
    assert steps is not None
    assert not steps[:, 0].any()
    assert bool((steps[:, 1].abs() - 1 / 3).abs().max() < 1e-12)
    assert steps_to_neighbour_level(drive, (_modulator(None), _modulator(None))) is None


def test_a_jump_is_made_metres_by_the_stroke(bench: Bench) -> None:
    system = bench(levels=4)
    patterns = PatternVariables(system, Settings(), torch.full(system.drive_shape, 0.4))
    step_m = patterns.level_step_m()
    assert step_m is not None
    torch.testing.assert_close(step_m, torch.full(system.drive_shape, 825e-9 / 3), rtol=1e-6, atol=0)
    assert PatternVariables(bench(), Settings(), torch.full(system.drive_shape, 0.4)).level_step_m() is None


# --- how steep ------------------------------------------------------------------------------------------------------


def _products(noise: Noise, count: int = 200) -> torch.Tensor:
    return torch.complex(noise(0, count) - 0.5, noise(1, count) - 0.5)


def _secant(product: torch.Tensor, step_m: torch.Tensor, cost: float) -> torch.Tensor:
    turn = torch.exp(2j * math.pi * step_m / WAVELENGTH_M) - 1
    return ((product * turn).real + cost * turn.abs().square()) / step_m


def test_from_half_a_turn_on_the_slope_is_the_change_that_the_jump_makes(noise: Noise) -> None:
    product, share = _products(noise), noise(2, 200)
    step_m = torch.sign(share - 0.5) * (0.5 + 2 * share) * WAVELENGTH_M
    expected = _secant(product, step_m, 0.3)
    found = secant_gradient(product, step_m, WAVELENGTH_M, 0.3)
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-12 * float(expected.abs().max()))


def test_a_jump_to_nowhere_has_the_tangents_slope_and_a_small_one_nearly(noise: Noise) -> None:
    product = _products(noise)
    tangent = -2 * math.pi / WAVELENGTH_M * product.imag
    none, tiny = (torch.full((200,), step_m, dtype=torch.float64) for step_m in (0.0, 1e-15))
    torch.testing.assert_close(secant_gradient(product, none, WAVELENGTH_M, 0.7), tangent, rtol=1e-14, atol=0)
    near = secant_gradient(product, tiny, WAVELENGTH_M, 0.7)
    assert float((near - tangent).abs().max()) <= 1e-7 * float(tangent.abs().max())  # φ = 1e-8 rad


@pytest.mark.parametrize("turns", [0.05, -0.2, 0.25, -0.4])
def test_between_them_the_slope_is_their_mean_weighted_by_the_square_of_the_half_angles_sine(
    turns: float, noise: Noise
) -> None:
    product = _products(noise)
    step_m = torch.full((200,), turns * WAVELENGTH_M, dtype=torch.float64)
    share, tangent = math.sin(math.pi * turns) ** 2, -2 * math.pi / WAVELENGTH_M * product.imag
    expected = share * _secant(product, step_m, 0.3) + (1 - share) * tangent
    found = secant_gradient(product, step_m, WAVELENGTH_M, 0.3)
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-12 * float(expected.abs().max()))


def test_a_jump_of_a_whole_turn_changes_nothing(noise: Noise) -> None:
    whole = torch.full((200,), WAVELENGTH_M, dtype=torch.float64)
    slope = secant_gradient(_products(noise), whole, WAVELENGTH_M, 0.7)
    assert float(slope.abs().max()) <= 1e-15 * 2 * math.pi / WAVELENGTH_M


@pytest.mark.parametrize("case_name", ["two modulators", "one modulator", "sources", "glass", "upsampled thrice"])
def test_the_models_slope_is_that_of_the_loss_along_the_change_of_a_pixels_field(
    case_name: str, plan_of: Callable[[str], Plan], plain: Any, noise: Noise
) -> None:
    """p → p·(1 + ε·(exp(iφ) − 1)) is a complex optical path; the slope at ε = 0 is the jump's, before its own cost."""
    plan = plan_of(case_name)
    opd_m, λ = noise(0, *plan.system.drive_shape) * 825e-9, float(plan.system.wavelengths_m[LASER])
    share, target = noise(3, *opd_m.shape), noise(1, len(plan.planes_m), *plan.grid.shape)
    step_m = torch.sign(share - 0.5) * (0.5 + share) * λ  # half a turn and more: secants
    found = _model_gradient(plan, opd_m, target, step_m) * step_m
    for pixel in [(FRAME, m, y, x) for m in range(opd_m.shape[1]) for y, x in ((0, 0), (5, 6), (2, 3))]:
        step, losses = 1e-5, []
        for sign in (1, -1):
            turn = sign * step * (torch.exp(2j * math.pi * step_m[pixel] / λ) - 1)
            moved = opd_m.to(torch.complex128)
            moved[pixel] += λ / (2j * math.pi) * torch.log1p(turn)
            losses.append(float((plain(plan).intensity(moved, FRAME, LASER) - target).square().sum()))
        expected = (losses[0] - losses[1]) / (2 * step)
        # The cubic term is of the order of step² = 1e-10, the rounding of losses near 100 is 1e-14/1e-5.
        assert float(found[pixel]) == pytest.approx(expected, abs=1e-7 * float(found.abs().max()))


def _model_gradient(plan: Plan, opd_m: torch.Tensor, target: torch.Tensor, step_m: torch.Tensor) -> torch.Tensor:
    """The slopes of Σ (I − target)² to steps that cost nothing by themselves."""
    model = ForwardModel(plan, double=True)
    laser = model.lasers.index((FRAME, LASER))
    model.forward(opd_m)
    for plane, wanted in enumerate(target):
        seen = intensity_at(model, plane)
        slope = torch.zeros_like(seen)
        slope[laser] = 2 * (seen[laser] - wanted)
        carry_back(model, plane, slope)
    gradient = torch.zeros_like(opd_m)
    model.accumulate_gradients(gradient, level_steps=LevelSteps(step_m, torch.zeros(len(model.lasers), opd_m.shape[1])))
    return gradient


def test_small_jumps_give_the_gradient(bench: Bench, noise: Noise, double_problem: Callable[..., Problem]) -> None:
    system = bench()
    stack = np.full((2, *make_plan(system).grid.shape, 3), 0.4)
    problem, opd_m = double_problem(system, stack, Settings()), noise(0, *system.drive_shape) * 825e-9
    tiny = EvaluationRequest(path_gradient=True, level_step_m=torch.full_like(opd_m, 1e-15), curvature_weight=1.0)
    tangent, slopes = (
        problem.evaluate(opd_m, system.amplitudes, w).path_gradient
        for w in (EvaluationRequest(path_gradient=True), tiny)
    )
    assert tangent is not None and slopes is not None
    assert float((slopes - tangent).norm()) <= 1e-6 * float(tangent.norm())


# --- what a change costs by itself ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"upsample": 3},
        {"modulators": [{"pitch": "8 um", "shape": [24, 32], "stroke": "1 um"}], "gap": None},
        {"amplitudes": [[2.0]], "planes": ["0.3 mm", "0.5 mm"]},
        {"source": {"directions": [[0, 0], [0.02, 0], [0, 0.02], [0.02, 0.02]]}},
    ],
    ids=["two modulators", "upsampled thrice", "one modulator", "planes", "sources"],
)
def test_a_pixels_own_cost_is_the_mean_change_of_a_loss_that_was_zero(
    changes: dict[str, Any], bench: Bench, noise: Noise, double_problem: Callable[..., Problem]
) -> None:
    one = {"wavelengths": ["532 nm"], "amplitudes": [[1.0]], "planes": ["0.5 mm"], "shape": [24, 32]}
    system = bench(**(one | {"stroke": "1 um", "propagation": "periodic"} | changes))
    opd_m = noise(0, *system.drive_shape) * 3 * 532e-9
    luminance = float(make_plan(system).colour_weights[0, 1] * system.amplitudes[0, 0])
    shape = make_plan(system).grid.shape
    problem = double_problem(system, np.ones((len(system.planes_m), *shape, 3)), Settings(loss="luminance"))
    losses = []
    problem.model.forward(opd_m)
    for plane, target in enumerate(problem.objective.target):
        target.copy_(luminance * intensity_at(problem.model, plane))
    assert problem.evaluate(opd_m, system.amplitudes, EvaluationRequest()).loss < 1e-25
    for y in range(2, 24, 5):
        for x in range(2, 32, 5):
            turned = opd_m.clone()
            turned[0, 0, y, x] += 532e-9 / 2  # |exp(iπ) − 1|² = 4
            losses.append(problem.evaluate(turned, system.amplitudes, EvaluationRequest()).loss / 4)
    sources = len(system.source.directions_rad)
    expected = gauss_newton_diagonal(luminance**2, system.sampling.upsample, int(np.prod(shape)), sources)
    # A random field's speckle is as coarse as the grid allows: the mean of 30 pixels is up to 3 % lower and scatters by
    # 1.8 % (20 seeds), of which 13 % allow for 5.5.
    assert float(np.mean(losses)) == pytest.approx(expected, rel=0.13)
