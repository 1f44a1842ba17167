"""Lists of numbers as text, in presets and in fits."""

from __future__ import annotations

import pytest

from holoview.light.model.effects.effect import ListParameter

LENGTHS = ListParameter("errors", "Some lengths.", "mm", low=-1.0, high=1.0, prior=1e-3)


@pytest.mark.parametrize(
    "text", ["4, -0.3 mm", "4 -0.3 mm", "4mm,-0.3mm", "4 mm, -300 um", "0.4 cm -3e-1mm", "4 mm -0.3 mm"]
)
def test_a_text_of_lengths_has_a_unit_each_or_one_for_all(text: str) -> None:
    assert LENGTHS.parse(text, "errors") == (4e-3, -0.3e-3)


def test_lengths_are_written_exactly_and_shown_rounded() -> None:
    values = (0.1e-3, -2e-3 / 3)
    assert LENGTHS.parse(LENGTHS.to_toml(values), "errors") == values
    assert LENGTHS.format(values) == "0.1, -0.667 mm" and LENGTHS.format(()) == ""


def test_no_fit_varies_what_says_of_which_the_others_are() -> None:
    fixed = ListParameter("distances", "Some lengths.", "mm", prior=1e-3, fixed=True)
    assert fixed.free_entries((1e-3, 2e-3)) == ()
    assert [own.name for own in LENGTHS.free_entries((1e-3, 2e-3))] == ["errors[0]", "errors[1]"]
