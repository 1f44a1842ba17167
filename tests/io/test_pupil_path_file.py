"""Pupil paths as CSV: they come back as they were, tables of others are read, and mistakes are named by their line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.holograms.files.pupil_path_file import load_pupil_path, save_pupil_path
from holoview.light.model.focus import PupilPath
from holoview.util.errors import UserError

HEAD = "time (s),y (mm),x (mm),pupil (mm),accommodation (D)\n"


@pytest.mark.parametrize("tells", [(), ("pupil_m",), ("pupil_m", "accommodation_dpt")])
def test_a_path_comes_back_to_the_last_digit(tmp_path: Path, tells: tuple[str, ...]) -> None:
    rng = np.random.default_rng(0)
    times_s = (0.0, *np.cumsum(rng.random(19)).tolist())
    told = {"pupil_m": (2e-3 + 5e-3 * rng.random(20)).tolist(), "accommodation_dpt": rng.random(20).tolist()}
    y, x = (rng.normal(size=(2, 20)) * 1e-3).tolist()
    path = PupilPath(times_s, tuple(y), tuple(x), **{name: tuple(told[name]) for name in tells})
    save_pupil_path(tmp_path / "path.csv", path)
    assert load_pupil_path(tmp_path / "path.csv") == path


def test_tables_of_other_programs_are_read(tmp_path: Path) -> None:
    """Another order of columns, spaces, a byte order mark, an empty line, times that don't begin at 0."""
    text = '﻿"x (mm)",time (s),y (mm)\r\n0.5, 12.5 ,-1\r\n\r\n 0.7,13,1e-1\r\n'
    (tmp_path / "path.csv").write_text(text, encoding="utf-8", newline="")
    assert load_pupil_path(tmp_path / "path.csv") == PupilPath((0.0, 0.5), (-1e-3, 1e-4), (5e-4, 7e-4))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "holds no points"),
        (HEAD, "holds no points"),
        ("0,0,0\n1,0,0\n", ':1: "0"'),
        ("time (s),y (mm)\n0,0\n", 'no column "x .mm."'),
        ("time (s),y (mm),x (mm),x (mm)\n0,0,0,0\n", "a column twice"),
        ("time (s),y (mm),x (m)\n0,0,0\n", "did you mean x .mm."),
        (HEAD + "0,0,0,3\n", ":2: 4 values; expected 5"),
        (HEAD + "0,0,0,3,0\n1,0,near,3,0\n", ':3: x .mm.: "near"; expected a number of mm'),
        (HEAD + "0,0,0,3,0\n1,0,,3,0\n", ':3: x .mm.: ""'),
        (HEAD + "soon,0,0,3,0\n", ':2: time .s.: "soon"'),
        (HEAD + "0,0,0,3,0\n0,0,0,3,0\n", "point 2: time: 0 s follows 0 s"),
        (HEAD + "0,0,0,nan,0\n", ":2: pupil"),
        (HEAD + "0,0,0,30,0\n", "point 1: pupil: 30 mm is out of range"),
        (HEAD + '0,0,0,"3\n', ":2: "),
        (HEAD + "nan,0,0,3,0\n", "time"),
    ],
)
def test_a_mistake_is_named(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "path.csv").write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=complaint) as raised:
        load_pupil_path(tmp_path / "path.csv")
    assert str(tmp_path / "path.csv") in str(raised.value)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    (tmp_path / "noise.csv").write_bytes(bytes(range(256)))
    for name in ("noise.csv", "missing.csv", "."):
        with pytest.raises(UserError, match=r"can't be read|no such file|is a folder"):
            load_pupil_path(tmp_path / name)
    long = HEAD + "".join(f"{i},0,0,3,0\n" for i in range(20_001))
    (tmp_path / "long.csv").write_text(long, encoding="utf-8")
    with pytest.raises(UserError, match="at most 20000"):
        load_pupil_path(tmp_path / "long.csv")
