"""Units: text to SI and back without losing a digit, and refusals that say what to write instead."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from holoview.util import units
from holoview.util.errors import UserError

LENGTH_UNITS = ("pm", "nm", "um", "mm", "cm", "m")
FINITE = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("460 nm", 4.6e-07),
        ("8um", 8e-06),
        ("8 µm", 8e-06),  # micro sign U+00B5
        ("8 μm", 8e-06),  # Greek mu U+03BC
        ("  2.25   mm ", 2.25e-3),
        (".5 cm", 5e-3),
        ("5. m", 5.0),
        ("-1e-3 m", -1e-3),
        ("+120 pm", 1.2e-10),
    ],
)
def test_a_length_in_peoples_units_is_the_nearest_float_to_its_decimal_value(text: str, metres: float) -> None:
    assert units.parse(text, "gap") == metres


@pytest.mark.parametrize(
    ("text", "radians"), [("5 mrad", 5e-3), ("0.3 rad", 0.3), ("70 urad", 7e-5), ("70 µrad", 7e-5)]
)
def test_an_angle_has_its_own_units(text: str, radians: float) -> None:
    assert units.parse(text, "tilt", "angle") == radians


@pytest.mark.parametrize("number", [0, 3, 2e-3, -1.5])
def test_a_plain_number_is_si_already(number: float) -> None:
    assert units.parse(number, "gap") == number


@given(FINITE, st.sampled_from(LENGTH_UNITS))
def test_every_float_survives_text_and_back_exactly(value: float, unit: str) -> None:
    assert units.parse(units.format_exact(value, unit), "x") == value


@given(FINITE, st.sampled_from(("urad", "mrad", "rad")))
def test_every_angle_survives_text_and_back_exactly(value: float, unit: str) -> None:
    assert units.parse(units.format_exact(value, unit), "x", "angle") == value


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (4.6e-07, "nm", "460 nm"),
        (2e-3, "mm", "2 mm"),
        (1e-5, "um", "10 um"),
        (0.0, "mm", "0 mm"),
        (3e-4, "m", "0.0003 m"),
    ],
)
def test_text_is_written_as_people_write_it(value: float, unit: str, text: str) -> None:
    assert units.format_exact(value, unit) == text


def test_short_text_is_rounded_for_reading() -> None:
    assert units.format_rounded(541.428571e-9, "nm") == "541.4 nm"
    assert units.format_rounded(541.428571e-9, "nm", digits=6) == "541.429 nm"


def test_a_window_shows_micrometres_by_their_sign_and_words_as_they_are() -> None:
    assert units.with_symbols("offset (um)") == "offset (µm)"
    assert units.with_symbols("8 um pitch of a vacuum, 2 mm, 532 nm, um_per_px") == (
        "8 µm pitch of a vacuum, 2 mm, 532 nm, um_per_px"
    )


@pytest.mark.parametrize(
    ("value", "quantity", "fragments"),
    [
        ("8", "length", ('"8" has no unit', '"8 um"')),
        ("8 furlong", "length", ('has the unit "furlong"', "length", "known: cm, m, mm")),
        ("8 umm", "length", ('has the unit "umm"', "did you mean", "um")),
        ("8 mrad", "length", ('has the unit "mrad"', "length")),
        ("8 mm", "angle", ('has the unit "mm"', "known: mrad, rad, urad")),
        ("eight mm", "length", ('"eight mm" is not a length', "a number and a unit")),
        ("", "length", ('"" is not a length',)),
        ("8 u m", "length", ('"8 u m" is not a length',)),
        ("1_0 mm", "length", ('"1_0 mm" is not a length',)),
        ("nan m", "length", ('"nan m" is not a length',)),
        (True, "length", ("True is not a length",)),
        (None, "angle", ("None is not an angle",)),
        ([1], "length", ("[1] is not a length",)),
        ("1e999999999999999999999 m", "length", ("out of range",)),
        ("9e9999999 m", "length", ("out of range",)),
    ],
)
def test_text_that_is_no_such_quantity_is_refused_with_place_and_remedy(
    value: object, quantity: units.Quantity, fragments: tuple[str, ...]
) -> None:
    with pytest.raises(UserError) as caught:
        units.parse(value, "relay2.gap", quantity)  # type: ignore[arg-type]
    message = str(caught.value)
    assert message.startswith("relay2.gap: ")
    for fragment in fragments:
        assert fragment in message


def test_a_number_beyond_floats_is_refused() -> None:
    with pytest.raises(UserError, match=r"gap: .* is out of range"):
        units.parse("1e400 m", "gap")
