"""The hand-written adjoint against torch's autograd of a plain forward model, and against finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from holoview.holograms.optimise.forward_model import ForwardModel, PlainBeam
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.plan import Plan, make_plan
from holoview.light.numerics.sampling import positions
from holoview.light.optics.frame_inputs import FrameInputs
from tests.optimise.conftest import carry_back, intensity_at

Noise = Callable[..., torch.Tensor]
FRAME, LASER = 1, 1


def _opd(plan: Plan, noise: Noise) -> torch.Tensor:
    return noise(0, *plan.system.drive_shape) * 825e-9


def _target(plan: Plan, noise: Noise) -> torch.Tensor:
    return noise(1, len(plan.planes_m), *plan.grid.shape)


def _run(
    model: ForwardModel, opd_m: torch.Tensor, target: torch.Tensor, chromatic: bool = False
) -> dict[str, torch.Tensor]:
    """Intensity (plane, y, x) of one laser in one frame, and the gradients of Σ (I − target)²."""
    planes, laser = [], model.lasers.index((FRAME, LASER))
    model.forward(opd_m, wavelength_gradient=chromatic)
    for plane, wanted in enumerate(target):
        seen = intensity_at(model, plane)
        planes.append(seen[laser])
        slope = torch.zeros_like(seen)
        slope[laser] = 2 * (seen[laser] - wanted)
        carry_back(model, plane, slope)
    gradient, slopes = torch.zeros_like(opd_m), torch.zeros(len(model.plan.system.wavelengths_m), dtype=torch.float64)
    model.accumulate_gradients(gradient, slopes if chromatic else None)
    return {"intensity": torch.stack(planes), "gradient": gradient, "chromatic": slopes}


def test_the_plain_pair_is_lit_from_the_directions_of_the_source(case: str, plan_of: Callable[[str], Plan]) -> None:
    """exp(2πi·(sin θ_y·y + sin θ_x·x)/λ), from the angles that the system states."""
    plan = plan_of(case)
    light = plan.system.source
    y, x = (positions(n, plan.grid.pitch_m) for n in plan.grid.shape)
    for source in range(len(plan.slopes)):
        angles = light.directions_rad[source] + (0 if light.tilts_rad is None else light.tilts_rad[LASER])
        turns = np.sin(angles) / plan.system.wavelengths_m[LASER]
        expected = np.exp(2j * np.pi * (turns[0] * y[:, None] + turns[1] * x))
        # a few turns, rounded: 2π·10·2⁻⁵³
        np.testing.assert_allclose(PlainBeam(plan, LASER, source).illumination.numpy(), expected, atol=1e-14)


def test_the_plain_pair_is_a_function_and_its_derivative(
    case: str, plan_of: Callable[[str], Plan], noise: Noise
) -> None:
    plan = plan_of(case)
    opd_m, target = _opd(plan, noise)[FRAME].requires_grad_(), _target(plan, noise)
    beam = PlainBeam(plan, LASER, len(plan.slopes) - 1)
    fields, behind = beam.forward(opd_m)
    intensity = fields.abs().square()
    (expected,) = torch.autograd.grad((intensity - target).square().sum(), opd_m)
    with torch.no_grad():  # dL = Re Σ c·dE of L = Σ (|E|² − target)²
        found = beam.adjoint(opd_m, behind, 4 * (intensity - target) * fields.conj())
    assert float(expected.norm()) > 0
    # FFTs of 2⁹ numbers and sums of as many, rounded at random: some ten units of 2⁻⁵³
    assert float((found - expected).norm()) <= 1e-14 * float(expected.norm())


def test_the_adjoint_is_the_gradient_that_autograd_finds(
    case: str, plan_of: Callable[[str], Plan], plain: Any, noise: Noise
) -> None:
    plan = plan_of(case)
    target, opd_m = _target(plan, noise), _opd(plan, noise).requires_grad_()
    shown = plain(plan).intensity(opd_m, FRAME, LASER)
    (expected,) = torch.autograd.grad((shown - target).square().sum(), opd_m)
    found = _run(ForwardModel(plan, double=True), opd_m.detach(), target)
    torch.testing.assert_close(found["intensity"], shown.detach(), rtol=1e-11, atol=1e-13)
    assert float((found["gradient"] - expected).norm()) <= 1e-13 * float(expected.norm())  # measured 3e-15
    assert float(expected[FRAME].norm()) > 0
    assert not found["gradient"][1 - FRAME].any()  # another frame's pattern isn't looked at


def test_the_adjoint_is_what_central_differences_approach(
    case: str, plan_of: Callable[[str], Plan], noise: Noise
) -> None:
    plan = plan_of(case)
    model, target, opd_m, step_m = ForwardModel(plan, double=True), _target(plan, noise), _opd(plan, noise), 1e-11
    gradient = _run(model, opd_m, target)["gradient"]
    for modulator in range(len(plan.system.modulators)):
        for y, x in ((0, 0), (3, 2), (5, 6)):
            losses = []
            for sign in (1, -1):
                moved = opd_m.clone()
                moved[FRAME, modulator, y, x] += sign * step_m
                losses.append(float((_run(model, moved, target)["intensity"] - target).square().sum()))
            expected = (losses[0] - losses[1]) / (2 * step_m)
            # Phase steps of 1e-4 rad leave a cubic term of the order of their square, 1e-8; measured 2e-9.
            scale = float(gradient[FRAME, modulator].abs().max())
            assert float(gradient[FRAME, modulator, y, x]) == pytest.approx(expected, abs=1e-8 * scale)


def test_the_wavelengths_gradient_is_what_central_differences_approach(
    case: str, plan_of: Callable[[str], Plan], plain: Any, noise: Noise
) -> None:
    plan = plan_of(case)
    target, opd_m, step = _target(plan, noise), _opd(plan, noise), 1e-7
    found = _run(ForwardModel(plan, double=True), opd_m, target, chromatic=True)["chromatic"]
    losses = []
    for sign in (1, -1):
        λ = plan.system.wavelengths_m.copy()
        λ[LASER] *= 1 + sign * step
        moved = replace(make_plan(plan.system.edit({"wavelengths": λ})), grid=plan.grid)
        losses.append(float((plain(moved).intensity(opd_m, FRAME, LASER) - target).square().sum()))
    expected = (losses[0] - losses[1]) / (2 * step * plan.system.wavelengths_m[LASER])
    # A loss is rounded by 1e-15 of it, however small the gradient is; its own error is 1e-8 of it at most.
    rounding = 2e-15 * losses[0] / (step * plan.system.wavelengths_m[LASER])
    assert float(found[LASER]) == pytest.approx(expected, rel=2e-8, abs=rounding)
    assert float(found[1 - LASER]) == 0.0


def test_where_an_apodisation_lets_nothing_through_the_wavelengths_gradient_is_finite(
    plan_of: Callable[[str], Plan], noise: Noise
) -> None:
    """exp(−(sin θ/NA)²) is 0 in float64 at the corners of the spectrum, and its logarithm has no slope there."""
    plan = make_plan(plan_of("two modulators").system.edit({"relay2.apodisation_na": 0.003}))
    found = _run(ForwardModel(plan, double=True), _opd(plan, noise), _target(plan, noise), chromatic=True)
    assert bool(torch.isfinite(found["chromatic"]).all())
    assert float(found["chromatic"][LASER]) != 0.0


def test_the_wavelengths_gradient_leaves_that_of_the_patterns_as_it_is(
    plan_of: Callable[[str], Plan], noise: Noise
) -> None:
    plan = plan_of("glass")
    model, opd_m, target = ForwardModel(plan, double=True), _opd(plan, noise), _target(plan, noise)
    without = _run(model, opd_m, target)["gradient"]
    assert torch.equal(_run(model, opd_m, target, chromatic=True)["gradient"], without)


def test_the_adjoint_in_single_precision_is_near_that_in_double(
    case: str, plan_of: Callable[[str], Plan], noise: Noise
) -> None:
    plan = plan_of(case)
    opd_m, target = _opd(plan, noise).float(), _target(plan, noise).float()
    expected = _run(ForwardModel(plan, double=True), opd_m.double(), target.double(), chromatic=True)
    found = _run(ForwardModel(plan), opd_m, target, chromatic=True)
    for name, tolerance in (("intensity", 1e-6), ("gradient", 2e-6)):  # 5e-7 and 9e-7 at most, with 100 random patterns
        assert float((found[name] - expected[name]).norm()) <= tolerance * float(expected[name].norm()), name
    # The wavelength's gradient is a sum of terms of both signs, among them −Σ gradient·opd/λ. By Cauchy and Schwarz an
    # error of 2e-6 of the gradient makes one of 2e-6·|gradient|·|opd|/λ; of the sum itself it may be any share.
    terms = float(expected["gradient"].norm() * opd_m.norm()) / float(plan.system.wavelengths_m[LASER])
    assert float((found["chromatic"] - expected["chromatic"]).norm()) <= 2e-6 * terms


def test_the_model_sees_what_the_executor_simulates(case: str, plan_of: Callable[[str], Plan], noise: Noise) -> None:
    plan = plan_of(case)
    slots = FrameInputs(plan, noise(2, *plan.system.drive_shape))
    expected, _ = compute_focal_stack(TorchExecutor(plan, slots, double=True))
    model = ForwardModel(plan, double=True)
    found = np.zeros_like(expected)
    model.forward(slots.opd_m)
    for plane in range(len(plan.planes_m)):
        for (frame, laser), intensity in zip(model.lasers, intensity_at(model, plane), strict=True):
            amplitude = plan.system.amplitudes[frame, laser] / plan.system.frames
            found[plane, laser] += amplitude * intensity.numpy()
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-13)


def test_planes_may_be_seen_in_any_order_and_again(plan_of: Callable[[str], Plan], noise: Noise) -> None:
    plan = plan_of("sources")
    model = ForwardModel(plan, double=True)
    model.forward(_opd(plan, noise))
    first, _, again = (intensity_at(model, plane) for plane in (2, 0, 2))
    assert torch.equal(again, first)


def test_a_model_that_goes_on_with_other_wavelengths_is_as_a_new_one(
    case: str, plan_of: Callable[[str], Plan], noise: Noise
) -> None:
    plan = plan_of(case)
    moved = replace(make_plan(plan.system.edit({"wavelengths": [471e-9, 629e-9]})), grid=plan.grid)
    opd_m, target = _opd(plan, noise), _target(plan, noise)
    model = ForwardModel(plan, double=True)
    before = _run(model, opd_m, target, chromatic=True)
    model.set_plan(moved)
    found = _run(model, opd_m, target, chromatic=True)
    expected = _run(ForwardModel(moved, double=True), opd_m, target, chromatic=True)
    for name, part in expected.items():
        assert torch.equal(found[name], part), name
        assert not torch.equal(found[name], before[name]), name


def test_only_lasers_that_are_on_are_modelled(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("sources")
    model = ForwardModel(make_plan(plan.system.edit({"amplitudes": [[1.0, 0.0], [0.0, 2.0]]})))
    assert model.lasers == [(0, 0), (1, 1)]
    assert model.source_count == 3
