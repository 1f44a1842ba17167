"""`holoview diagnose --rig`: what it says and keeps, how it ends, and what it refuses in one line."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from holoview.bench.captures import read_captures
from tests.experiment.next_capture.benches import write_rig

Run = Callable[..., Any]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "neither is given"),
        (("c.h5", "--rig", "rig.toml"), "both are given"),
        (("c.h5", "--certainty", "0.9"), "--certainty: is of captures that are taken"),
        (("c.h5", "--captures", "9"), "--captures: is of captures that are taken"),
        (("--rig", "rig.toml", "--certainty", "1"), "--certainty: 1.0; expected 0.5 or more, below 1"),
        (("--rig", "rig.toml", "--captures", "0"), "--captures: '0'; expected a whole number of at least 1"),
        (("--rig", "rig.toml", "--preset", "holochrome-8"), "state the geometry in rig.toml"),
    ],
)
def test_options_that_contradict_each_other(
    holoview: Run, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    write_rig(tmp_path, {})
    outcome = holoview("diagnose", *arguments)
    assert outcome.code == 2 and message in outcome.err and "Traceback" not in outcome.err
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]


@pytest.mark.long
def test_a_budget_ends_it_with_a_diagnosis_and_the_captures(holoview: Run, tmp_path: Path) -> None:
    write_rig(tmp_path, {})
    arguments = ("--rig", "rig.toml", "-o", "c.h5", "--json", "d.json", "--workers", 1)
    outcome = holoview("diagnose", *arguments, "--captures", 2, "--certainty", 0.9999999)
    assert outcome.code == 0, outcome.err
    assert "capture 1: 450 nm at 9 mm, " in outcome.err and "2 captures are taken, as many as allowed" in outcome.out
    assert "rig.toml: consistent" in outcome.out and "written: c.h5" in outcome.out
    told = json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))
    assert told["captures"] == 2 and told["loop"]["certain"] is False
    assert [one["number"] for one in told["loop"]["captures"]] == [1, 2]
    assert all(one["reason"] and one["seconds"] > 0 for one in told["loop"]["captures"])
    assert len(read_captures(tmp_path / "c.h5")) == 2
    assert not (tmp_path / "c.h5.captures").exists()


@pytest.mark.long
def test_what_is_known_counts_for_captures_that_are_taken(holoview: Run, tmp_path: Path) -> None:
    write_rig(tmp_path, {"gap": {"gap_error": 2e-4}})
    arguments = ("--rig", "rig.toml", "--captures", 2, "--json", "d.json", "--workers", 1)
    outcome = holoview("diagnose", *arguments, "--known", "gap.gap_error=2e-4")
    assert outcome.code == 0 and "rig.toml: consistent" in outcome.out, outcome.err
    assert json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))["known"]["gap"]["gap_error"] == 2e-4


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_ctrl_c_keeps_the_captures_and_says_what_is_known(interrupted: Run, tmp_path: Path) -> None:
    write_rig(tmp_path, {})
    done = interrupted("capture 2: ", "diagnose", "--rig", "rig.toml", "-o", "c.h5", "--workers", "1")
    assert done.code == 130 and "Traceback" not in done.err
    assert "it was interrupted" in done.out and "only the causes that were left were searched" in done.out
    assert len(read_captures(tmp_path / "c.h5")) >= 2


def test_captures_of_another_rig_are_refused(holoview: Run, tmp_path: Path) -> None:
    write_rig(tmp_path, {})
    folder = tmp_path / "c.h5.captures"
    folder.mkdir()
    (folder / "loop.json").write_text('{"fingerprint": "of another"}', encoding="utf-8")
    outcome = holoview("diagnose", "--rig", "rig.toml", "-o", "c.h5")
    assert outcome.code == 2 and "holds captures of another rig" in outcome.err
