"""`holoview conformance` prints errors of kinds of cases, or writes the cases."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from holoview.commands.cli import main


def test_a_kind_of_case_is_computed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["conformance", "--family", "no distance", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["passed"] == len(found["cases"]) == 2
    assert all(case["error"] <= case["tolerance"] for case in found["cases"])
    assert main(["conformance", "--family", "no distance"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "2 of 2 passed"


def test_cases_are_written_as_plain_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["conformance", "--family", "no distance", "-o", str(tmp_path / "cases")]) == 0
    names = sorted(path.name for path in (tmp_path / "cases").iterdir())
    assert {"cases.toml", "score.py", "no-distance-01.field.npy", "no-distance-02.answer.npy"} <= set(names)
    assert "2 cases" in capsys.readouterr().out


def test_an_unknown_kind_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["conformance", "--family", "lenz"]) == 2
    assert "lens" in capsys.readouterr().err
