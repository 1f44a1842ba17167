"""Dead drivers in captures that another program computed: the right columns, rows and pixels are named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from holoview.bench.captures import read_captures
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.independent import Faults, Laboratory, write_session
from tests.diagnose.independent_modulators import Dead, ModulatorFaults
from tests.explored import explored

SAME = SamplingConfig(padding=3)
"""The samples of the program where its pixels have two along a side and the camera one pixel for each."""
FAIL_AT = 3.0
"""Half-widths of the 95 % interval by which a value may miss the truth; as for hidden faults."""
ALIKE = ("slm1_stuck", "slm2_stuck", "slm1_fringes", "slm_flatness", "stroke_map", "lut")
FOUR_M = (450e-9, 520e-9, 590e-9, 650e-9)
LAST = 15.0  # of 16 levels


def _columns(*dead: tuple[int, float]) -> tuple[Dead, ...]:
    return tuple(Dead(first_column=column, columns=1, level=level) for column, level in dead)


def _diagnosed(
    path: Path,
    faults: Faults,
    lab: dict[str, Any],
    among: tuple[str, ...] | None = None,
) -> Diagnosis:
    file = write_session(path / "c.h5", Laboratory(faults=faults, fine=2, **lab))
    effects = None if among is None else [listed_effects()[name] for name in among]
    return diagnose(read_captures(file), effects, workers=1, free_maps=False, sampling=SAME)


def _check(found: Diagnosis, effect: str, places: dict[str, tuple[int, ...]], levels: dict[str, float]) -> None:
    assert found.verdict is Verdict.EXPLAINED and [cause.effect for cause in found.causes] == [effect]
    (cause,) = found.causes
    assert cause.lists == places
    for name, true in levels.items():
        interval = cause.intervals[name]
        assert abs(interval.value - true) <= FAIL_AT * interval.half_width, (name, true, interval)


@pytest.mark.long
def test_columns_that_are_stuck_at_levels_of_their_own_are_named_beside_look_alikes(tmp_path: Path) -> None:
    faults = Faults(modulators=ModulatorFaults(dead=(_columns((12, 4.5), (30, 11.0)), ())))
    found = _diagnosed(tmp_path, faults, {"each": 4, "seed": 1}, ALIKE)
    levels = {"column_levels[0]": 4.5 / LAST, "column_levels[1]": 11 / LAST}
    _check(found, "slm1_stuck", {"columns": (12, 30)}, levels)
    (cause,) = found.as_json()["causes"]
    assert cause["parameters"]["columns"]["value"] == [12, 30]
    assert cause["sentence"].startswith("Columns 12 and 30 of modulator 1 are stuck at 0.3 to 0.733 of full drive")


FEW = ("slm1_stuck", "slm_flatness", "stroke_map")
SMALL: dict[str, tuple[Dead, dict[str, tuple[int, ...]], dict[str, float]]] = {
    "a column from a row on": (
        Dead(first_row=15, first_column=12, columns=1, level=4.5),
        {
            "part_first_rows": (15,),
            "part_last_rows": (31,),
            "part_first_columns": (12,),
            "part_last_columns": (12,),
        },
        {"part_levels[0]": 4.5 / LAST},
    ),
    "a row that keeps the first pattern": (Dead(first_row=9, rows=1, level=None), {"kept_rows": (9,)}, {}),
    "a row that shows the pattern before": (Dead(first_row=20, rows=1, is_late=True), {"late_rows": (20,)}, {}),
}


@pytest.mark.parametrize("name", explored(list(SMALL), 0))
def test_parts_of_lines_and_lines_of_earlier_patterns_are_named(tmp_path: Path, name: str) -> None:
    dead, places, levels = SMALL[name]
    found = _diagnosed(tmp_path, Faults(modulators=ModulatorFaults(dead=((dead,), ()))), {"each": 4, "seed": 1}, FEW)
    _check(found, "slm1_stuck", places, levels)


@pytest.mark.explores
def test_columns_that_flicker_are_told(tmp_path: Path) -> None:
    """No effect describes them; free levels of two columns explain the excess, and change from capture to capture."""
    dead = tuple(Dead(first_column=column, columns=1, flickers=True) for column in (9, 27))
    lab = Laboratory(faults=Faults(modulators=ModulatorFaults(dead=((), dead))), fine=2, each=6, seed=1)
    effects = [listed_effects()[name] for name in (*FEW, "slm2_stuck", "gap", "camera_black")]
    found = diagnose(read_captures(write_session(tmp_path / "c.h5", lab)), effects, workers=1, sampling=SAME)
    assert found.verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY)
    told = "Columns 9 and 27 of modulator 2 show levels that change from capture to capture"
    assert any(note.startswith(told) for note in found.notes), found.notes


SIX = (11, 37, 38, 64, 90, 121)
OWN = ((5, 0.0), (30, 3.3), (62, 12.6), (63, 7.0), (100, 15.0), (119, 9.1))
BLOCK = [(y, x) for y in range(30, 34) for x in range(50, 54)]
SWEEP: dict[str, tuple[str, tuple[Dead, ...], dict[str, tuple[int, ...]]]] = {
    "six columns": ("slm1_stuck", _columns(*((c, 7.4) for c in SIX)), {"columns": SIX}),
    "six columns of modulator 2": ("slm2_stuck", _columns(*((c, 7.4) for c in SIX)), {"columns": SIX}),
    "six columns, own levels": ("slm1_stuck", _columns(*OWN), {"columns": tuple(c for c, _ in OWN)}),
    "one column": ("slm1_stuck", _columns((70, 4.5)), {"columns": (70,)}),
    "one row": ("slm1_stuck", (Dead(first_row=41, rows=1, level=11.2),), {"rows": (41,)}),
    "one pixel": (
        "slm1_stuck",
        (Dead(first_row=50, rows=1, first_column=80, columns=1, level=8.0),),
        {"pixel_rows": (50,), "pixel_columns": (80,)},
    ),
    "a block": (
        "slm1_stuck",
        (Dead(first_row=30, rows=4, first_column=50, columns=4, level=6.3),),
        {"pixel_rows": tuple(y for y, _ in BLOCK), "pixel_columns": tuple(x for _, x in BLOCK)},
    ),
    "half a column": (
        "slm1_stuck",
        (Dead(first_row=48, first_column=70, columns=1, level=4.5),),
        {
            "part_first_rows": (48,),
            "part_last_rows": (95,),
            "part_first_columns": (70,),
            "part_last_columns": (70,),
        },
    ),
    "a row that keeps the first pattern": (
        "slm1_stuck",
        (Dead(first_row=41, rows=1, level=None),),
        {"kept_rows": (41,)},
    ),
    "a column of modulator 2 that shows the pattern before": (
        "slm2_stuck",
        (Dead(first_column=33, columns=1, is_late=True),),
        {"late_columns": (33,)},
    ),
    "a block that keeps its last pattern": (
        "slm2_stuck",
        (Dead(first_row=60, rows=2, first_column=20, columns=3, level=None),),
        {"pixel_rows": (60, 60, 60, 61, 61, 61), "pixel_columns": (20, 21, 22, 20, 21, 22)},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SWEEP)
def test_of_the_whole_library_they_are_named(tmp_path: Path, name: str) -> None:
    effect, dead, places = SWEEP[name]
    both = (dead, ()) if effect == "slm1_stuck" else ((), dead)
    lab = {"shape": (96, 128), "wavelengths_m": FOUR_M, "each": 8, "seed": 3}
    found = _diagnosed(tmp_path, Faults(modulators=ModulatorFaults(dead=both)), lab)
    _check(found, effect, places, {})
