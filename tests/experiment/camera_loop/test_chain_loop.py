"""The camera in the loop of a chain of elements: gradients at measured light, a bench with a fault, checkpoints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.bench.experiment.bench_camera import BenchCamera, PictureRequest, TakenPicture
from holoview.bench.experiment.camera_loop import CameraLoop, load_loop_checkpoint
from holoview.bench.experiment.camera_problem import CameraCalibration, camera_sampling
from holoview.bench.experiment.chain_camera import ChainCameraProblem, ChainVariables
from holoview.bench.experiment.rig_bench import drive_of_levels, levels_of_drive, on_rig, system_of_rig
from holoview.bench.rig import RigDescription, read_rig
from holoview.holograms.optimise.chain_loop import ChainProblem
from holoview.holograms.optimise.problem import EvaluationRequest
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.experiment.camera_loop.conftest import BenchHere
from tests.rig.test_chain_rig import CAMERA, COARSE, PHASE, SPACE, chain_of, write_chain_rig

SCALE = 5e4
WRONG = {"effects.gap@space.gap_error": 3e-4, "effects.stroke@phase.stroke_error": -0.08}


@pytest.fixture
def rig(tmp_path: Path) -> RigDescription:
    return read_rig(write_chain_rig(tmp_path))


def bench_of(rig: RigDescription, **changes: Any) -> System:
    """The rig's own bench with one laser and one focal plane."""
    one = {"wavelengths": ["638 nm"], "amplitudes": [[1.0]], "planes": ["3 mm"]}
    return on_rig(system_of_rig(rig).edit({**one, **changes}), rig)


def target_of(system: System) -> NDArray[np.float32]:
    """A smooth random picture at every plane."""
    rng = np.random.default_rng(7)
    picture = gaussian_filter(rng.random((len(system.planes_m), *system.way.shape, 3)), (0, 5, 5, 0))
    return (0.6 * (picture - picture.min()) / np.ptp(picture)).astype(np.float32)


class ModelCamera:
    """Takes the pictures that a model of the bench predicts."""

    def __init__(self, system: System, rig: RigDescription, shift_m: tuple[float, float] = (0.0, 0.0)) -> None:
        self.exposures_s: dict[float, float] = {}
        self.pictures, self.bench_s, self._system, self._rig = 0, 0.0, system, rig
        self._problem = ChainCameraProblem(system, target_of(system), Settings(), rig)
        self._view = camera_sampling(rig, self._problem.grid.shape, self._problem.sample_pitch_m, shift_m)

    def record(self, levels: NDArray[np.uint16], shots: Sequence[PictureRequest]) -> list[TakenPicture]:
        seen = [self._seen(own) for own in levels]
        self.pictures += len(shots)
        return [self._picture(seen[shot.frame], shot) for shot in shots]

    def rest(self) -> None: ...

    def _seen(self, levels: NDArray[np.uint16]) -> NDArray[np.float64]:
        drive = {name: torch.as_tensor(own) for name, own in drive_of_levels(levels, self._system).items()}
        return self._view.picture(self._problem.predict(drive)).double().numpy()

    def _picture(self, seen: NDArray[np.float64], shot: PictureRequest) -> TakenPicture:
        plane = int(np.argmin(np.abs(self._system.planes_m - shot.distance_m)))
        λ = self._system.wavelengths_m
        laser = next(i for i, (_, k) in enumerate(self._problem.lasers) if np.isclose(λ[k], shot.wavelength_m))
        light = SCALE * seen[plane, laser]
        return TakenPicture(light, np.zeros(light.shape, bool), self._rig.blank_capture())


class Case:
    """A chain, its patterns, and the problem with the pictures of a bench."""

    def __init__(self, rig: RigDescription, shift_m: tuple[float, float] = (0.0, 0.0), **changes: Any) -> None:
        self.system, self.settings = bench_of(rig, **changes), Settings()
        self.target = target_of(self.system)
        self.shown = ChainVariables(self.system, self.settings, None).patterns.displayed_drive()
        self.problem = ChainCameraProblem(self.system, self.target, self.settings, rig)
        planes, lasers = len(self.system.planes_m), len(self.system.wavelengths_m)
        self.problem.calibrate(
            CameraCalibration(np.full(lasers, SCALE), np.tile(shift_m, (planes, 1)), np.ones(planes))
        )
        levels = levels_of_drive({n: t.detach().numpy() for n, t in self.shown.items()}, self.system)
        self.pictures = ModelCamera(self.system, rig, shift_m).record(levels, self.problem.shots)
        self.problem.set_pictures(self.pictures)

    @property
    def amplitudes(self) -> NDArray[np.float64]:
        return np.array(self.system.amplitudes)


@pytest.mark.parametrize("frames", [[[1.0, 0.5]], [[1.0, 0.0], [0.0, 1.0]]], ids=["together", "in turn"])
def test_the_gradient_is_that_of_the_simulation_where_the_bench_is_as_its_model(
    rig: RigDescription, frames: list[list[float]]
) -> None:
    """Of phase and amplitude patterns. Single precision rounds sums of thousands of products."""
    lasers = {"wavelengths": ["450 nm", "638 nm"], "amplitudes": frames, "planes": ["2.5 mm", "4 mm"]}
    case = Case(rig, **lasers)
    simulated = ChainProblem(case.system, case.target, case.settings)
    light = simulated.evaluate(case.shown, case.amplitudes)
    loss, image = simulated.loss(light, case.amplitudes)
    expected = torch.cat([own.flatten() for own in torch.autograd.grad(loss, list(case.shown.values()))])
    request = EvaluationRequest(path_gradient=True, optimal_amplitudes=True)
    found = case.problem.evaluate(case.shown, case.amplitudes, request)
    assert found.loss == pytest.approx(float(loss.detach()), rel=1e-5)
    assert found.psnr_db == pytest.approx(simulated.objective.psnr_db(image), abs=1e-4)
    assert found.path_gradient is not None
    assert float((found.path_gradient - expected).norm() / expected.norm()) < 1e-5
    np.testing.assert_allclose(found.optimal_amplitudes, simulated.solved_amplitudes(light.intensity), rtol=1e-4)


def test_of_a_coarse_camera_that_has_moved_the_gradient_is_that_of_the_loss(tmp_path: Path) -> None:
    """Along the gradient, against the central difference of the loss whose pictures follow the patterns."""
    camera = {"device": "virtual", "black_level": 64, **CAMERA, "shape": [24, 32], "pitch": "8 um"}
    case = Case(read_rig(write_chain_rig(tmp_path, {"camera": camera})), (5e-6, -3e-6))
    found = case.problem.evaluate(case.shown, case.amplitudes, EvaluationRequest(path_gradient=True)).path_gradient
    assert found is not None
    norm, sizes = float(found.norm()), [own.numel() for own in case.shown.values()]
    steps = [part.view_as(own) / norm for part, own in zip(found.split(sizes), case.shown.values(), strict=True)]
    losses, free = [], [replace(e, levels=None) if hasattr(e, "levels") else e for e in case.system.elements]
    continuous = ChainCameraProblem(case.system.edit({"elements": free}), case.target, case.settings, case.problem._rig)
    for sign in (-0.02, 0.02):
        moved = {name: own.detach() + sign * step for (name, own), step in zip(case.shown.items(), steps, strict=True)}
        light = case.problem._views[0].picture(continuous.predict(moved)[0]).double().numpy() * SCALE
        case.problem.set_pictures([replace(p, light=own) for p, own in zip(case.pictures, light, strict=True)])
        losses.append(case.problem.evaluate(case.shown, case.amplitudes, EvaluationRequest()).loss)
    assert (losses[1] - losses[0]) / 0.04 == pytest.approx(norm, rel=0.02)


def _start(system: System, iterations: int = 12) -> Mapping[str, NDArray[np.float32]]:
    *_, last = iterate(system, target_of(system), Settings(iterations=iterations))
    drive: Mapping[str, NDArray[np.float32]] = last.best.drive
    return drive


def _loop(rig: RigDescription, camera: Any, iterations: int, **options: Any) -> CameraLoop:
    system = bench_of(rig)
    return CameraLoop(system, target_of(system), Settings(iterations=iterations, step_rad=0.05), rig, camera, **options)


def test_on_a_bench_as_modelled_it_does_what_the_simulation_does(rig: RigDescription) -> None:
    """The same steps from the same start; rounding differs, and Adam's first steps depend on signs alone."""
    system, settings = bench_of(rig), Settings(iterations=4, free=("patterns",))
    simulated = [s.psnr_db for s in iterate(system, target_of(system), settings)]
    camera = ModelCamera(system, rig)
    measured = [s.psnr_db for s in CameraLoop(system, target_of(system), settings, rig, camera).states()]
    assert measured == pytest.approx(simulated, abs=0.05)
    assert measured[-1] > measured[0]


def test_on_a_wrong_bench_it_gains_most_of_what_the_nominal_model_has_lost(rig: RigDescription) -> None:
    """Lost is what a hologram of the right model has more on the bench than one of the nominal model.

    With three draws it gained 0.79 to 0.89 of that.
    """
    system = bench_of(rig)
    bench = system.edit(WRONG)
    camera = ModelCamera(bench, rig)
    first, *_, last = _loop(rig, camera, 30, start=_start(system, 40)).states()
    known = next(iter(_loop(rig, camera, 1, start=_start(bench, 40)).states()))
    assert known.psnr_db > first.psnr_db + 0.1
    assert last.best_psnr_db > first.psnr_db + 0.5 * (known.psnr_db - first.psnr_db)


def test_resumed_it_ends_with_the_same_bits(rig: RigDescription, tmp_path: Path) -> None:
    bench, start = bench_of(rig).edit(WRONG), _start(bench_of(rig), 3)
    *_, whole = _loop(rig, ModelCamera(bench, rig), 6, start=start).states()
    for state in _loop(rig, ModelCamera(bench, rig), 6, start=start).states():
        if state.iteration == 3:
            state.checkpoint().save(tmp_path / "loop.safetensors")
            break
    stored = load_loop_checkpoint(tmp_path / "loop.safetensors")
    resumed = [*_loop(rig, ModelCamera(bench, rig), 6, start=start, resume=stored).states()]
    assert [state.iteration for state in resumed] == [4, 5, 6] and resumed[-1].loss == whole.loss
    for name, drive in whole.best.drive.items():
        np.testing.assert_array_equal(resumed[-1].best.drive[name], drive)
    assert resumed[-1].best.system == whole.best.system


def test_only_levels_are_shown_and_an_element_that_is_held_stays(tmp_path: Path) -> None:
    rig = read_rig(write_chain_rig(tmp_path, chain=chain_of(PHASE, SPACE, COARSE | {"held": True})))
    bench = BenchHere(rig)
    *_, last = _loop(rig, BenchCamera(rig, bench.devices()), 2).states()
    coarse = last.best.drive["coarse"]
    assert (coarse == 1.0).all() and bench.taken > 0
    levels = last.best.drive["phase"] * 255
    np.testing.assert_allclose(levels, np.rint(levels), atol=1e-4)


def test_levels_and_drives_are_inverse(rig: RigDescription) -> None:
    system = bench_of(rig, amplitudes=[[1.0], [1.0]])
    levels = rig.random_levels(np.random.default_rng(1), 1.0)
    drive = drive_of_levels(levels, system)
    assert {name: own.shape for name, own in drive.items()} == system.drive_shapes
    again = levels_of_drive(drive, system)
    assert again.shape == (2, *levels.shape) and (again == levels).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"elements.phase.stroke": "700 nm"}, "elements.phase.stroke: is 700 nm; expected 825 nm"),
        ({"elements.coarse.levels": 16}, "elements.coarse.levels"),
        ({"elements.coarse.range": [0.1, 1.0]}, "elements.coarse.range"),
        ({"elements.space.distance": "2 mm"}, "elements.space.distance: is 2 mm; expected 1 mm"),
    ],
)
def test_another_chain_is_refused_with_what_differs(rig: RigDescription, changes: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said.replace("[", r"\[")):
        on_rig(system_of_rig(rig).edit(changes), rig)


def test_how_the_optimiser_moves_an_element_is_no_difference(rig: RigDescription) -> None:
    system = system_of_rig(rig).edit({"elements.coarse.held": True, "elements.phase.step": 0.02})
    assert on_rig(system, rig).elements[2].held  # type: ignore[attr-defined]


def test_a_bench_of_another_form_is_refused(rig: RigDescription) -> None:
    with pytest.raises(UserError, match=r"elements: is .*; expected phase, space, coarse"):
        on_rig(System(["638 nm"], [[1.0]], elements=[PHASE], planes_m=["3 mm"]), rig)


def test_a_start_of_another_shape_is_refused(rig: RigDescription) -> None:
    with pytest.raises(UserError, match="--start: patterns of shape"):
        _loop(rig, ModelCamera(bench_of(rig), rig), 2, start={"phase": np.zeros((1, 4, 4), np.float32)})
