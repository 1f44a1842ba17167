"""The conformance set: its answers agree with each other, holoview passes, and its files can be scored alone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from holoview.commands.conformance import propagated
from holoview.evidence.conformance.cases import (
    Case,
    all_cases,
    sum_of_plane_waves,
    sum_of_point_sources,
    write_cases,
)
from holoview.evidence.conformance.score import error_of, main
from holoview.util.progress import no_progress
from tests.patience import PATIENCE_S

CASES = all_cases()
QUICK = [case for case in CASES if case.name.endswith(("-01", "-05")) and case.family != "slit"]


def test_there_are_about_a_hundred_cases_with_names_of_their_own() -> None:
    assert 95 <= len(CASES) <= 110
    assert len({case.name for case in CASES}) == len(CASES)
    assert {case.wavelength_m for case in CASES} == {473e-9, 532e-9, 638e-9}
    assert max(abs(case.distance_m) for case in CASES) == 2.0


@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.name)
def test_holoview_passes(case: Case) -> None:
    assert error_of(propagated(case), case.answer, case.indices) <= case.tolerance


@pytest.mark.explores
def test_holoview_passes_all() -> None:
    failed = [c.name for c in CASES if error_of(propagated(c), c.answer, c.indices) > c.tolerance]
    assert failed == []


# Both integrals are sums in float64 over what vanishes at its ends, and differ by the light that spreads past 8 sides.
@pytest.mark.parametrize("name", ["gaussian-beam-04", "grating-10", "stop-04"])
def test_the_two_integrals_agree(name: str) -> None:
    (case,) = (case for case in CASES if case.name == name)
    at = ((np.arange(128) - 63.5) * case.pitch_m)[case.indices]
    waves, points = (f(case, at[:, None], at[None, :]) for f in (sum_of_plane_waves, sum_of_point_sources))
    assert np.linalg.norm(waves - points) < 1e-5 * np.linalg.norm(points)


def test_a_wrong_result_fails() -> None:
    case = next(case for case in CASES if case.name == "speckle-03")
    good = propagated(case)
    assert error_of(good * np.exp(1j), case.answer, case.indices) <= case.tolerance
    for wrong in (np.conj(good), good * 1.001, np.roll(good, 1, axis=0), case.field, good * np.nan):
        assert not error_of(wrong, case.answer, case.indices) <= case.tolerance


def test_the_files_are_scored_by_the_program_beside_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cases, folder, results = QUICK[:3], tmp_path / "cases", tmp_path / "results"
    folder.mkdir()
    results.mkdir()
    write_cases(folder, cases, no_progress)
    for case in cases[:2]:
        np.save(results / f"{case.name}.npy", propagated(case))
    program = [sys.executable, "-I", str(folder / "score.py"), str(folder), str(results)]
    done = subprocess.run(program, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 1
    assert done.stdout.splitlines()[-2:] == [f"{cases[2].name}: no result", "2 of 3 passed"]
    np.save(results / f"{cases[2].name}.npy", propagated(cases[2]))
    assert main(folder, results) == 0
    assert "3 of 3" in capsys.readouterr().out
