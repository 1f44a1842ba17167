"""The loop on a bench that its model knows, on one that it doesn't, with noise; checkpoints; going back."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.bench.experiment import camera_loop as loop_module
from holoview.bench.experiment.camera_loop import (
    CameraLoop,
    CameraLoopState,
    ModelUpdates,
    UpdatedModel,
    load_loop_checkpoint,
)
from holoview.bench.rig.description import RigDescription
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.experiment.camera_loop.conftest import MakeRig, ModelCamera, system_on, target_on

WRONG = {"effects.gap.gap_error": 3e-4, "effects.stroke.stroke_error": -0.08}


@pytest.fixture
def rig(make_rig: MakeRig) -> RigDescription:
    return make_rig()


@cache
def _nominal_drive(system: System, iterations: int = 40) -> NDArray[np.float32]:
    *_, last = iterate(system, target_on(system), Settings(iterations=iterations))
    return last.best.drive


def _loop(
    rig: RigDescription, camera: ModelCamera, iterations: int, start: NDArray[np.float32] | None = None, **options: Any
) -> CameraLoop:
    system = system_on(rig)
    settings = Settings(iterations=iterations, step_rad=options.pop("step", 0.05))
    return CameraLoop(system, target_on(system), settings, rig, camera, start, **options)


def test_on_a_bench_as_modelled_it_does_what_the_simulation_does(rig: RigDescription) -> None:
    """The same steps from the same start; rounding differs, and Adam's first steps depend on signs alone."""
    system = system_on(rig)
    camera = ModelCamera(system, rig)
    settings = Settings(iterations=4, free=("patterns",))
    simulated = [s.psnr_db for s in iterate(system, target_on(system), settings)]
    measured = [s.psnr_db for s in CameraLoop(system, target_on(system), settings, rig, camera).states()]
    assert measured == pytest.approx(simulated, abs=0.05)
    assert measured[-1] > measured[0] + 1


def test_on_a_wrong_bench_it_gains_most_of_what_the_nominal_model_has_lost(rig: RigDescription) -> None:
    """Lost is what a hologram of the right model has more on the bench than one of the nominal model.

    With five draws it gained 0.79 ± 0.08 of that; 0.35 is more than five of these below.
    """
    system = system_on(rig)
    bench = system.edit(WRONG)
    camera = ModelCamera(bench, rig, shift_m=(6e-6, -3e-6))
    first, *_, last = _loop(rig, camera, 30, _nominal_drive(system)).states()
    known = next(iter(_loop(rig, camera, 1, _nominal_drive(bench)).states()))
    assert known.psnr_db > first.psnr_db + 2
    assert last.best_psnr_db > first.psnr_db + 0.35 * (known.psnr_db - first.psnr_db)


def test_noise_doesnt_keep_it_from_improving(rig: RigDescription) -> None:
    """Noise of 2 % of the mean light, 5e4 counts per second."""
    system = system_on(rig)
    camera = ModelCamera(system.edit(WRONG), rig, noise=1e3)
    loop = _loop(rig, camera, 15, _nominal_drive(system))
    first, *_, last = loop.states()
    assert last.best_psnr_db > first.psnr_db + 1
    assert loop.measure(last.best).psnr_db == pytest.approx(last.best_psnr_db, abs=0.1)


def test_resumed_it_ends_with_the_same_bits(rig: RigDescription, tmp_path: Path) -> None:
    bench = system_on(rig).edit(WRONG)
    start = _nominal_drive(system_on(rig), 5)
    *_, whole = _loop(rig, ModelCamera(bench, rig), 8, start).states()
    for state in _loop(rig, ModelCamera(bench, rig), 8, start).states():
        if state.iteration == 4:
            state.checkpoint().save(tmp_path / "loop.safetensors")
            break
    stored = load_loop_checkpoint(tmp_path / "loop.safetensors")
    resumed = [*_loop(rig, ModelCamera(bench, rig), 8, start, resume=stored).states()]
    assert [state.iteration for state in resumed] == [5, 6, 7, 8]
    assert resumed[-1].loss == whole.loss and resumed[-1].pictures == whole.pictures
    np.testing.assert_array_equal(resumed[-1].best.drive, whole.best.drive)
    assert resumed[-1].best.system == whole.best.system


def test_a_checkpoint_of_another_loop_is_refused(rig: RigDescription) -> None:
    bench = system_on(rig)
    state = next(iter(_loop(rig, ModelCamera(bench, rig), 8).states()))
    with pytest.raises(UserError, match="iterations differ"):
        _loop(rig, ModelCamera(bench, rig), 9, resume=state.checkpoint())


def test_only_levels_are_shown_and_what_is_kept_is_what_was_shown(rig: RigDescription) -> None:
    camera = ModelCamera(system_on(rig), rig)
    *_, last = _loop(rig, camera, 3).states()
    shown = [levels[0] / 255 for levels in camera.recorded[1:]]  # the first are probes
    assert any(np.allclose(last.best.drive[0], levels, atol=1e-6) for levels in shown)


def test_where_the_loss_doesnt_fall_it_goes_back_and_takes_shorter_steps(
    rig: RigDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From steps of ten turns, which throw everything away."""
    system = system_on(rig)
    camera = ModelCamera(system, rig)
    start = _nominal_drive(system)
    states = [*_loop(rig, camera, 5, start, step=60.0).states()]
    assert states[-1].best_psnr_db == states[0].psnr_db
    best = camera.recorded[1]
    assert [np.array_equal(levels, best) for levels in camera.recorded[1:]] == [True, False, False, False, True, False]
    assert states[-1].checkpoint().progress.step_factor == 0.5


def test_updates_of_the_model_see_random_patterns_and_holograms_and_change_the_model(
    rig: RigDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = system_on(rig)
    camera, seen = ModelCamera(system.edit(WRONG), rig), []

    def update(present: System, captures: list[Any], updates: ModelUpdates, is_asked: Any) -> UpdatedModel:
        seen.append(len(captures))
        return UpdatedModel(present.edit(WRONG), "found it")

    monkeypatch.setattr(loop_module, "update_model", update)
    states: list[CameraLoopState] = [*_loop(rig, camera, 4, updates=ModelUpdates(2)).states()]
    assert seen == [8 + 1, 8 + 2] and camera.rested == 2
    assert states[2].notes == ("the model is updated: found it",) and states[3].notes == ()
    assert states[-1].checkpoint().present.effect_values == system.edit(WRONG).effect_values
    assert states[-1].checkpoint().begun == system


def test_a_start_of_another_shape_is_refused(rig: RigDescription) -> None:
    with pytest.raises(UserError, match="patterns of shape"):
        _loop(rig, ModelCamera(system_on(rig), rig), 3, np.zeros((1, 2, 8, 8), np.float32))
