"""Gradients at measured intensities: those of the simulation where bench and model agree; masks; the whole adjoint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from holoview.bench.experiment.bench_camera import PictureRequest, TakenPicture
from holoview.bench.experiment.camera_problem import (
    CameraCalibration,
    CameraProblem,
    CameraSampling,
    calibrate_camera,
    probe_levels,
)
from holoview.bench.experiment.rig_bench import lasers_of, levels_of_drive
from holoview.bench.rig.description import RigDescription
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.variables import PatternVariables, initial_drive
from holoview.util.errors import UserError
from tests.experiment.camera_loop.conftest import PLANE_M, MakeRig, ModelCamera, system_on, target_on

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
    slopes = np.array(expected.amplitude_gradient)  # one may vanish, as a difference of sums as large as the others'
    np.testing.assert_allclose(found.amplitude_gradient, slopes, rtol=1e-4, atol=1e-5 * np.abs(slopes).max())


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


def _saturated(pictures: list[TakenPicture], value: float) -> list[TakenPicture]:
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


_CASES = {
    "equal": ((12, 16), 4e-6, (0.0, 0.0)),
    "moved": ((12, 16), 4e-6, (1.3e-6, -5.1e-6)),
    "coarser": ((6, 7), 8e-6, (1e-6, -3e-6)),
    "finer and larger": ((30, 41), 2.5e-6, (0.0, 2e-6)),
}


@pytest.mark.parametrize("case", _CASES)
def test_the_transpose_is_that_of_the_picture(case: str) -> None:
    pixels, pitch_m, shift_m = _CASES[case]
    view = CameraSampling((12, 16), 4e-6, pixels, pitch_m, shift_m)
    generator = torch.Generator().manual_seed(1)
    samples = torch.randn(2, 12, 16, generator=generator, dtype=torch.float64)
    slopes = torch.randn(2, *pixels, generator=generator, dtype=torch.float64)
    left, right = (view.picture(samples) * slopes).sum(), (samples * view.transposed(slopes)).sum()
    assert float(left) == pytest.approx(float(right), rel=1e-12)


def test_a_camera_that_has_moved_by_whole_samples_sees_the_samples_that_are_there() -> None:
    samples = torch.arange(12.0 * 16, dtype=torch.float64).reshape(12, 16).sin()
    seen = CameraSampling((12, 16), 4e-6, (12, 16), 4e-6, (4e-6, -8e-6)).picture(samples)
    torch.testing.assert_close(seen[1:, :-2], samples[:-1, 2:], rtol=0, atol=1e-12)


def test_a_pixel_of_four_samples_is_their_mean() -> None:
    samples = torch.randn(12, 16, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    seen = CameraSampling((12, 16), 4e-6, (6, 8), 8e-6).picture(samples)
    torch.testing.assert_close(seen, samples.reshape(6, 2, 8, 2).mean(dim=(1, 3)), rtol=0, atol=1e-12)


def test_between_samples_fine_detail_is_kept_to_two_per_cent() -> None:
    """Half a sample is the worst shift; at 0.8 of the Nyquist frequency the error is 2.2 %."""
    x = np.arange(64)
    frequency = 0.75 * np.pi
    samples = torch.from_numpy(np.tile(np.cos(frequency * x), (8, 1)))
    seen = CameraSampling((8, 64), 4e-6, (8, 64), 4e-6, (0.0, 2e-6)).picture(samples).numpy()
    np.testing.assert_allclose(seen[:, 8:-8], np.tile(np.cos(frequency * (x - 0.5)), (8, 1))[:, 8:-8], atol=0.02)


def test_pixels_that_lie_partly_outside_arent_covered() -> None:
    view = CameraSampling((12, 16), 4e-6, (12, 16), 4e-6, (4e-6, -8e-6))
    expected = np.zeros((12, 16), bool)
    expected[1:, :-2] = True
    np.testing.assert_array_equal(view.covers(None), expected)
    assert view.covers((2, 3, 5, 4)).sum() == 20
    assert CameraSampling((12, 16), 4e-6, (6, 8), 8e-6).covers((1, 1, 4, 4)).sum() == 1


SEEN_SCALE = 3e4
TWO = '["450 nm", "638 nm"]'


def _probes(rig: RigDescription, **options: object) -> tuple[torch.Tensor, list[list[TakenPicture]]]:
    """The nominal prediction (wavelength, probe, y, x), and pictures of a bench; `bench`: its effects."""
    nominal = system_on(rig)
    bench = nominal.edit(options.pop("bench", {}))  # type: ignore[arg-type]
    camera = ModelCamera(bench, rig, scale=SEEN_SCALE, **options)  # type: ignore[arg-type]
    levels = probe_levels(rig, 0)
    shots = [PictureRequest(p, λ, PLANE_M) for λ in lasers_of(nominal, rig) for p in range(len(levels))]
    pictures = camera.record(levels, shots)
    problem = CameraProblem(nominal, target_on(nominal), Settings(), rig)
    strokes = torch.tensor([m.stroke_m for m in nominal.modulators])[:, None, None]
    paths = [torch.tensor(own / 255.0, dtype=torch.float32) * strokes for own in levels]
    predicted = torch.stack([problem.predict(path[None].float())[0] for path in paths], dim=1)
    return predicted, [pictures[i : i + len(levels)] for i in range(0, len(pictures), len(levels))]


def _calibrate(rig: RigDescription, **options: object) -> CameraCalibration:
    predicted, pictures = _probes(rig, **options)
    return calibrate_camera(rig, predicted[None], 4e-6, [pictures])


def test_of_a_bench_as_modelled_the_scale_is_exact_and_the_camera_stays(make_rig: MakeRig) -> None:
    found = _calibrate(make_rig(lasers=TWO))
    np.testing.assert_allclose(found.scale, SEEN_SCALE, rtol=1e-5)
    assert not found.shift_m.any() and found.correlation == pytest.approx(1.0)
    assert found.notes(np.array([PLANE_M])) == []


@pytest.mark.parametrize("shift_um", [(6.0, -9.0), (-1.0, 0.5), (14.0, 3.0)])
def test_a_displaced_camera_is_found_to_a_tenth_of_a_pixel(make_rig: MakeRig, shift_um: tuple[float, float]) -> None:
    shift_m = (shift_um[0] * 1e-6, shift_um[1] * 1e-6)
    found = _calibrate(make_rig(), shift_m=shift_m)
    np.testing.assert_allclose(found.shift_m[0], shift_m, atol=0.4e-6)
    np.testing.assert_allclose(found.scale, SEEN_SCALE, rtol=5e-3)


def test_a_wrong_bench_hardly_changes_the_scale(make_rig: MakeRig) -> None:
    """Modulators absorb nothing, so that a wrong gap only moves light: across edges and through the second iris."""
    found = _calibrate(make_rig(lasers=TWO), bench={"effects.gap.gap_error": 3e-4}, shift_m=(6e-6, -9e-6))
    np.testing.assert_allclose(found.scale, SEEN_SCALE, rtol=0.05)
    np.testing.assert_allclose(found.shift_m[0], (6e-6, -9e-6), atol=2e-6)


def test_one_bad_probe_doesnt_move_the_scale(make_rig: MakeRig) -> None:
    rig = make_rig()
    predicted, pictures = _probes(rig)
    brighter = [[replace(pictures[0][0], light=pictures[0][0].light * 30), *pictures[0][1:]]]
    planes = [pictures, pictures, brighter]
    found = calibrate_camera(rig, torch.stack([predicted] * 3), 4e-6, planes)
    np.testing.assert_allclose(found.scale, SEEN_SCALE, rtol=1e-5)


def test_saturated_pixels_dont_count(make_rig: MakeRig) -> None:
    rig = make_rig()
    predicted, pictures = _probes(rig)
    cut = []
    for picture in pictures[0]:
        saturated = picture.light > np.quantile(picture.light, 0.9)
        light = np.minimum(picture.light, np.quantile(picture.light, 0.9))
        cut.append(replace(picture, light=light, saturated=saturated))
    found = calibrate_camera(rig, predicted[None], 4e-6, [[cut]])
    np.testing.assert_allclose(found.scale, SEEN_SCALE, rtol=1e-5)


def test_pictures_of_something_else_leave_the_camera_centred_and_say_so(make_rig: MakeRig) -> None:
    rig = make_rig()
    predicted, pictures = _probes(rig)
    rng = np.random.default_rng(5)
    other = [[replace(p, light=rng.random(p.light.shape)) for p in of_laser] for of_laser in pictures]
    found = calibrate_camera(rig, predicted[None], 4e-6, [other])
    assert not found.shift_m.any()
    assert "don't resemble" in found.notes(np.array([PLANE_M]))[0]


def test_a_laser_without_light_is_named(make_rig: MakeRig) -> None:
    rig = make_rig(lasers=TWO)
    predicted, pictures = _probes(rig)
    dark = [pictures[0], [replace(p, light=np.zeros_like(p.light)) for p in pictures[1]]]
    with pytest.raises(UserError, match="no light"):
        calibrate_camera(rig, predicted[None], 4e-6, [dark])
