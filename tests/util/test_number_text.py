"""Columns of numbers as text: what separates them, and which sign is the decimal sign."""

from __future__ import annotations

from pathlib import Path

import pytest

from holoview.bench.rig.capture_plan import LaserSetting, read_exposure_table
from holoview.util.errors import UserError
from holoview.util.number_text import find_layout, read_csv


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1,5 2,25", ["1.5", "2.25"]),
        ("1,5\t2,25", ["1.5", "2.25"]),
        ("1,5; 2,25;", ["1.5", "2.25"]),
        ("1.5,2.25", ["1.5", "2.25"]),
        ("1, 2", ["1", "2"]),
    ],
)
def test_a_comma_is_a_decimal_sign_where_something_else_separates(line: str, words: list[str]) -> None:
    assert find_layout([line], "file").words(line) == words


def test_a_line_with_more_cells_than_headings_is_refused() -> None:
    assert read_csv("a,b\n1,2,\n3", "file") == ([{"a": "1", "b": "2"}, {"a": "3", "b": None}], False)
    assert read_csv("a;b\n1,5;2", "file") == ([{"a": "1,5", "b": "2"}], True)
    with pytest.raises(UserError, match=r"file, line 3: 3 cells below 2 headings; .*decimal points, or semicolons"):
        read_csv("a,b\n1,2\n1,5,2\n", "file")


def test_exposures_with_decimal_commas_are_read_between_semicolons_and_refused_between_commas(tmp_path: Path) -> None:
    """The cells 0 and 5 of a power of 0,5 would be a power of 0 and an exposure of 5 s."""
    file = tmp_path / "exposures.csv"
    file.write_text("wavelength_nm;power;exposure_s\n532;0,5;0,01\n")
    assert read_exposure_table(file, [532e-9]) == {532e-9: LaserSetting(0.5, 0.01)}
    file.write_text("wavelength_nm,power,exposure_s\n532,0,5,0,01\n")
    with pytest.raises(UserError, match="line 2: 5 cells below 3 headings"):
        read_exposure_table(file, [532e-9])
