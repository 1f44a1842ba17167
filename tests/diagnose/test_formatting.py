"""Values are told in people's units, to two digits of their intervals."""

from __future__ import annotations

import pytest

from holoview.bench.diagnose.intervals import Interval, format_value


@pytest.mark.parametrize(
    ("effect", "parameter", "value", "half", "words"),
    [
        ("gap", "gap_error", 1.08e-4, 1.2e-6, "0.1080 ± 0.0012 mm"),
        ("crosstalk", "sigma", 0.45, 0.03, "0.450 ± 0.030 px"),
        ("stroke", "stroke_error", -0.1, 0.0004, "-0.10000 ± 0.00040"),
        ("camera_black", "black", 41.0, 120.0, "41 ± 120 counts"),
        ("gap", "gap_error", 1.08e-4, float("inf"), "0.108 ± unknown mm"),
    ],
)
def test_the_interval_gives_the_digits(effect: str, parameter: str, value: float, half: float, words: str) -> None:
    assert format_value(effect, parameter, Interval(value, half / 2, half)) == words
