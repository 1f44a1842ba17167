"""The iteration: it improves, keeps its best, repeats with its seed, and reports what a viewer then sees."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.errors import UserError
from holoview.hologram import load_hologram
from holoview.metrics.psnr import psnr_linear_srgb
from holoview.optimise.solve import Settings, State, iterate
from holoview.system import Modulator, System


def _system(**changes: Any) -> System:
    modulator = Modulator(pitch_m=8e-6, shape=(12, 16), stroke_m=825e-9)
    base = System(
        wavelengths_m=[460e-9, 532e-9, 638e-9],
        amplitudes=[[1.0, 1.0, 1.0]],
        modulators=(modulator, modulator),
        gap_m=0.4e-3,
        planes_m=[0.4e-3, 0.5e-3],
    )
    return base.edit(changes)


def _stack(system: System, seed: int = 0) -> np.ndarray:
    """A smooth colour image in linear sRGB at every plane."""
    plan = hv.make_plan(system)
    rows, columns = plan.grid.shape
    y, x = np.mgrid[0:rows, 0:columns] / max(rows, columns)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    image = 0.3 + 0.2 * np.cos(2 * np.pi * (x + y)[..., None] + phases)
    return np.repeat(image[None], len(plan.planes_m), axis=0)


def _run(system: System, **settings: Any) -> list[State]:
    return list(iterate(system, _stack(system), Settings(**{"iterations": 12, **settings})))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"modulators": [{"pitch": "8 um", "shape": [12, 16], "stroke": "825 nm"}], "gap": None},
        {"amplitudes": np.eye(3)},
        {"source": {"directions": [[0, 0], [0.01, -0.02]]}},
        {"levels": 16},
        {"observer": "mono"},
    ],
    ids=["two modulators", "one modulator", "time-sequential", "sources", "levels", "mono"],
)
def test_the_loss_falls_and_the_picture_gets_better(changes: dict[str, Any]) -> None:
    states = _run(_system(**changes))
    assert [state.iteration for state in states] == list(range(13))
    assert min(state.loss for state in states) < 0.9 * states[0].loss
    assert states[-1].best_psnr_db > states[0].psnr_db


def test_the_best_so_far_is_kept_whatever_comes_after_it() -> None:
    states = _run(_system(levels=4), iterations=15, step_rad=6.0)  # steps that large go up and down
    losses = [state.loss for state in states]
    assert any(later > earlier for earlier, later in pairwise(losses))
    for i, state in enumerate(states):
        best = states[int(np.argmin(losses[: i + 1]))]
        assert state.best_psnr_db == best.psnr_db
        np.testing.assert_array_equal(state.best.drive, best.best.drive)
        assert state.best.system == best.best.system


def test_one_seed_gives_one_hologram_bit_for_bit_and_another_seed_another() -> None:
    system = _system()
    first, second, other = (_run(system, iterations=4, seed=seed)[-1].best for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.drive, second.drive)
    assert first.system == second.system
    assert (first.drive != other.drive).any()


@pytest.mark.parametrize(
    "changes", [{}, {"levels": 4, "amplitudes": np.eye(3)}, {"observer": "mono"}], ids=["plain", "levels", "mono"]
)
def test_the_reported_quality_is_that_of_the_saved_hologram(changes: dict[str, Any], tmp_path: Path) -> None:
    system = _system(**changes)
    state = _run(system)[-1]
    state.best.save(tmp_path / "best.safetensors")
    saved = load_hologram(tmp_path / "best.safetensors")
    view = hv.simulate(saved.system, saved.drive, backend="torch")
    stack = _stack(system)
    if system.observer == "mono":  # a mono camera compares luminance, which it shows as grey
        stack = np.repeat((stack @ [0.2126390, 0.7151687, 0.0721923])[..., None], 3, axis=-1)
    # Single precision on both sides, one grid: measured 1e-6 dB.
    assert psnr_linear_srgb(view.rgb, stack).mean_db == pytest.approx(state.best_psnr_db, abs=1e-4)


def test_a_modulator_of_four_levels_is_only_given_its_levels() -> None:
    levels = [0, 0.2, 0.7, 1]
    drive = _run(_system(levels=levels))[-1].best.drive
    assert set(np.unique(drive)) == set(np.float32(levels))


def test_lasers_that_are_off_in_a_frame_stay_off() -> None:
    amplitudes = _run(_system(amplitudes=np.eye(3)))[-1].best.system.amplitudes
    assert not amplitudes[~np.eye(3, dtype=bool)].any()
    assert (np.diag(amplitudes) > 0).all()


@pytest.mark.parametrize("steps", [1, 3])
def test_it_can_be_stopped_at_any_time_with_a_whole_hologram(steps: int) -> None:
    system = _system()
    states = iterate(system, _stack(system), Settings(iterations=1000))
    for _ in range(steps):
        state = next(states)
    states.close()
    assert state.iteration == steps - 1
    assert hv.simulate(state.best.system, state.best.drive, backend="torch").intensity.shape == (2, 3, 24, 32)


def test_a_start_is_where_it_begins_and_is_left_alone() -> None:
    system = _system()
    start = hv.random_drive(system, seed=9)
    before = start.copy()
    states = list(iterate(system, _stack(system), Settings(iterations=3), start=start))
    np.testing.assert_array_equal(states[0].best.drive, before)
    np.testing.assert_array_equal(start, before)


def test_everything_of_the_bench_but_its_amplitudes_is_kept() -> None:
    system = _system(name="bench", **{"relay2.iris_na": 0.05})
    best = _run(system, iterations=2)[-1].best.system
    assert best.edit({"amplitudes": system.amplitudes}) == system


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"iterations": 0}, "iterations: 0; expected at least 1"),
        ({"iterations": -3}, "iterations: -3"),
        ({"iterations": 2.5}, "iterations: 2.5"),
        ({"step_rad": 0.0}, "step: 0.0; expected a positive phase step"),
        ({"step_rad": -1.0}, "step: -1.0"),
        ({"step_rad": float("nan")}, "step: nan"),
        ({"step_rad": float("inf")}, "step: inf"),
        ({"amplitudes_every": 0}, "amplitudes"),
    ],
    ids=str,
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        Settings(**settings)


def test_a_target_that_does_not_fit_is_refused() -> None:
    system = _system()
    with pytest.raises(UserError, match=r"target: a stack of shape \(1, 24, 32, 3\); expected .*\(2, 24, 32, 3\)"):
        iterate(system, _stack(system)[:1])


@pytest.mark.parametrize("value", [0.0, np.nan], ids=["black", "not a number"])
def test_a_target_that_no_light_can_come_near_is_refused(value: float) -> None:
    system = _system()
    with pytest.raises(UserError, match="target"):
        list(iterate(system, np.full_like(_stack(system), value), Settings(iterations=2)))


@pytest.mark.parametrize("value", [-0.1, 1.1, np.nan])
def test_a_start_outside_the_stroke_is_refused(value: float) -> None:
    system = _system()
    start = hv.random_drive(system)
    start[0, 1, 2, 3] = value
    with pytest.raises(UserError, match="drive"):
        iterate(system, _stack(system), start=start)
