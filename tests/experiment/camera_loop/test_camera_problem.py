"""Gradients at measured intensities: those of the simulation where bench and model agree; masks; the whole adjoint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from holoview.experiment.camera_loop.bench_camera import Picture
from holoview.experiment.camera_loop.camera_problem import CameraCalibration, CameraProblem
from holoview.experiment.rig_bench import levels_of_drive
from holoview.optimise.problem import EvaluationRequest, Problem
from holoview.optimise.settings import Settings
from holoview.optimise.variables import PatternVariables, initial_drive
from holoview.rig.description import RigDescription
from holoview.util.errors import UserError
from tests.experiment.camera_loop.conftest import ModelCamera, system_on, target_on

MakeRig = Callable[..., RigDescription]
THREE = '["450 nm", "520 nm", "638 nm"]'
SCALE = 5e4


class Case:
    """A system, its drive, and both problems; the camera's has the pictures of a bench."""

    def __init__(
        self,
        rig: RigDescription,
        settings: Settings,
        shift_m: tuple[float, float] = (0.0, 0.0),
        bench: dict[str, object] | None = None,
        **changes: object,
    ) -> None:
        self.system = system_on(rig, **changes)
        self.target, self.settings = target_on(self.system), settings
        patterns = PatternVariables(self.system, settings, initial_drive(self.system, settings))
        shown = patterns.displayed_drive()
        self.path_m, self.step_m = patterns.optical_path_m(shown), patterns.level_step_m()
        camera = ModelCamera(self.system.edit(bench or {}), rig, scale=SCALE, shift_m=shift_m)
        self.problem = CameraProblem(self.system, self.target, settings, rig)
        planes = len(self.system.planes_m)
        scale = np.full(len(self.system.wavelengths_m), SCALE)
        self.problem.calibrate(CameraCalibration(scale, np.tile(shift_m, (planes, 1)), np.ones(planes)))
        self.pictures = camera.record(levels_of_drive(shown.numpy(), self.system), self.problem.shots)
        self.problem.set_pictures(self.pictures)

    def amplitudes(self) -> NDArray[np.float64]:
        return np.array(self.system.amplitudes)


@pytest.mark.parametrize("loss", ["linear-srgb", "srgb"])
@pytest.mark.parametrize("scheme", ["simultaneous", "frames"])
def test_the_gradient_is_that_of_the_simulation_where_the_bench_is_as_its_model(
    make_rig: MakeRig, loss: str, scheme: str
) -> None:
    """Single precision rounds each of the 3072 sums of products; 1e-5 of their norm is a hundred times that."""
    frames = {"amplitudes": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]} if scheme == "frames" else {}
    case = Case(make_rig(lasers=THREE), Settings(loss=loss), planes=[1e-3, 3e-3], **frames)
    simulated = Problem(case.system, case.target, case.settings)
    request = EvaluationRequest(True, True, amplitude_gradient=True, level_step_m=case.step_m)
    expected, found = (p.evaluate(case.path_m, case.amplitudes(), request) for p in (simulated, case.problem))
    assert found.loss == pytest.approx(expected.loss, rel=1e-5)
    assert found.psnr_db == pytest.approx(expected.psnr_db, abs=1e-4)
    assert found.path_gradient is not None and expected.path_gradient is not None
    difference = (found.path_gradient - expected.path_gradient).norm() / expected.path_gradient.norm()
    assert float(difference) < 1e-5
    np.testing.assert_allclose(found.optimal_amplitudes, expected.optimal_amplitudes, rtol=1e-4)
    np.testing.assert_allclose(found.amplitude_gradient, expected.amplitude_gradient, rtol=1e-4, atol=1e-9)


def test_of_a_coarse_camera_that_has_moved_the_gradient_is_that_of_the_loss(make_rig: MakeRig) -> None:
    """Along the gradient, against the central difference of the loss whose pictures follow the patterns."""
    rig, shift_m = make_rig(pixels=(24, 32), pitch_um=8.0), (5e-6, -3e-6)
    case = Case(rig, Settings(), shift_m, upsample=2)
    evaluated = case.problem.evaluate(case.path_m, case.amplitudes(), EvaluationRequest(path_gradient=True))
    assert evaluated.path_gradient is not None
    direction = evaluated.path_gradient / evaluated.path_gradient.norm()
    losses = []
    for sign in (-1, 1):
        path_m = case.path_m + sign * 4e-8 * direction
        light = case.problem._views[0].picture(case.problem.predict(path_m)[0]).double().numpy() * SCALE
        case.problem.set_pictures([replace(p, light=own) for p, own in zip(case.pictures, light, strict=True)])
        losses.append(case.problem.evaluate(path_m, case.amplitudes(), EvaluationRequest()).loss)
    slope = (losses[1] - losses[0]) / 8e-8
    assert slope == pytest.approx(float(evaluated.path_gradient.norm()), rel=0.02)


def test_at_a_wrong_bench_the_residual_is_that_of_the_bench(make_rig: MakeRig) -> None:
    case = Case(make_rig(), Settings(), bench={"effects.gap.gap_error": 2e-4})
    bench = Problem(case.system.edit({"effects.gap.gap_error": 2e-4}), case.target, case.settings)
    expected, found = (
        p.evaluate(case.path_m, case.amplitudes(), EvaluationRequest(path_gradient=True)) for p in (bench, case.problem)
    )
    assert found.loss == pytest.approx(expected.loss, rel=1e-5)
    assert found.path_gradient is not None and expected.path_gradient is not None
    cosine = torch.nn.functional.cosine_similarity(
        found.path_gradient.flatten(), expected.path_gradient.flatten(), dim=0
    )
    simulated = Problem(case.system, case.target, case.settings)
    blind = simulated.evaluate(case.path_m, case.amplitudes(), EvaluationRequest(path_gradient=True)).path_gradient
    assert blind is not None
    of_model = torch.nn.functional.cosine_similarity(blind.flatten(), expected.path_gradient.flatten(), dim=0)
    assert float(cosine) > float(of_model) and float(cosine) > 0.5


def _saturated(pictures: list[Picture], value: float) -> list[Picture]:
    """The pictures with a saturated square of this light."""
    changed = []
    for picture in pictures:
        light, saturated = picture.light.copy(), picture.saturated.copy()
        light[10:20, 30:40], saturated[10:20, 30:40] = value, True
        changed.append(replace(picture, light=light, saturated=saturated))
    return changed


def test_what_saturated_pixels_hold_changes_nothing(make_rig: MakeRig) -> None:
    case = Case(make_rig(), Settings())
    request, found = EvaluationRequest(path_gradient=True, optimal_amplitudes=True), []
    for value in (0.0, 1e9):
        case.problem.set_pictures(_saturated(case.pictures, value))
        found.append(case.problem.evaluate(case.path_m, case.amplitudes(), request))
    assert found[0].loss == found[1].loss and found[0].psnr_db == found[1].psnr_db
    np.testing.assert_array_equal(found[0].optimal_amplitudes, found[1].optimal_amplitudes)
    assert found[0].path_gradient is not None and found[1].path_gradient is not None
    torch.testing.assert_close(found[0].path_gradient, found[1].path_gradient, rtol=0, atol=0)


def test_the_loss_is_the_mean_over_the_pixels_that_count(make_rig: MakeRig) -> None:
    case = Case(make_rig(), Settings())
    case.problem.set_pictures(_saturated(case.pictures, 1e9))
    found = case.problem.evaluate(case.path_m, case.amplitudes(), EvaluationRequest())
    image = sum(picture.light / SCALE * a for picture, a in zip(case.pictures, case.system.amplitudes[0], strict=True))
    target = case.problem.objective.target[0, 0].numpy()
    counts = np.ones(image.shape, bool)
    counts[10:20, 30:40] = False
    assert found.loss == pytest.approx(np.mean((image - target)[counts] ** 2), rel=1e-5)


def test_the_psnr_is_that_of_the_metrics(make_rig: MakeRig) -> None:
    case = Case(make_rig(lasers=THREE), Settings())
    found = case.problem.evaluate(case.path_m, case.amplitudes() * 0.2, EvaluationRequest())
    table = case.problem.objective.wavelength_channels.numpy() * 0.2 * case.system.amplitudes[0][:, None]
    image = np.einsum("lc,lyx->yxc", table, [picture.light / SCALE for picture in case.pictures])
    error = np.clip(image, 0, 1) - np.clip(case.target[0], 0, 1)
    assert found.psnr_db == pytest.approx(-10 * np.log10(np.mean(error**2)), abs=1e-4)


def test_a_region_leaves_the_other_pixels_out(make_rig: MakeRig) -> None:
    case = Case(make_rig(), Settings(region=(8, 4, 20, 30)))
    simulated = Problem(case.system, case.target, case.settings)
    expected, found = (
        p.evaluate(case.path_m, case.amplitudes(), EvaluationRequest()) for p in (simulated, case.problem)
    )
    assert found.loss == pytest.approx(expected.loss, rel=1e-5)


def test_nothing_but_saturated_pixels_is_refused(make_rig: MakeRig) -> None:
    case = Case(make_rig(), Settings())
    with pytest.raises(UserError, match="saturated"):
        case.problem.set_pictures([replace(p, saturated=np.ones_like(p.saturated)) for p in case.pictures])


@pytest.mark.parametrize("settings", [Settings(free=("wavelengths",)), Settings(pupil_places_m=((0.0, 0.0),))])
def test_what_a_camera_cant_serve_is_refused(make_rig: MakeRig, settings: Settings) -> None:
    rig = make_rig()
    system = system_on(rig)
    with pytest.raises(UserError, match="with --rig"):
        CameraProblem(system, target_on(system), settings, rig)
