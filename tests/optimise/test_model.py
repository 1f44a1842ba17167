"""The hand-written adjoint against torch's autograd of a plain forward model, and against finite differences."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

from holoview.engine.frame import focal_stack
from holoview.engine.torch import TorchExecutor
from holoview.optics.propagate import transfer_function
from holoview.optics.pupil import pupil
from holoview.optics.slots import make_slots
from holoview.optics.source import plane_wave
from holoview.optimise.model import Model
from holoview.plan import Plan, make_plan
from holoview.system import Modulator, System

CPU = torch.device("cpu")
FRAME, LASER = 1, 1

CASES: dict[str, dict[str, Any]] = {
    "two modulators": {},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [6, 7], "stroke": "825 nm"}], "gap": None},
    "sources": {"source": {"directions": [[0, 0], [0.01, -0.02], [-0.03, 0.005]]}},
    "stops": {"relay1.iris_na": 0.04, "relay2.iris_na": 0.03, "relay2.dc_block_na": 0.004},
    "glass": {"relay2": {"iris_na": 0.04, "apodisation_na": 0.03, "aberration": {"Z4": "70 nm", "Z8": "40 nm"}}},
    "periodic": {"propagation": "periodic"},
    "upsampled thrice": {"upsample": 3},
}


def _plan(case: str) -> Plan:
    modulator = Modulator(pitch_m=8e-6, shape=(6, 7), stroke_m=825e-9)
    base = System(
        wavelengths_m=[460e-9, 638e-9],
        amplitudes=[[1.0, 2.0], [3.0, 1.0]],
        modulators=(modulator, modulator),
        gap_m=0.5e-3,
        planes_m=[0.8e-3, 1e-3, 1.3e-3],
    )
    return make_plan(base.edit(CASES[case]))


def _random(seed: int, *shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def _opd(plan: Plan) -> torch.Tensor:
    return _random(0, *plan.system.drive_shape) * 825e-9


def _target(plan: Plan) -> torch.Tensor:
    return _random(1, len(plan.planes_m), *plan.grid.shape)


def _plain_intensity(plan: Plan, opd_m: torch.Tensor) -> torch.Tensor:
    """Mean intensity over sources (plane, y, x), in the simplest differentiable form."""
    λ = float(plan.system.wavelengths_m[LASER])

    def relayed(field: torch.Tensor, relay: int, z: float) -> torch.Tensor:
        h = transfer_function(plan.transfer(relay, LASER, z), plan.grid, torch.complex128, CPU)
        glass = pupil(plan, relay, LASER, torch.complex128, CPU)
        rows, columns = plan.grid.shape
        spectrum = torch.fft.fft2(field, s=plan.grid.padded) * (h if glass is None else h * glass)
        return torch.fft.ifft2(spectrum)[:rows, :columns]

    factor = plan.grid.upsample
    masks = [torch.exp(2j * math.pi * m / λ) for m in opd_m[FRAME]]
    masks = [m.repeat_interleave(factor, 0).repeat_interleave(factor, 1) for m in masks]
    total = torch.zeros(len(plan.planes_m), *plan.grid.shape, dtype=torch.float64)
    for source in range(len(plan.slopes)):
        field = plane_wave(plan, LASER, source, torch.complex128, CPU) * masks[0]
        if plan.system.gap_m is not None:
            field = relayed(field, 0, plan.system.gap_m) * masks[1]
        total = total + torch.stack([relayed(field, 1, float(z)).abs().square() for z in plan.planes_m])
    return total / len(plan.slopes)


def _gradient(plan: Plan, opd_m: torch.Tensor, target: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Intensity and ∂/∂opd of Σ (I − target)², by the model."""
    model = Model(plan, double=True)
    traces = [model.trace(opd_m, FRAME, LASER, source) for source in range(model.sources)]
    intensity = model.intensity(traces)
    gradient = torch.zeros_like(opd_m)
    for trace in traces:
        model.backward(trace, 2 * (intensity - target) / model.sources, FRAME, LASER, gradient)
    return intensity, gradient


@pytest.mark.parametrize("case", CASES)
def test_the_adjoint_is_the_gradient_that_autograd_finds(case: str) -> None:
    plan = _plan(case)
    target, opd_m = _target(plan), _opd(plan).requires_grad_()
    plain = _plain_intensity(plan, opd_m)
    (expected,) = torch.autograd.grad((plain - target).square().sum(), opd_m)
    intensity, found = _gradient(plan, opd_m.detach(), target)
    torch.testing.assert_close(intensity, plain.detach(), rtol=1e-11, atol=1e-13)
    assert float((found - expected).norm()) <= 1e-13 * float(expected.norm())  # measured 2e-15
    assert float(expected[FRAME].norm()) > 0
    assert not found[1 - FRAME].any()  # another frame's pattern isn't looked at


@pytest.mark.parametrize("case", CASES)
def test_the_adjoint_is_what_central_differences_approach(case: str) -> None:
    plan = _plan(case)
    target, opd_m, step_m = _target(plan), _opd(plan), 1e-11
    _, gradient = _gradient(plan, opd_m, target)
    for modulator in range(len(plan.system.modulators)):
        for y, x in ((0, 0), (3, 2), (5, 6)):
            losses = []
            for sign in (1, -1):
                moved = opd_m.clone()
                moved[FRAME, modulator, y, x] += sign * step_m
                losses.append(float((_gradient(plan, moved, target)[0] - target).square().sum()))
            expected = (losses[0] - losses[1]) / (2 * step_m)
            # Phase steps of 1e-4 rad leave a cubic term of the order of their square, 1e-8; measured 2e-9.
            scale = float(gradient[FRAME, modulator].abs().max())
            assert float(gradient[FRAME, modulator, y, x]) == pytest.approx(expected, abs=1e-8 * scale)


def test_the_adjoint_in_single_precision_is_near_that_in_double() -> None:
    plan = _plan("two modulators")
    opd_m, target = _opd(plan).float(), _target(plan).float()
    _, expected = _gradient(plan, opd_m.double(), target.double())
    model = Model(plan)
    trace = model.trace(opd_m, FRAME, LASER, 0)
    gradient = torch.zeros_like(opd_m)
    model.backward(trace, 2 * (model.intensity([trace]) - target), FRAME, LASER, gradient)
    assert float((gradient - expected).norm()) <= 1e-6 * float(expected.norm())  # measured 4e-7


@pytest.mark.parametrize("case", CASES)
def test_the_model_sees_what_the_executor_simulates(case: str) -> None:
    plan = _plan(case)
    drive = _random(2, *plan.system.drive_shape)
    slots = make_slots(plan, drive)
    expected, _ = focal_stack(TorchExecutor(plan, slots, double=True))
    model = Model(plan, double=True)
    found = np.zeros_like(expected)
    for frame, laser in model.lasers:
        traces = [model.trace(slots.opd_m, frame, laser, source) for source in range(model.sources)]
        amplitude = plan.system.amplitudes[frame, laser] / plan.system.frames
        found[:, laser] += amplitude * model.intensity(traces).numpy()
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-13)


def test_only_lasers_that_are_on_are_modelled() -> None:
    system = _plan("two modulators").system.edit({"amplitudes": [[1.0, 0.0], [0.0, 2.0]]})
    assert Model(make_plan(system)).lasers == [(0, 0), (1, 1)]
