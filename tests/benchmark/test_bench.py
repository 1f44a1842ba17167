"""`holoview bench` compares equal work: the loop in torch and the shaders compute the same image."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from holoview.commands import bench
from holoview.commands.cli import main
from holoview.evidence.benchmark import frame_benchmark
from holoview.evidence.benchmark.frame_benchmark import (
    WAYS,
    PrunedTorchBaseline,
    TorchBaseline,
    Way,
    benchmark_frame,
    can_prune,
    device_time,
)
from holoview.evidence.benchmark.frame_jobs import JobTimings, TuningReport, time_interleaved
from holoview.holograms.view import random_drive
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.gpu.device import TIMESTAMPS, Device
from holoview.light.gpu.line_fft import supported_strategies
from holoview.light.gpu.recorder import GpuTimer
from holoview.light.gpu.tune import TuningResult
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from tests.second_device import SecondDevice

TOLERANCE = 2e-6
"""Relative L2 of XYZ from complex64; 6e-7 is what torch's own executor has."""


def _system(**changes: Any) -> System:
    return preset.load("holochrome-8").edit({"shape": [24, 32], "propagation": "periodic"} | changes)


@pytest.mark.parametrize("batched", [False, True])
@pytest.mark.parametrize("changes", [{}, {"relay2.iris_na": 0.02}, {"modulators": None, "gap": None}])
def test_the_torch_loop_computes_what_the_reference_executor_computes(batched: bool, changes: dict[str, Any]) -> None:
    if "modulators" in changes:
        changes = changes | {"modulators": [{"pitch": "8 um", "shape": [24, 32], "stroke": "825 nm"}]}
    system = _system(**changes)
    plan, drive = make_plan(system, [0.01]), random_drive(system)
    expected = compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, drive), double=True))[1][0]
    found = TorchBaseline(plan, FrameInputs(plan, drive), batched=batched)().movedim(0, -1).numpy()
    assert np.linalg.norm(found - expected) <= TOLERANCE * np.linalg.norm(expected)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("changes", [{}, {"upsample": 4}, {"relay1": {"iris_na": 0.01}, "relay2.dc_block_na": 0.003}])
def test_the_pruned_torch_loop_computes_what_the_reference_executor_computes(way: Way, changes: dict[str, Any]) -> None:
    system = _system(**changes)
    plan, drive = make_plan(system, [0.01]), random_drive(system)
    expected = compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, drive), double=True))[1][0]
    loop = PrunedTorchBaseline(plan, FrameInputs(plan, drive), way)
    for _ in range(2):  # the second time with the memory of the first
        found = loop().movedim(0, -1).numpy()
        assert np.linalg.norm(found - expected) <= TOLERANCE * np.linalg.norm(expected)


def test_the_pruned_torch_loop_refuses_stops_beyond_the_first_order() -> None:
    system = _system(**{"relay1.square": "1.2 first order"})
    plan = make_plan(system)
    assert not can_prune(plan)
    with pytest.raises(ValueError, match="within the first order"):
        PrunedTorchBaseline(plan, FrameInputs(plan, random_drive(system)), "lines")


@pytest.mark.parametrize("batched", [False, True])
def test_the_torch_loop_keeps_to_its_device(batched: bool) -> None:
    plan = make_plan(_system(), [0.01])
    inputs = FrameInputs(plan, random_drive(_system()))
    expected = TorchBaseline(plan, inputs, batched=batched)()
    with SecondDevice():
        found = TorchBaseline(plan, inputs, batched=batched, device="cuda")()
        assert found.device.type == "cuda" and torch.equal(found.cpu(), expected)


@pytest.mark.parametrize(
    "changes", [{"propagation": "linear"}, {"source": {"directions": [[0.0, 0.01]]}}, {"amplitudes": [[1.0] * 8] * 2}]
)
def test_the_torch_loop_refuses_a_bench_that_it_has_no_code_for(changes: dict[str, Any]) -> None:
    system = _system(**changes)
    plan = make_plan(system)
    with pytest.raises(ValueError, match="expected a periodic grid"):
        TorchBaseline(plan, FrameInputs(plan, random_drive(system)), batched=False)


def test_each_round_runs_every_job_once_and_warm_up_is_not_timed() -> None:
    ran: list[str] = []
    samples = time_interleaved({name: lambda name=name: ran.append(name) for name in "ab"}, rounds=3, warm_up=1)  # type: ignore[misc]
    assert ran == list("abababab")
    assert all(len(sample.seconds) == 3 for sample in samples.values())
    assert JobTimings((0.003, 0.001, 0.002)).median_ms == pytest.approx(2.0)
    assert JobTimings((0.003, 0.001, 0.002)).minimum_ms == pytest.approx(1.0)


@pytest.mark.long
@pytest.mark.gpu
def test_criteria_are_ratios_of_jobs_that_did_the_work(device: Device) -> None:
    threads = torch.get_num_threads()
    found = benchmark_frame(_system(), device, rounds=1, strategy="passes")
    assert torch.get_num_threads() == threads
    assert all(math.isfinite(criterion.value) and criterion.value > 0 for criterion in found.criteria)
    error = next(criterion for criterion in found.criteria if "error" in criterion.name)
    assert error.is_met
    assert found.wavelengths == 8
    wide, narrow = (rows * (32 + 8) * 8 for rows in (48, 32))  # half the columns; 24 rows take two tiles of 16
    pixels = 48 * 64 * 4
    assert found.traffic_bytes == 6 * wide + 4 * narrow + 2 * pixels // 4 + pixels


@pytest.mark.long
@pytest.mark.gpu
def test_a_timer_counts_the_time_on_the_device_and_no_more(device: Device) -> None:
    if TIMESTAMPS not in device.features:
        pytest.skip("this adapter has no timestamp queries")
    renderer = IncrementalRenderer(_system(), random_drive(_system()), device)
    renderer.update()
    renderer.timer = timer = GpuTimer(device)
    assert timer.take_seconds() == 0.0
    renderer.invalidate()
    renderer.update()
    assert 1e-6 < timer.take_seconds() < 10.0
    assert timer.take_seconds() == 0.0
    timed = device_time(_system(), device, rounds=1, strategy="passes")
    assert timed.frame_ms == pytest.approx(8 * timed.wavelength_ms)
    assert timed.as_dict()["share_of_copy"] > 0


@pytest.mark.long
@pytest.mark.gpu
def test_a_first_image_comes_from_a_process_of_its_own(device: Device) -> None:
    criterion = frame_benchmark.first_image_criterion(_system())
    assert criterion.value > 0 and criterion.limit == 3.0


@pytest.mark.gpu
def test_every_first_image_is_timed_and_warm_ones_find_the_caches_of_the_same_command(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The commands run here, which shows that they work; the viewer's runs in a process in the test before."""
    runs: list[tuple[tuple[str, ...], str]] = []

    def run_here(command: Any, folder: Path, caches: Path) -> tuple[float, float]:
        if command.arguments not in [arguments for arguments, _ in runs] and "view" not in command.arguments:
            with monkeypatch.context() as here:
                here.chdir(folder)
                assert main([*command.arguments]) == 0
        runs.append((command.arguments, caches.name))
        return float(len(runs)), 1.0

    monkeypatch.setattr(frame_benchmark, "_run", run_here)
    timings = frame_benchmark.first_image_timings(_system(), rounds=1)
    assert len(timings) == 5 and all(len(job.seconds) == 1 for job in timings.values())
    warm = [arguments for arguments, caches in runs if caches == "warm"]
    assert len(warm) == 6 and all(warm.count(arguments) == 2 for arguments in warm)
    assert len({caches for _, caches in runs} - {"warm"}) == 2
    criteria = frame_benchmark.first_image_criteria(timings)
    assert [criterion.limit for criterion in criteria] == [3.0, 1.5]
    assert criteria[0].value == timings[frame_benchmark.COLD].seconds[0]


def _starts(monkeypatch: pytest.MonkeyPatch, runs: list[str], then: Callable[[], None] = lambda: None) -> None:
    """Commands that only note that they were started, in place of processes."""

    def run(command: Any, folder: Path, caches: Path) -> tuple[float, float]:
        runs.append(" ".join(command.arguments))
        then()
        return 1.0, 1.0

    monkeypatch.setattr(frame_benchmark, "_run", run)


def test_where_processes_start_slowly_one_round_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[str] = []
    told: list[tuple[int, int, str]] = []
    _starts(monkeypatch, runs)
    monkeypatch.setattr(frame_benchmark, "_STARTS_S", -1.0)
    timings = frame_benchmark.first_image_timings(_system(), rounds=3, progress=lambda *step: told.append(step))
    assert [len(job.seconds) for job in timings.values()] == [1] * 5 and len(runs) == 8
    assert [done for done, _, _ in told] == [*range(8)] and told[0][1] == 18


@pytest.mark.parametrize("fails", [False, True])
def test_an_interruption_keeps_what_was_timed(monkeypatch: pytest.MonkeyPatch, fails: bool) -> None:
    """Whether or not the command that runs then was told as well, and fails."""
    runs: list[str] = []

    def fail() -> None:
        if fails and len(runs) == 6:
            raise RuntimeError("interrupted")

    _starts(monkeypatch, runs, fail)
    timings = frame_benchmark.first_image_timings(_system(), rounds=3, interruption=lambda: len(runs) >= 6)
    assert (
        list(timings) == [frame_benchmark.COLD, frame_benchmark.WARM, frame_benchmark.RENDER_COLD][: 2 if fails else 3]
    )


@pytest.mark.gpu
@pytest.mark.slow
def test_first_images_come_from_processes_of_their_own(device: Device) -> None:
    timings = frame_benchmark.first_image_timings(_system(), rounds=1)
    assert len(timings) == 5
    assert all(len(job.seconds) == 1 and job.seconds[0] > 0 for job in timings.values())


@pytest.mark.long
@pytest.mark.gpu
def test_a_first_image_that_fails_says_why(device: Device) -> None:
    with pytest.raises(RuntimeError, match="no adapter is called 'nonesuch'"):
        frame_benchmark.first_image_criterion(_system(), "nonesuch")


@pytest.mark.long
@pytest.mark.gpu
def test_the_command_prints_a_table_and_json(
    device: Device, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    times = JobTimings((2.5,), (1.0,))
    names = (frame_benchmark.COLD, frame_benchmark.WARM, frame_benchmark.RENDER_TORCH)
    monkeypatch.setattr(bench, "first_image_timings", lambda *_, **options: dict.fromkeys(names, times))
    arguments = ["bench", "--size", "64x48", "--rounds", "1", "--strategy", "workgroup"]
    assert main(arguments) == 0
    table = capsys.readouterr().out
    assert "holochrome-8: 64 x 48 samples, 8 wavelengths" in table
    assert "amplitude edit / full frame" in table and "2.5" in table
    assert main([*arguments, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["first_image"][frame_benchmark.RENDER_TORCH]["cpu_ms"] == 1000.0
    assert len(result["bars"]) == 10 and result["size"] == [64, 48]
    assert result["adapter"]["name"] == device.info.name


@pytest.mark.long
@pytest.mark.gpu
def test_tuning_shows_what_the_choice_rests_on(
    device: Device, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert main(["bench", "--tune", "--size", "64x48", "--json"]) == 0
    grids = json.loads(capsys.readouterr().out)["grids"]
    assert [grid["size"] for grid in grids] == [[64, 48], [128, 96]]
    for grid in grids:
        assert set(grid["seconds"]) | set(grid["refused"]) == set(
            supported_strategies(device, tuple(grid["size"][::-1]))
        )
        assert grid["chosen"] == min(grid["seconds"], key=lambda name: grid["seconds"][name])


def test_a_choice_is_told_with_its_reasons() -> None:
    tuning = TuningResult({"passes": 0.02, "subgroup": 0.01}, {"passes": 0.5}, {"workgroup": "wrong by 1e-3"})
    lines = TuningReport((48, 64), "subgroup", tuning).format_lines()
    assert lines[0] == "64 x 48: subgroup"
    assert "20.00 ms an FFT and its inverse" in lines[1] and "0.50 s to compile" in lines[1]
    assert lines[3].endswith("refused: wrong by 1e-3")


@pytest.mark.parametrize(
    ("arguments", "refusal"),
    [
        (["--size", "big"], "--size"),
        (["--size", "65x48"], "multiples of the bench's upsampling"),
        (["--size", "44x48"], "products of 2, 3 and 5"),
        (["--rounds", "0"], "--rounds"),
        (["no-such-preset"], "no-such-preset"),
    ],
)
def test_wrong_arguments_are_refused(arguments: list[str], refusal: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *arguments]) == 2
    assert refusal in capsys.readouterr().err
