"""`holoview measure`: a session is taken, forecast, interrupted, finished early; each mistake is one line."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from holoview.bench.captures import read_captures
from tests.rig.conftest import write_rig

Run = Callable[..., Any]


@pytest.fixture(autouse=True)
def rig(tmp_path: Path) -> Path:
    """A rig and a plan of six captures."""
    (tmp_path / "plan.toml").write_text('each = 3\ndistances = ["3 mm"]\n', encoding="utf-8")
    return write_rig(tmp_path / "rig.toml", {"virtual": {"bench": "hidden.toml"}})


@pytest.fixture(autouse=True)
def hidden(tmp_path: Path) -> Path:
    """What the bench really is."""
    path = tmp_path / "hidden.toml"
    path.write_text("seed = 3\n", encoding="utf-8")
    return path


MEASURE = ("measure", "rig.toml", "--plan", "plan.toml", "-o", "X.h5")


@pytest.mark.long
@pytest.mark.usefixtures("bench_here")
def test_a_session_is_taken_checked_and_not_taken_twice(holoview: Run, tmp_path: Path) -> None:
    outcome = holoview(*MEASURE)
    assert (outcome.code, outcome.out) == (0, "X.h5: 6 captures of 2 wavelengths\n")
    assert outcome.err.endswith("measuring: 6/6\n")
    assert not (tmp_path / "X.h5.captures").exists()
    check = holoview("captures", "check", "X.h5")
    assert check.code == 0 and "X.h5: 6 captures, near field" in check.out
    again = holoview(*MEASURE)
    assert again.code == 2 and "X.h5: is there already; choose another output" in again.err


def test_a_dry_run_opens_and_writes_nothing(holoview: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("opened")

    monkeypatch.setattr("holoview.commands.measure.open_rig", refuse)
    before = sorted(tmp_path.iterdir())
    outcome = holoview(*MEASURE, "--dry-run")
    assert outcome.code == 0 and "stage to 3 mm" in outcome.out and "6 captures, of which 0 are there" in outcome.out
    assert "450 nm: 3 captures" in outcome.out and sorted(tmp_path.iterdir()) == before


@pytest.mark.usefixtures("bench_here")
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.explores)]
)
def test_an_interrupted_session_can_be_finished_or_gone_on_with(
    holoview: Run, interrupted: Run, tmp_path: Path, number: int, code: int
) -> None:
    outcome = interrupted("measuring: 2/6", *MEASURE, number=number)
    assert outcome.code == code and "; the same command goes on\n" in outcome.err
    there = len(list((tmp_path / "X.h5.captures").glob("0*.h5")))
    assert 2 <= there < 6 and f"{there} of 6 captures are in X.h5.captures" in outcome.err
    dry = holoview(*MEASURE, "--dry-run")
    assert f"6 captures, of which {there} are there" in dry.out
    if number == signal.SIGINT:
        finished = holoview(*MEASURE, "--finish")
        assert (finished.code, finished.out) == (0, f"X.h5: {there} of 6 captures of 1 wavelengths\n")
    else:
        assert holoview(*MEASURE).code == 0
    assert len(read_captures(tmp_path / "X.h5")) == (there if number == signal.SIGINT else 6)


def test_nothing_to_finish_is_a_mistake(holoview: Run, tmp_path: Path) -> None:
    outcome = holoview(*MEASURE, "--finish")
    assert outcome.code == 2 and "X.h5.captures: holds no capture yet" in outcome.err
    assert not (tmp_path / "X.h5.captures").exists()


@pytest.mark.long
def test_a_device_that_fails_ends_with_one_line_and_the_way_on(holoview: Run, hidden: Path, tmp_path: Path) -> None:
    hidden.write_text("laser_log = 'lasers.txt'\n[faults]\ntimeout = 1.0\n", encoding="utf-8")
    outcome = holoview(*MEASURE)
    last = outcome.err.splitlines()
    assert outcome.code == 2 and last[-2] == "0 of 6 captures are in X.h5.captures; the same command goes on"
    assert last[-1].startswith("holoview: camera: no picture within 1 s, 4 times in a row; check its cable")
    assert (tmp_path / "lasers.txt").read_text(encoding="utf-8").splitlines()[-1] == "off"


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ("power = [2.0]", "power: 2; expected 0 … 1; change the plan, or [limits] in rig.toml"),
        ('distances = ["20 mm"]', "stage: 20 mm; expected 0 mm … 10 mm"),
        ("exposure = 3.0", "exposure: 3 s"),
        ("each = -1", "plan.toml: each: -1"),
    ],
)
def test_no_plan_exceeds_a_limit(holoview: Run, tmp_path: Path, plan: str, words: str) -> None:
    (tmp_path / "plan.toml").write_text(plan, encoding="utf-8")
    outcome = holoview(*MEASURE)
    assert outcome.code == 2 and words in outcome.err and len(outcome.err.splitlines()) == 1
    assert not (tmp_path / "X.h5.captures").exists()
