"""One evaluation: loss, gradients and least squares against a plain model, autograd and finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.holograms.optimise.objective import torch_srgb_encode
from holoview.holograms.optimise.problem import EvaluationRequest, LossEvaluation, Problem
from holoview.holograms.optimise.settings import LOSS_SPACES, Settings
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.numerics.structural_similarity import multi_scale_similarity

Bench = Callable[..., System]
Noise = Callable[..., torch.Tensor]
MakeProblem = Callable[[System, np.ndarray, Settings], Problem]
QUADRATIC = [name for name, loss in LOSS_SPACES.items() if not loss.is_encoded]
ALL = EvaluationRequest(
    path_gradient=True,
    optimal_amplitudes=True,
    eyebox_variation=True,
    amplitude_gradient=True,
    wavelength_gradient=True,
)

SYSTEMS: dict[str, dict[str, Any]] = {
    "two frames": {},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [8, 9], "stroke": "825 nm"}], "gap": None},
    "glass and oblique sources": {
        "source": {"directions": [[0, 0], [0.01, -0.02]]},
        "relay1": {"iris_na": 0.05, "apodisation_na": 0.05, "aberration": {"Z6": "50 nm"}},
        "relay2": {"iris_na": 0.045, "apodisation_na": 0.04, "aberration": {"Z4": "70 nm", "Z8": "40 nm"}},
    },
}


def _system(bench: Bench, name: str = "two frames", **changes: Any) -> System:
    """Wavelengths between whole nanometres: the eye's tables are linear there."""
    small = {"shape": [8, 9], "wavelengths": ["455.4 nm", "531.7 nm", "638.3 nm"]}
    amplitudes = {"amplitudes": [[1.0, 0.5, 0.0], [0.7, 0.9, 1.2]]}
    return bench(**(small | amplitudes | SYSTEMS[name] | changes))


def _stack(system: System) -> np.ndarray:
    return np.random.default_rng(3).uniform(0.1, 0.6, (len(system.planes_m), *make_plan(system).grid.shape, 3))


def _opd(system: System, noise: Noise) -> torch.Tensor:
    return noise(0, *system.drive_shape) * 825e-9


def _plain_loss(
    plain: Any, system: System, stack: np.ndarray, name: str, opd_m: torch.Tensor, amplitudes: torch.Tensor
) -> torch.Tensor:
    """Mean square residual over planes, channels and samples, and structure; frames averaged, all written out."""
    plan, loss = make_plan(system), LOSS_SPACES[name]
    colours = torch.from_numpy(np.array(loss.channels_of_xyz(plan.colour_weights)))
    image = torch.zeros(())
    for frame in range(system.frames):
        for laser, colour in enumerate(colours):
            light = plain(plan).intensity(opd_m, frame, laser) * amplitudes[frame, laser] / system.frames
            image = image + colour[:, None, None] * light[:, None]
    target = torch.from_numpy(np.moveaxis(loss.channels_of_rgb(stack), -1, 1).copy())
    if loss.is_encoded:
        image, target = torch_srgb_encode(image), torch_srgb_encode(target)
    similarity = torch.stack([multi_scale_similarity(*pair).mean() for pair in zip(image, target, strict=True)])
    return (image - target).square().mean() + loss.structure_weight * (1 - similarity.mean())


@pytest.mark.parametrize("name", LOSS_SPACES)
def test_the_loss_and_its_gradients_are_those_of_a_plain_model(
    name: str, bench: Bench, noise: Noise, plain: Any, double_problem: MakeProblem
) -> None:
    system = _system(bench)
    stack, opd_m, amplitudes = _stack(system), _opd(system, noise), torch.from_numpy(system.amplitudes.copy())
    opd, factors = opd_m.clone().requires_grad_(), amplitudes.clone().requires_grad_()
    expected = _plain_loss(plain, system, stack, name, opd, factors)
    expected.backward()
    assert opd.grad is not None and factors.grad is not None
    found = double_problem(system, stack, Settings(loss=name)).evaluate(opd_m, amplitudes.numpy(), ALL)
    assert found.loss == pytest.approx(expected.item(), rel=1e-12)
    assert found.path_gradient is not None
    assert float((found.path_gradient - opd.grad).norm()) <= 1e-12 * float(opd.grad.norm())
    lit = system.amplitudes > 0  # a laser that is off isn't looked at
    np.testing.assert_allclose(np.asarray(found.amplitude_gradient)[lit], factors.grad.numpy()[lit], rtol=1e-11)
    assert not np.asarray(found.amplitude_gradient)[~lit].any()


@pytest.mark.parametrize("name", ["linear-srgb", "srgb"])
def test_amplitude_slopes_are_what_central_differences_approach(
    name: str, bench: Bench, noise: Noise, double_problem: MakeProblem
) -> None:
    system, step = _system(bench), 1e-5
    problem = double_problem(system, _stack(system), Settings(loss=name))
    opd_m = _opd(system, noise)
    found = problem.evaluate(
        opd_m, system.amplitudes, EvaluationRequest(path_gradient=True, amplitude_gradient=True)
    ).amplitude_gradient
    assert found is not None
    for laser in np.argwhere(system.amplitudes > 0):
        sides = []
        for sign in (1, -1):
            moved = system.amplitudes.copy()
            moved[tuple(laser)] += sign * step
            sides.append(problem.evaluate(opd_m, moved, EvaluationRequest()).loss)
        # The cubic term is of the order of step² = 1e-10 of the loss, the rounding of the loss 1e-16/1e-5 of it.
        expected = pytest.approx((sides[0] - sides[1]) / (2 * step), rel=1e-7, abs=1e-9 * sides[0])
        assert found[tuple(laser)] == expected


@pytest.mark.parametrize("eyebox", [0.0, 0.3], ids=["eyebox free", "eyebox even"])
@pytest.mark.parametrize("propagation", ["linear", "periodic"])
@pytest.mark.parametrize("bench_name", SYSTEMS)
def test_the_wavelengths_gradient_is_what_central_differences_approach(
    bench_name: str, propagation: str, eyebox: float, bench: Bench, noise: Noise, double_problem: MakeProblem
) -> None:
    system = _system(bench, bench_name, propagation=propagation)
    problem = double_problem(system, _stack(system), Settings(eyebox=eyebox, free=("patterns", "wavelengths")))
    _check_wavelengths(problem, _opd(system, noise))


@pytest.mark.parametrize("name", LOSS_SPACES)
def test_colour_has_its_part_in_the_wavelengths_gradient(
    name: str, bench: Bench, noise: Noise, double_problem: MakeProblem
) -> None:
    system = _system(bench)
    problem = double_problem(system, _stack(system), Settings(loss=name, free=("patterns", "wavelengths")))
    _check_wavelengths(problem, _opd(system, noise))


@pytest.mark.parametrize("observer", ["cie1931", "cie1964", "age 70, field 4", "person 8"])
def test_every_observer_has_slopes(observer: str, bench: Bench, noise: Noise, double_problem: MakeProblem) -> None:
    system = _system(bench).edit({"observer": observer})
    problem = double_problem(system, _stack(system), Settings(free=("patterns", "wavelengths")))
    _check_wavelengths(problem, _opd(system, noise))


def _check_wavelengths(problem: Problem, opd_m: torch.Tensor) -> None:
    known, amplitudes, step_m = problem.system.wavelengths_m, problem.system.amplitudes, 2e-14
    found = problem.evaluate(
        opd_m, amplitudes, EvaluationRequest(path_gradient=True, wavelength_gradient=True)
    ).wavelength_gradient
    assert found is not None
    expected = np.zeros(len(known))
    for i in range(len(known)):
        sides = []
        for sign in (1, -1):
            moved = known.copy()
            moved[i] += sign * step_m
            problem.set_wavelengths(moved)
            sides.append(problem.evaluate(opd_m, amplitudes, EvaluationRequest()).loss)
        expected[i] = (sides[0] - sides[1]) / (2 * step_m)
    # A loss near 1 is rounded by some 1e-16, over 4e-14 m: 0.01/m, beside slopes of 1e6 to 3e7/m; measured 5e-9.
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=2e-8 * np.abs(expected).max())
    assert np.abs(found).max() > 1e5  # of one laser alone it may be small by chance


@pytest.mark.parametrize("bench_name", SYSTEMS)
@pytest.mark.parametrize("name", ["linear-srgb", "srgb"])
def test_single_precision_is_near_double(
    name: str, bench_name: str, bench: Bench, noise: Noise, double_problem: MakeProblem
) -> None:
    system = _system(bench, bench_name)
    settings = Settings(loss=name, eyebox=0.1)
    opd_m, stack = _opd(system, noise).float(), _stack(system).astype(np.float32)
    expected = double_problem(system, stack, settings).evaluate(opd_m.double(), system.amplitudes, ALL)
    found = Problem(system, stack, settings).evaluate(opd_m, system.amplitudes, ALL)
    assert found.loss == pytest.approx(expected.loss, rel=5e-6)  # 7e-7 at most in 450 draws
    assert found.psnr_db == pytest.approx(expected.psnr_db, abs=4.4 * 5e-6)
    assert found.eyebox_variation == pytest.approx(expected.eyebox_variation, rel=5e-6)
    # At most 1.5e-6 in 450 draws, of few numbers that may cancel; with sRGB 2.6e-5, by pixels near black. There its
    # slope bends by 1.7 %: in some of a thousand draws rounding takes one of 6000 values across, and changes its share.
    tolerance = 1e-3 if name == "srgb" else 2e-5
    for field in ("path_gradient", "amplitude_gradient", "optimal_amplitudes", "wavelength_gradient"):
        one, other = (np.asarray(getattr(e, field), dtype=np.float64) for e in (found, expected))
        assert np.linalg.norm(one - other) <= tolerance * np.linalg.norm(other), field


@pytest.mark.parametrize("settings", [{}, {"region": (2, 3, 9, 8), "plane_weights": (1.0, 3.0)}], ids=["all", "part"])
@pytest.mark.parametrize("name", QUADRATIC)
def test_the_solved_amplitudes_are_the_best(
    name: str, settings: dict[str, Any], bench: Bench, noise: Noise, double_problem: MakeProblem
) -> None:
    """Karush–Kuhn–Tucker: no slope where a laser is on, no descent where it is off; and no neighbour is better."""
    system = _system(bench)
    problem = double_problem(system, _stack(system), Settings(loss=name, **settings))
    opd_m = _opd(system, noise)
    first = problem.evaluate(opd_m, system.amplitudes, ALL)
    assert first.optimal_amplitudes is not None and first.amplitude_gradient is not None
    assert not first.optimal_amplitudes[system.amplitudes == 0].any()
    best = problem.evaluate(opd_m, first.optimal_amplitudes, ALL)
    assert best.amplitude_gradient is not None
    scale = 1e-13 * np.abs(first.amplitude_gradient).max()  # measured 4e-16
    assert np.abs(best.amplitude_gradient[first.optimal_amplitudes > 0]).max() <= scale
    assert best.amplitude_gradient[(first.optimal_amplitudes == 0) & (system.amplitudes > 0)].min(initial=0.0) >= -scale
    assert best.loss < first.loss
    for seed in range(5):
        shift = noise(seed, *first.optimal_amplitudes.shape).numpy() - 0.5
        near = np.where(
            system.amplitudes > 0, np.maximum(first.optimal_amplitudes * (1 + 0.1 * shift) + 0.01 * shift, 0), 0
        )
        assert problem.evaluate(opd_m, near, EvaluationRequest()).loss > best.loss


def test_the_closed_form_does_not_depend_on_the_amplitudes_of_now(
    bench: Bench, noise: Noise, double_problem: MakeProblem
) -> None:
    system = _system(bench)
    problem, opd_m = double_problem(system, _stack(system), Settings()), _opd(system, noise)
    one, other = (
        problem.evaluate(opd_m, a, ALL).optimal_amplitudes for a in (system.amplitudes, 7 * system.amplitudes)
    )
    assert one is not None
    np.testing.assert_array_equal(one, other)


def test_two_equal_frames_are_one(bench: Bench, noise: Noise, double_problem: MakeProblem) -> None:
    single = _system(bench, amplitudes=[[1.0, 0.5, 0.8]])
    twice = single.edit({"amplitudes": np.repeat(single.amplitudes, 2, axis=0)})
    opd_m, settings = _opd(single, noise), Settings(eyebox=0.1)
    one = double_problem(single, _stack(single), settings).evaluate(opd_m, single.amplitudes, ALL)
    both = double_problem(twice, _stack(twice), settings).evaluate(
        opd_m.repeat(2, 1, 1, 1),
        twice.amplitudes,
        EvaluationRequest(path_gradient=True, eyebox_variation=True, amplitude_gradient=True, wavelength_gradient=True),
    )
    assert both.loss == pytest.approx(one.loss, rel=1e-12)
    assert both.psnr_db == pytest.approx(one.psnr_db, rel=1e-12)
    assert both.eyebox_variation == pytest.approx(one.eyebox_variation, rel=1e-12)
    assert one.path_gradient is not None and both.path_gradient is not None
    torch.testing.assert_close(both.path_gradient.sum(dim=0), one.path_gradient[0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(both.wavelength_gradient, one.wavelength_gradient, rtol=1e-10)
    np.testing.assert_allclose(np.sum(both.amplitude_gradient, axis=0), one.amplitude_gradient[0], rtol=1e-10)


def test_the_picture_and_the_psnr_are_those_of_the_view(bench: Bench) -> None:
    system = _system(bench, planes=["0.3 mm", "0.4 mm", "0.6 mm"])
    drive, stack = hv.random_drive(system), _stack(system)
    problem = Problem(system, stack, Settings())
    found = problem.evaluate(torch.from_numpy(drive) * 825e-9, system.amplitudes, EvaluationRequest())
    view = hv.simulate(system, drive, backend="torch64")
    np.testing.assert_allclose(found.picture(), view.rgb[1], rtol=0, atol=1e-5)  # single precision
    assert found.psnr_db == pytest.approx(psnr_linear_srgb(view.rgb, stack).mean_db, abs=1e-5)


def _fields(found: LossEvaluation) -> dict[str, Any]:
    return {name: value for name, value in vars(found).items() if name != "picture" and value is not None}


@pytest.mark.parametrize(
    ("requested", "fields"),
    [
        (EvaluationRequest(), set()),
        (EvaluationRequest(path_gradient=True), {"path_gradient"}),
        (EvaluationRequest(path_gradient=True, amplitude_gradient=True), {"path_gradient", "amplitude_gradient"}),
        (EvaluationRequest(optimal_amplitudes=True), {"optimal_amplitudes"}),
        (EvaluationRequest(eyebox_variation=True), {"eyebox_variation"}),
        (ALL, {"path_gradient", "amplitude_gradient", "optimal_amplitudes", "eyebox_variation", "wavelength_gradient"}),
    ],
    ids=["nothing", "path_gradient", "slopes", "amplitudes", "eyebox_variation", "all"],
)
def test_what_is_not_wanted_is_not_brought(
    requested: EvaluationRequest, fields: set[str], bench: Bench, noise: Noise
) -> None:
    system = _system(bench)
    problem = Problem(system, _stack(system), Settings())
    found = _fields(problem.evaluate(_opd(system, noise).float(), system.amplitudes, requested))
    assert set(found) == fields | {"loss", "psnr_db"}


def test_an_evaluation_leaves_no_trace_in_the_next(bench: Bench, noise: Noise) -> None:
    system = _system(bench, "glass and oblique sources")
    problem = Problem(system, _stack(system), Settings(eyebox=0.1))
    opd_m, other = _opd(system, noise).float(), noise(5, *system.drive_shape).float() * 825e-9
    first = problem.evaluate(opd_m, system.amplitudes, ALL)
    problem.evaluate(other, 2 * system.amplitudes, ALL)
    again = problem.evaluate(opd_m, system.amplitudes, ALL)
    for name, value in _fields(first).items():
        np.testing.assert_array_equal(np.asarray(value), np.asarray(_fields(again)[name]), err_msg=name)


def test_a_problem_that_goes_on_with_other_wavelengths_is_as_a_new_one(bench: Bench, noise: Noise) -> None:
    system = _system(bench, "glass and oblique sources")
    moved = system.edit({"wavelengths": ["471 nm", "540 nm", "612 nm"]})
    settings = Settings(loss="xyz", eyebox=0.1)
    problem, fresh = (Problem(s, _stack(system), settings) for s in (system, moved))
    problem.set_wavelengths(moved.wavelengths_m)
    assert problem.system == moved
    found, expected = (
        _fields(p.evaluate(_opd(system, noise).float(), system.amplitudes, ALL)) for p in (problem, fresh)
    )
    for name, value in expected.items():
        np.testing.assert_array_equal(np.asarray(found[name]), np.asarray(value), err_msg=name)


def test_free_wavelengths_have_room_for_the_walk_off_of_the_longest(bench: Bench) -> None:
    system = _system(bench, shape=[40, 40], gap="0.05 mm", propagation="compact")
    stack = _stack(system)
    free = Settings(free=("patterns", "wavelengths"), wavelength_range_m=(440e-9, 830e-9))
    narrow, wide = (Problem(system, stack, s).model.plan.grid for s in (replace(free, free=("patterns",)), free))
    longest = make_plan(system.edit({"wavelengths": ["455.4 nm", "531.7 nm", "830 nm"]})).grid
    assert wide == longest
    assert wide.padded > narrow.padded


def test_the_mean_over_the_planes_is_what_all_of_them_give(bench: Bench, noise: Noise) -> None:
    """Loss, gradients and the eyebox's penalty of one plane at a time, with weights that differ."""
    system = _system(bench)
    settings = Settings(loss="srgb", eyebox=0.1, plane_weights=tuple(1.0 + k for k in range(len(system.planes_m))))
    problem = Problem(system, _stack(system), settings, double=True)
    request = EvaluationRequest(path_gradient=True, amplitude_gradient=True)
    arguments = (_opd(system, noise), np.array(system.amplitudes))
    whole = problem.evaluate(*arguments, request)
    parts = [problem.evaluate(*arguments, replace(request, planes=(k,))) for k in range(len(system.planes_m))]
    assert np.mean([part.loss for part in parts]) == pytest.approx(whole.loss, rel=1e-12)
    for name in ("path_gradient", "amplitude_gradient"):
        mean = np.mean([np.asarray(getattr(part, name)) for part in parts], axis=0)
        expected = np.asarray(getattr(whole, name))
        assert np.linalg.norm(mean - expected) <= 1e-12 * np.linalg.norm(expected)  # 1e3 terms: 1e3·2⁻⁵³
