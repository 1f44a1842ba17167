"""The eyebox penalty: variation as the metric measures it, and the exact gradient."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.image_quality import eyebox_uniformity_of
from holoview.holograms.optimise.eyebox_penalty import EyeboxPenalty
from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import frequency_indices
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.light.optics.propagate import nominal_pupil, transfer_function

Bench = Callable[..., System]
Noise = Callable[..., torch.Tensor]
CPU = torch.device("cpu")

BENCHES: dict[str, dict[str, Any]] = {
    "clear": {},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [10, 13], "stroke": "825 nm"}], "gap": None},
    "frames": {"amplitudes": [[1.0, 0.0, 0.3], [0.2, 2.0, 0.0]]},
    "a laser off": {"amplitudes": [[1.0, 0.0, 2.0]]},
    "sources": {"source": {"directions": [[0, 0], [0.01, -0.02]]}},
    "stops": {"relay1.iris_na": 0.03, "relay2.iris_na": 0.025, "relay2.dc_block_na": 0.004},
    "glass": {"relay2": {"iris_na": 0.04, "apodisation_na": 0.03, "aberration": {"Z4": "70 nm"}}},
    "periodic": {"propagation": "periodic"},
    "upsampled thrice": {"upsample": 3},
    "not upsampled": {"upsample": 1},
}


def _system(bench: Bench, name: str = "clear") -> System:
    return bench(**({"shape": [10, 13], "amplitudes": [[1.0, 0.5, 2.0]]} | BENCHES[name]))


def _model(system: System) -> ForwardModel:
    return ForwardModel(make_plan(system), double=True)


def _opd(system: System, noise: Noise) -> torch.Tensor:
    return noise(0, *system.drive_shape) * 825e-9


def _penalty(plain: Any, plan: Plan, opd_m: torch.Tensor, amplitudes: torch.Tensor) -> torch.Tensor:
    """Mean over wavelengths of (mean square of blocks / square of their mean) − 1, written out."""
    upsample, order = plan.grid.upsample, []
    for padded in plan.grid.padded:
        count = padded // upsample
        order.append([(k - count // 2) % padded for k in range(count)])
    envelope = np.ones([len(bins) for bins in order])
    for axis, (padded, bins) in enumerate(zip(plan.grid.padded, order, strict=True)):
        f = frequency_indices(padded)[bins] / padded
        one = [1.0 if k == 0 else (math.sin(math.pi * upsample * k) / upsample / math.sin(math.pi * k)) ** 2 for k in f]
        envelope *= np.array(one)[:, None] if axis == 0 else np.array(one)
    total, lit = torch.zeros(()), 0
    for λ in range(len(plan.system.wavelengths_m)):
        glass = nominal_pupil(plan, 1, λ, torch.complex128, CPU)
        stop = transfer_function(plan.stops(1, λ), plan.grid, torch.complex128, CPU).abs().square()
        stop = stop if glass is None else stop * glass.abs().square()
        light = torch.zeros(plan.grid.padded)
        for frame in range(plan.system.frames):
            for source in range(len(plan.slopes)):
                spectrum = plain(plan).spectrum(opd_m, frame, λ, source)
                light = light + amplitudes[frame, λ] * stop * spectrum.abs().square()
        light = light[order[0]][:, order[1]] / torch.from_numpy(envelope)
        blocks = [part.mean() for band in torch.tensor_split(light, _edges(light, 0)) for part in _columns(band)]
        means = torch.stack(blocks)
        if float(means.detach().max()) > 0:
            lit += 1
            total = total + means.square().mean() / means.mean().square() - 1
    return total / lit


def _edges(light: torch.Tensor, axis: int) -> list[int]:
    return [k * light.shape[axis] // 8 for k in range(1, 8)]


def _columns(band: torch.Tensor) -> tuple[torch.Tensor, ...]:
    return torch.tensor_split(band, _edges(band, 1), dim=1)


@pytest.mark.parametrize("name", BENCHES)
def test_the_variation_is_that_of_the_score(name: str, bench: Bench) -> None:
    system = _system(bench, name)
    drive, model = hv.random_drive(system), _model(system)
    model.forward(FrameInputs(model.plan, drive).opd_m)
    eyebox = EyeboxPenalty(model)
    found = eyebox.variation(eyebox.block_means(system.amplitudes))
    expected = eyebox_uniformity_of(Hologram(drive, system)).coefficient_of_variation
    assert found == pytest.approx(expected, rel=1e-6)  # the score is single precision


@pytest.mark.parametrize("name", BENCHES)
def test_the_penalty_and_its_gradient_are_those_of_a_plain_model(
    name: str, bench: Bench, noise: Noise, plain: Any
) -> None:
    system, model = _system(bench, name), _model(_system(bench, name))
    opd_m, amplitudes = _opd(system, noise), system.amplitudes
    opd = opd_m.clone().requires_grad_()
    expected = 0.7 * _penalty(plain, model.plan, opd, torch.from_numpy(amplitudes.copy()))
    expected.backward()
    assert opd.grad is not None
    model.forward(opd_m)
    eyebox, gradient = EyeboxPenalty(model), torch.zeros_like(opd_m)
    penalty = eyebox.add_penalty(eyebox.block_means(amplitudes), amplitudes, 0.7)
    model.accumulate_gradients(gradient)
    assert penalty == pytest.approx(expected.item(), rel=1e-11)
    assert float((gradient - opd.grad).norm()) <= 1e-11 * float(opd.grad.norm())
    assert float(opd.grad.norm()) > 0


@pytest.mark.long
@pytest.mark.parametrize("name", ["clear", "frames", "glass"])
def test_the_gradient_of_loss_and_penalty_is_what_central_differences_approach(
    name: str, bench: Bench, noise: Noise, double_problem: Callable[..., Problem]
) -> None:
    system, step_m = _system(bench, name), 1e-11
    stack = np.full((2, *make_plan(system).grid.shape, 3), 0.4)
    problem, opd_m = double_problem(system, stack, Settings(eyebox=0.5)), _opd(system, noise)
    gradient = problem.evaluate(opd_m, system.amplitudes, EvaluationRequest(path_gradient=True)).path_gradient
    assert gradient is not None
    for pixel in ((0, 0, 0, 0), (0, 1, 5, 6), (0, 0, 9, 12)):
        losses = []
        for sign in (1, -1):
            moved = opd_m.clone()
            moved[pixel] += sign * step_m
            losses.append(problem.evaluate(moved, system.amplitudes, EvaluationRequest()).loss)
        expected = (losses[0] - losses[1]) / (2 * step_m)
        # Phase steps of 1e-4 rad leave a cubic term of the order of their square, 1e-8.
        assert float(gradient[pixel]) == pytest.approx(expected, abs=1e-7 * float(gradient.abs().max()))


def _lit(model: ForwardModel, power: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
    """Gives every beam a spectrum of that power, a function of cycles a sample (y, x)."""
    y, x = (frequency_indices(n) / n for n in model.plan.grid.padded)
    amplitude = torch.from_numpy(np.sqrt(power(y[:, None], x[None, :])))
    ky, kx = (axis.last_frequencies for axis in model.axes)
    for laser in range(len(model.lasers)):
        for source in range(model.source_count):
            model.spectrum(laser, source).write(slice(0, len(kx)), amplitude[ky][:, kx])


def _envelope(model: ForwardModel, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    upsample = model.plan.grid.upsample
    return (np.sinc(upsample * y) / np.sinc(y) * np.sinc(upsample * x) / np.sinc(x)) ** 2


@pytest.mark.parametrize("name", ["clear", "frames", "sources", "upsampled thrice"])
def test_even_light_has_no_variation_no_penalty_and_no_gradient(name: str, bench: Bench) -> None:
    system = _system(bench, name)
    model = _model(system)
    _lit(model, lambda y, x: _envelope(model, y, x))
    eyebox = EyeboxPenalty(model)
    blocks = eyebox.block_means(system.amplitudes)
    assert eyebox.variation(blocks) == pytest.approx(0, abs=1e-12)
    assert eyebox.add_penalty(blocks, system.amplitudes, 1.0) == pytest.approx(0, abs=1e-12)
    adjoints = [model.adjoint_spectrum(laser, s).whole for laser in range(3) for s in range(model.source_count)]
    assert max(float(adjoint.abs().max()) for adjoint in adjoints) <= 1e-12


def test_light_in_one_block_of_sixty_four_is_the_worst(bench: Bench) -> None:
    model = _model(bench(shape=[12, 16]))
    _lit(model, lambda y, x: 1.0 * (y == 0) * (x == 0))
    eyebox = EyeboxPenalty(model)
    amplitudes = model.plan.system.amplitudes
    blocks = eyebox.block_means(amplitudes)
    assert eyebox.variation(blocks) == pytest.approx(math.sqrt(63), rel=1e-12)
    assert eyebox.add_penalty(blocks, amplitudes, 2.0) == pytest.approx(2 * 63, rel=1e-12)


def test_every_wavelength_counts_alike_however_bright(bench: Bench, noise: Noise) -> None:
    system = _system(bench)
    model, dim = _model(system), np.array([1e-6, 1.0, 1e3])
    model.forward(_opd(system, noise))
    eyebox = EyeboxPenalty(model)
    found = [eyebox.add_penalty(eyebox.block_means(a), a, 1.0) for a in (system.amplitudes, system.amplitudes * dim)]
    assert found[1] == pytest.approx(found[0], rel=1e-12)


def test_a_laser_that_is_switched_off_has_no_say(bench: Bench, noise: Noise) -> None:
    system = _system(bench)
    two = system.edit({"amplitudes": system.amplitudes * [[1.0, 0.0, 1.0]]})
    found = []
    for known in (system, two):  # once switched off by the amplitudes only, once not modelled at all
        model, gradient = _model(known), torch.zeros(system.drive_shape, dtype=torch.float64)
        model.forward(_opd(system, noise))
        eyebox = EyeboxPenalty(model)
        blocks = eyebox.block_means(two.amplitudes)
        penalty = eyebox.add_penalty(blocks, two.amplitudes, 1.0)
        model.accumulate_gradients(gradient)
        found.append((penalty, eyebox.variation(blocks), gradient))
    assert found[0][:2] == pytest.approx(found[1][:2], rel=1e-12)
    torch.testing.assert_close(found[0][2], found[1][2], rtol=1e-10, atol=0)
    assert bool(torch.isfinite(found[0][2]).all())


def test_a_wavelength_that_does_not_reach_the_eyebox_leaves_the_others_their_say(bench: Bench, noise: Noise) -> None:
    system = _system(bench)
    model, gradient = _model(system), torch.zeros(system.drive_shape, dtype=torch.float64)
    model.forward(_opd(system, noise))
    model.spectrum(1, 0).zero_()  # of the second wavelength
    eyebox = EyeboxPenalty(model)
    penalty = eyebox.add_penalty(eyebox.block_means(system.amplitudes), system.amplitudes, 1.0)
    off = system.amplitudes * [[1.0, 0.0, 1.0]]
    assert penalty == pytest.approx(eyebox.add_penalty(eyebox.block_means(off), off, 1.0), rel=1e-12)
    model.accumulate_gradients(gradient)
    assert bool(torch.isfinite(gradient).all())


def test_loss_and_variation_of_an_evaluation_have_the_penalty_in_them(
    bench: Bench, noise: Noise, double_problem: Callable[..., Problem]
) -> None:
    system = _system(bench)
    stack, opd_m = np.full((2, *make_plan(system).grid.shape, 3), 0.4), _opd(system, noise)
    free, half, whole = (
        double_problem(system, stack, Settings(eyebox=w)).evaluate(
            opd_m, system.amplitudes, EvaluationRequest(eyebox_variation=True)
        )
        for w in (0.0, 0.5, 1.0)
    )
    assert half.loss - free.loss == pytest.approx(0.5 * (whole.loss - free.loss), rel=1e-12)
    assert whole.loss > free.loss
    assert free.eyebox_variation == half.eyebox_variation == whole.eyebox_variation
    assert free.psnr_db == whole.psnr_db
