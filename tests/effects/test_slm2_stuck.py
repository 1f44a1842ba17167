"""Stuck pixels of modulator 2 are those of modulator 1, on the other modulator; both are told in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

import holoview as hv
from holoview.captures.dataset import Captures
from holoview.captures.predictor import Predictor
from holoview.effects.slm_stuck import describe_levels
from holoview.model.effects.registry import get_effect


def test_captures_are_those_of_patterns_that_hold_the_levels(make_session: Callable[..., Captures]) -> None:
    captures = make_session(1)
    levels = captures.levels.copy()
    levels[:, 1, :, 6] = 12
    stuck = {"slm2_stuck": {"columns": (6,), "column_levels": (0.8,)}}
    found = Predictor(captures, double_precision=True)([0], stuck).signal
    expected = Predictor(replace(captures, levels=levels), double_precision=True)([0]).signal
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"columns": (70,), "column_levels": (0.3,)}, "Column 70 of modulator 2 is stuck at 0.3 of the stroke"),
        ({"columns": (9, 4, 5, 6)}, "Columns 4 to 6 and 9 of modulator 2 are stuck at 0 of the stroke"),
        (
            {"rows": (8,), "row_levels": (0.2,), "columns": (1, 2), "column_levels": (0.4, 0.6)},
            "Columns 1 and 2 and row 8 of modulator 2 are stuck at 0.2 to 0.6 of the stroke",
        ),
        (
            {"pixel_rows": (5, 5, 6, 9), "pixel_columns": (7, 8, 9, 1), "pixel_levels": (0.5,)},
            "4 pixels (rows 5 and 6, columns 7 to 9; row 9, column 1) of modulator 2 are stuck at 0.5",
        ),
        ({"column_levels": (0.5,)}, "No pixels of modulator 2"),
        (
            {
                "part_first_rows": (48,),
                "part_last_rows": (95,),
                "part_first_columns": (70,),
                "part_last_columns": (70,),
                "part_levels": (0.3,),
            },
            "Rows 48 to 95 of column 70 of modulator 2 are stuck at 0.3 of the stroke, whatever is sent (",
        ),
        ({"kept_rows": (41,)}, "Row 41 of modulator 2 shows the first pattern of all instead of what is sent ("),
        (
            {"rows": (8,), "row_levels": (0.2,), "late_columns": (3, 9)},
            "0.2 of the stroke, whatever is sent; columns 3 and 9 of modulator 2 show the pattern before instead of",
        ),
    ],
)
def test_it_is_told_in_words(values: dict[str, Any], words: str) -> None:
    assert words in get_effect("slm2_stuck").format_finding(hv.load("holochrome-8"), values)


def test_a_level_of_almost_nothing_is_nothing() -> None:
    assert describe_levels([-1.7e-5, 1.0]) == "0 to 1"
