"""`holoview bench` of chains of elements: torch and the shaders compute the same image, and every pattern is edited."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from holoview.commands import bench
from holoview.commands.cli import main
from holoview.evidence.benchmark import report_run
from holoview.evidence.benchmark.autograd_loop import ChainLoop
from holoview.evidence.benchmark.frame_benchmark import benchmark_frame, intensity_error, stage_loop
from holoview.evidence.benchmark.frame_jobs import JobTimings, full_frame, pattern_edit
from holoview.evidence.benchmark.report_run import OPTIMISER, PARITY, POWER, QUALITY, TORCH, VIEWER
from holoview.evidence.benchmark.report_text import results
from holoview.evidence.benchmark.time_to_quality import (
    MARGIN_DB,
    QualityRun,
    quality_text,
    quality_work,
    time_to_quality,
)
from holoview.holograms.view import random_drive
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.gpu.device import Device
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError
from holoview.util.files import data_dir
from tests.benchmark.short_report import shorten_report

PICTURE = data_dir("assets") / "still-life.png"
PHASE = {"kind": "phase", "pitch": "8 um", "shape": [12, 16], "stroke": "700 nm"}
SPACE = {"kind": "space", "distance": "1 mm", "square": "first order"}
AMPLITUDE = {"kind": "amplitude", "pitch": "16 um", "shape": [6, 8]}
CHAINS = {
    "coarse amplitude": (PHASE, SPACE, AMPLITUDE),
    "mask": (PHASE, SPACE, {**PHASE, "kind": "mask", "pattern": "random"}),
    "Fourier plane": (
        PHASE,
        {"kind": "fourier", "focal_length": "1.15 mm"},
        {"kind": "amplitude", "pitch": "8 um", "shape": [12, 16], "levels": 2},
    ),
    "arms": ({**PHASE, "name": "one"}, {**PHASE, "name": "two", "beside": "one", "shared": True}),
    "complex behind a lens": ({"kind": "lens", "focal_length": "20 mm"}, {**AMPLITUDE, "kind": "complex"}),
}


def _chain(name: str) -> System:
    lasers, planes_m = [[1.0, 0.5], [0.0, 1.0]], [2e-3, 3e-3]
    return System([532e-9, 580e-9], lasers, elements=CHAINS[name], planes_m=planes_m, observer="eye", name="small")


@pytest.mark.parametrize("name", CHAINS)
def test_the_torch_loop_computes_what_the_reference_executor_computes(name: str) -> None:
    system = _chain(name)
    plan, drive = make_plan(system, [2e-3]), random_drive(system)
    expected = compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, drive), double=True))[1][0]
    loop = stage_loop(plan, drive)
    for _ in range(2):  # the second time with what the first has kept
        assert np.linalg.norm(loop() - expected) <= 2e-6 * np.linalg.norm(expected)  # as of the short form


@pytest.mark.long
@pytest.mark.gpu
@pytest.mark.parametrize("name", CHAINS)
def test_a_frame_and_its_edits_are_timed(device: Device, name: str) -> None:
    system = _chain(name)
    found = benchmark_frame(system, device, rounds=1)
    patterns = {f"pattern of {element}" for element in system.drive_shapes}
    assert {job for job in found.timings if job.startswith("pattern")} == patterns
    assert all(sample.median_ms > 0 for sample in found.timings.values())
    assert all(math.isfinite(criterion.value) and criterion.value > 0 for criterion in found.criteria)
    assert next(criterion for criterion in found.criteria if "error" in criterion.name).is_met


@pytest.mark.gpu
def test_each_job_does_its_work(device: Device) -> None:
    """An edit shows the other pattern, and computes only what is behind it; a whole frame computes everything."""
    system = _chain("coarse amplitude")
    drive = random_drive(system)
    renderer = IncrementalRenderer(system, drive, device, plane_m=3e-3)
    frame, edit = full_frame(renderer), pattern_edit(renderer, "amplitude")
    frame()
    before = renderer.xyz()
    edit()
    assert np.array_equal(renderer.drive["amplitude"], drive["amplitude"][:, ::-1])
    assert intensity_error(renderer) <= 1e-6 and np.abs(renderer.xyz() - before).max() > 1e-3 * before.max()
    edit()
    assert np.array_equal(renderer.drive["amplitude"], drive["amplitude"])
    np.testing.assert_allclose(renderer.xyz(), before, rtol=0, atol=1e-6 * before.max())
    counts = renderer.dispatch_counts.copy()
    edit()
    assert (renderer.dispatch_counts - counts).keys() == {"propagate", "modulate", "observe", "composite"}
    counts = renderer.dispatch_counts.copy()
    frame()
    assert renderer.dispatch_counts["light"] > counts["light"]


@pytest.fixture
def chain_file(tmp_path: Path) -> Path:
    """A chain's file in an empty folder."""
    path = tmp_path / "small.toml"
    path.write_text(preset.dumps(_chain("mask")), encoding="utf-8")
    return path


@pytest.mark.long
@pytest.mark.gpu
def test_the_command_prints_a_table_and_json(
    device: Device, chain_file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "first_image_timings", lambda *_, **options: {"start": JobTimings((2.5,), (1.0,))})
    assert main(["bench", str(chain_file), "--rounds", "1"]) == 0
    table = capsys.readouterr().out
    assert "32 x 24 samples, 2 wavelengths" in table and "pattern of phase" in table and "start" in table
    assert "memory traffic" in table and "time on the device" in table
    assert main(["bench", str(chain_file), "--rounds", "1", "--strategy", "workgroup", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert len(result["bars"]) == 2 and result["device_memory_bytes"] > 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--size", "64x48"], "--set elements.NAME.shape"),
        (["--optimiser", "--size", "64x48"], "--set elements.NAME.shape"),
        (["--report", "folder", "--size", "64x48"], "--set elements.NAME.shape"),
        (["--report", "folder", "--lasers", "1,3"], "--set wavelengths"),
    ],
)
def test_options_that_chains_lack_are_refused(
    chain_file: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(chain_file.parent)
    assert main(["bench", chain_file.name, *arguments]) == 2
    told = capsys.readouterr().err
    assert words in told and told.count("\n") == 1 and not Path("folder").exists()


@pytest.mark.parametrize("name", CHAINS)
def test_the_rival_of_a_chain_moves_each_pattern_in_its_range(name: str) -> None:
    system = _chain(name)
    loop = ChainLoop(quality_work(system, PICTURE), 0.05)
    for _ in range(6):
        light = loop.light()
        loop.solve_amplitudes(light)
        loop.move(loop.loss_of(light))
    drive = {name: own.detach() for name, own in loop.patterns().items()}
    assert {name: tuple(own.shape) for name, own in drive.items()} == system.drive_shapes
    assert all(float(own.abs().min()) >= 0 and float(own.abs().max()) <= 1 + 1e-6 for own in drive.values())
    before = quality_work(system, PICTURE).drive
    assert all(not np.array_equal(drive[name].numpy(), before[name]) for name in drive)


@pytest.mark.long
def test_time_to_quality_of_a_chain_reaches_its_goal() -> None:
    work = quality_work(_chain("coarse amplitude"), PICTURE)
    found = time_to_quality(work, QualityRun(long=20, rounds=1, steps_rad=(0.1, 0.4)))
    assert found is not None and found["is_chain"]
    assert found["goal_db"] + MARGIN_DB >= max(found["long_db"], found["adam_long_db"])
    assert found["adam_curve"][-1][1] > found["adam_curve"][0][1]  # the rival improves its picture, too
    text = quality_text(found)
    assert "32 x 24 samples" in text and "not padded" not in text


@pytest.mark.long
@pytest.mark.gpu
def test_a_report_of_a_chain_holds_what_chains_have(
    device: Device, chain_file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(chain_file.parent)
    monkeypatch.setattr(report_run, "CHANGES", {})
    shorten_report(monkeypatch)
    assert main(["bench", chain_file.name, "--rounds", "1", "--report", "folder"]) == 0
    text = Path(capsys.readouterr().out.strip()).read_text(encoding="utf-8")
    data = json.loads(text.rpartition("```json\n")[2].partition("\n```")[0])
    assert data["is_complete"] and "Nothing is missing." in text
    (stages,) = results(data, PARITY)
    assert stages and all(entry["error"] <= entry["allowed"] for entry in stages.values())
    assert "pattern of phase" in results(data, TORCH)[0]["jobs"]
    assert results(data, OPTIMISER)[0]["median_ms"]["cpu"] > 0
    assert results(data, QUALITY)[0]["adam_seconds"] > 0
    assert results(data, VIEWER)[0]["scrub_images_per_s"] > 0
    assert len(results(data, POWER)) == 1


def test_long_runs_of_a_large_chain_are_left_out_of_a_report() -> None:
    with pytest.raises(UserError, match="samples in all lasers and planes"):
        report_run._require_few_samples(preset.load("high-contrast"))
