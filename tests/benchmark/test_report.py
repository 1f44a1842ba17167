"""`holoview bench --report`: one file with what was measured, also where something fails or Ctrl-C ends it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from holoview.commands import bench_report
from holoview.commands.cli import main
from holoview.evidence.benchmark import report_run
from holoview.evidence.benchmark.frame_jobs import TuningReport
from holoview.evidence.benchmark.report_run import (
    FRAMES,
    OPTIMISER,
    PARITY,
    POWER,
    QUALITY,
    VIEWER,
    ReportMeasurement,
    ReportRun,
)
from holoview.evidence.benchmark.report_text import Values, report_markdown, results
from holoview.light.gpu.device import TIMESTAMPS, Device
from holoview.light.gpu.tune import TuningResult
from holoview.util.processes import Interruption
from tests.benchmark.short_report import shorten_report
from tests.patience import PATIENCE_S

gpu = pytest.mark.gpu
TORCH = ("numpy", "torch", "torchgen", "functorch", "typing_extensions", "sympy", "mpmath", "networkx", "filelock")
WHEELS = ("wgpu", "cffi", "_cffi_backend", "pycparser", "rich", "markdown_it", "mdurl", "pygments", "tomli_w", "psutil")
WHEELS += ("safetensors",)
"""What torch brings along, and the modules of the wheels that docs/fast-frame.md names."""
ARGUMENTS = ("--size", "64x48", "--lasers", "1,2", "--rounds", "1")


def _numbers(markdown: str) -> Values:
    """The numbers of a report that `report_markdown` wrote."""
    data: Values = json.loads(markdown.rpartition("```json\n")[2].partition("\n```")[0])
    return data


def _tuned(device: Device, shape: tuple[int, int]) -> TuningReport:
    """What a search says that has tried one strategy."""
    return TuningReport(shape, "workgroup", TuningResult({"workgroup": 0.01}, {"workgroup": 0.5}, {}))


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    """One small bench and one strategy, without a search: every kind of measurement, but few of each."""
    monkeypatch.setattr(report_run, "tune", _tuned)
    for name in ("benchmark_frame", "open_renderer"):
        monkeypatch.setattr(report_run, name, partial(getattr(report_run, name), strategy="workgroup"))
    monkeypatch.setattr(report_run, "CHANGES", {"two modulators": {}})
    monkeypatch.setattr(report_run, "STRATEGIES", ("workgroup",))
    shorten_report(monkeypatch)


@pytest.fixture
def report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Runs the command and returns its exit code and the report that it names."""

    def run(*arguments: str) -> tuple[int, str]:
        code = main(["bench", "--report", str(tmp_path / "reports"), *ARGUMENTS, *arguments])
        (written,) = (tmp_path / "reports").iterdir()
        assert capsys.readouterr().out.strip() == str(written)
        return code, written.read_text(encoding="utf-8")

    return run


@pytest.mark.long
@gpu
def test_a_report_holds_every_kind_of_measurement(device: Device, report: Callable[..., tuple[int, str]]) -> None:
    code, text = report()
    data = _numbers(text)
    assert code == 0 and data["is_complete"] and "Nothing is missing." in text
    assert data["machine"]["adapter"]["name"] == device.info.name
    assert all(entry["error"] <= entry["allowed"] for entry in results(data, PARITY)[0].values())
    cases = [(case["wavelengths"], case["per_dispatch"]) for case in results(data, FRAMES)]
    assert cases == [(1, 1), (2, 1), (2, 2)]
    for case in results(data, FRAMES):
        assert case["median_ms"].keys() == {"frame", "frame in a row", "focal plane", "gap", "amplitudes"}
        assert min(case["median_ms"].values()) > 0
        assert ("device_ms" in case) == (TIMESTAMPS in device.features)
    assert results(data, OPTIMISER)[0]["median_ms"]["cpu"] > 0
    assert results(data, QUALITY)[0]["adam_seconds"] > 0
    assert results(data, VIEWER)[0]["scrub_images_per_s"] > 0
    assert len(results(data, POWER)) == 1
    for heading in (
        "Goals",
        "Machine",
        "Stages",
        "Copies",
        "Frames",
        "Strategies",
        "Beside torch",
        "Time to",
        "Viewer",
        "Power",
    ):
        assert f"\n## {heading}" in text


@gpu
def test_ctrl_c_keeps_what_was_measured(
    device: Device, report: Callable[..., tuple[int, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def pressed(step: str) -> Iterator[Interruption]:
        interruption = Interruption()
        interruption.ask()
        yield interruption

    monkeypatch.setattr(bench_report, "deferred_interrupt", pressed)
    code, text = report()
    data = _numbers(text)
    assert code == 130 and not data["is_complete"] and text.count("interrupted") == 2
    assert "Nothing is missing" not in text and "Unknown: nvidia-smi" not in text
    assert sum(map(len, data["results"].values())) == 1


@pytest.mark.long
@gpu
def test_what_fails_is_in_the_report_and_the_rest_is_measured(
    device: Device, report: Callable[..., tuple[int, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: Any) -> dict[str, Any]:
        raise RuntimeError("the driver has no idea")

    monkeypatch.setattr(report_run, "time_case", fail)
    code, text = report()
    data = _numbers(text)
    assert code == 1 and data["is_complete"]
    assert "RuntimeError: the driver has no idea" in text.partition("<details>")[0]
    assert "2 λ, several in a dispatch: strategies: none could be measured" in text
    assert not results(data, FRAMES) and results(data, PARITY) and results(data, VIEWER)


@gpu
def test_a_strategy_that_the_search_refused_is_not_run(device: Device) -> None:
    run = ReportRun(device, report_run.ReportOptions(report_run.parity_bench(), ((64, 48),), (1,), rounds=1))
    refused = {"size": [64, 48], "refused": {"workgroup": "gives wrong results"}}
    run.make(ReportMeasurement(report_run.TUNING, "64 × 48", lambda: refused))
    for measurement in run.measurements():
        if measurement.section == FRAMES:
            run.make(measurement)
    assert [entry["refused"] for entry in run.data["results"][FRAMES]] == ["workgroup: gives wrong results"]


@pytest.mark.long
@gpu
def test_torch_numpy_and_a_few_wheels_are_enough(device: Device) -> None:
    """The program below finds no other library, like a machine without a network that wheels were brought to."""
    program = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in there:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
there = {*sys.stdlib_module_names, "holoview", *sys.argv[1:]}
sys.meta_path.insert(0, Refuse())
import json
from pathlib import Path
from holoview.evidence.benchmark import report_run
from holoview.evidence.benchmark.machine import probe_device
from holoview.commands.bench_report import measurements_of
from holoview.light.gpu.device import open_device
from holoview.light.model import preset
report_run.STRATEGIES = ("workgroup",)
system = preset.load("holochrome-8").edit({"shape": [24, 32]})
run = report_run.ReportRun(open_device(), report_run.ReportOptions(system, ((64, 48),), (1,), rounds=1))
report_run.CHANGES = {"two modulators": {}}
for measurement in measurements_of(run):
    if measurement.section in ("stages", "frames", "optimiser", "viewer"):
        run.make(measurement)
print(json.dumps(run.data["results"]))
"""
    done = subprocess.run(
        [sys.executable, "-c", program, *TORCH, *WHEELS], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert "result" in found[PARITY][0] and "result" in found[FRAMES][0]
    assert found[OPTIMISER][0]["refused"].startswith("not installed: ")
    assert found[VIEWER][0]["refused"].startswith("not installed: ")


@pytest.mark.parametrize(
    ("arguments", "refusal"),
    [
        (["--report", "DIR", "--json"], "--json: with --report"),
        (["--report", "DIR", "--strategy", "passes"], "--strategy: with --report"),
        (["--report", "DIR", "--size", "64x48,big"], '--size: "big"'),
        (["--report", "DIR", "--lasers", "1,0"], "--lasers: 0; expected a whole number from 1"),
        (["--lasers", "3"], "--lasers: without --report"),
        (["--size", "64x48,128x96"], "--size"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(
    arguments: list[str], refusal: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", *(str(tmp_path / "r") if word == "DIR" else word for word in arguments)]) == 2
    assert refusal in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


@gpu
def test_a_folder_that_cannot_be_made_is_refused(
    device: Device, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["bench", "--report", str(tmp_path / "file"), *ARGUMENTS]) == 2
    assert "it is a file" in capsys.readouterr().err


@gpu
def test_the_numbers_come_back_from_the_text(device: Device) -> None:
    run = ReportRun(device, report_run.ReportOptions(report_run.parity_bench(), ((64, 48),), (1,), rounds=1))
    assert _numbers(report_markdown(run.data)) == run.data
