"""`holoview bench --optimiser`: both methods reach one goal from one start, and the rival computes the same loss."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
import torch

from holoview.commands.cli import main
from holoview.evidence.benchmark import time_to_quality as module
from holoview.evidence.benchmark.autograd_loop import StoredLoop, Work
from holoview.evidence.benchmark.frame_jobs import JobTimings
from holoview.evidence.benchmark.time_to_quality import (
    MARGIN_DB,
    QualityRun,
    planned,
    quality_text,
    quality_work,
    time_to_quality,
)
from holoview.light.model import preset
from holoview.util.errors import UserError
from holoview.util.files import data_dir
from holoview.util.processes import Interruption

PICTURE = data_dir("assets") / "still-life.png"


def _work(name: str = "holochrome-8", **changes: Any) -> Work:
    tiny = {"shape": [16, 24], "planes": ["9 mm", "10 mm"]}
    tiny |= {"wavelengths": ["460 nm", "530 nm", "630 nm"], "amplitudes": [[1.0, 1.0, 1.0]]}
    return quality_work(preset.load(name).edit(tiny | changes), str(PICTURE))


@pytest.mark.parametrize("name", ["holochrome-8", "holochrome-8-1slm-open"])
def test_iterations_end_at_the_goal(name: str) -> None:
    work = _work(name)
    found = time_to_quality(work, QualityRun(long=20, rounds=1, steps_rad=(0.1, 0.3)))
    assert found is not None
    assert found["goal_db"] + MARGIN_DB >= max(found["long_db"], found["adam_long_db"])
    if found["iterations"] is not None:
        assert found["iterations"] <= 20
        assert list(planned(work, found["iterations"]))[-1][1] >= found["goal_db"]
        assert found["ratio"] > 0 and found["cpu_ratio"] > 0
    made = found["adam_iterations"]
    assert made is None or dict(found["adam_curve"])[made] >= found["goal_db"]
    assert found["adam_curve"][-1][0] == 20 and found["adam_step_rad"] in (0.1, 0.3)


@pytest.mark.parametrize("name", ["holochrome-8", "holochrome-8-1slm-open"])
def test_a_batch_gives_what_the_loop_gives(name: str) -> None:
    loop = StoredLoop(_work(name))
    expected = loop.intensities(loop.drive).detach()
    loop.is_batched = True
    found = loop.intensities(loop.drive).detach()
    assert found.shape == expected.shape
    error = torch.linalg.vector_norm(found - expected) / torch.linalg.vector_norm(expected)
    assert float(error) < 1e-5  # complex64: some units of 6e-8 for each of five transforms


def test_amplitudes_that_are_solved_for_lower_the_loss_of_the_rival() -> None:
    loop = StoredLoop(_work())
    intensities = loop.intensities(loop.drive).detach()
    before = float((loop.image(intensities) - loop.target).square().mean())
    loop.solve_amplitudes(intensities)
    after = float((loop.image(intensities) - loop.target).square().mean())
    assert after < before and loop.amplitudes.min() >= 0
    for laser in range(len(loop.amplitudes)):  # nor does any single amplitude lower it: within rounding, a minimum
        loop.amplitudes[laser] *= 1.05
        assert float((loop.image(intensities) - loop.target).square().mean()) >= after * (1 - 1e-5)
        loop.amplitudes[laser] /= 1.05


@pytest.mark.parametrize(
    "changes",
    [{"effects.crosstalk.coupling": 0.3}, {"frames": 2}],
    ids=str,
)
def test_what_the_rival_does_not_compute_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="expected"):
        time_to_quality(_work(**changes), QualityRun(long=5))


@pytest.mark.parametrize(("seconds", "expected"), [({"11": 0.05, "12": 0.001}, 12), ({"11": 0.001, "12": 0.05}, 11)])
def test_a_longer_run_counts_if_it_takes_less_time(
    seconds: dict[str, float], expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Times are given, since a busy machine delays any run."""

    def planned(work: Work, iterations: int) -> Iterator[tuple[int, float]]:
        yield iterations, float(iterations)

    def timed(jobs: Mapping[str, object], rounds: int) -> dict[str, JobTimings]:
        return {plan: JobTimings((seconds[plan],) * rounds) for plan in jobs}

    monkeypatch.setattr(module, "planned", planned)
    monkeypatch.setattr(module, "time_interleaved", timed)
    monkeypatch.setattr(module, "LONG_RUN", 12)
    scope = QualityRun(long=20, rounds=2)
    assert module._fastest_plan(_work(), 9.5, scope) == expected
    assert module._fastest_plan(_work(), 15.5, scope) == 16
    monkeypatch.setattr(module, "LONG_RUN", 21)
    assert module._fastest_plan(_work(), 9.5, scope) == 11


def test_an_interruption_ends_it_without_a_result() -> None:
    interruption = Interruption()
    interruption.ask()
    assert time_to_quality(_work(), QualityRun(long=5, interruption=interruption)) is None


@pytest.mark.long
def test_the_command_states_the_goal_the_times_and_the_machine(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "--optimiser", "--size", "48x32", "--long", "10", "--rounds", "1"]
    assert main([*arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["size"] == [48, 32] and found["processor"] and found["threads"] >= 1
    text = quality_text(found)
    assert f"{found['goal_db']:.2f} dB" in text and found["processor"] in text


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, "holoview ÷ Adam: 0.25 (processor time 0.20)"),
        ({"adam_iterations": None}, "at most 0.25"),
        ({"iterations": None, "ratio": None, "cpu_ratio": None}, "doesn't reach 17.30 dB in 500 iterations"),
    ],
)
def test_a_verdict_says_what_was_not_reached(changes: dict[str, Any], verdict: str) -> None:
    found = {"preset": "open", "size": [64, 48], "wavelengths": 8, "planes": 5, "processor": "P", "threads": 2}
    found |= {"long": 500, "long_db": 17.5, "adam_long_db": 17.4, "goal_db": 17.3, "adam_step_rad": 0.1}
    found |= {"iterations": 120, "adam_iterations": 230, "seconds": 1.0, "adam_seconds": 4.0}
    found |= {"cpu_seconds": 1.0, "adam_cpu_seconds": 5.0, "ratio": 0.25, "cpu_ratio": 0.2}
    text = quality_text(found | changes)
    assert verdict in text and not math.isnan(found["long_db"])


@pytest.mark.parametrize(
    ("arguments", "refusal"),
    [
        (["--optimiser", "--tune"], "--tune: with --optimiser"),
        (["--optimiser", "--report", "DIR"], "--report: with --optimiser"),
        (["--optimiser", "--long", "0"], "--long"),
        (["--optimiser", "--picture", "no-such.png", "--size", "48x32"], "no-such.png"),
        (["--picture", "photo.png"], "--picture: without --optimiser"),
        (["--long", "5"], "--long: without --optimiser"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(
    arguments: list[str], refusal: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", *arguments]) == 2
    assert refusal in capsys.readouterr().err
