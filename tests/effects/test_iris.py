"""A wider iris is a bench with a wider iris; one off the centre lets another disc of directions through."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
pytestmark = pytest.mark.parametrize("number", [1, 2])


def test_it_changes_the_radius(make_session: Make, predicted: Predicted, number: int) -> None:
    captures = make_session()
    narrower = dataclasses.replace(captures, **{f"relay{number}": Relay(iris_na=0.8 * 0.03)})
    found = predicted(captures, {f"iris{number}": {"radius_error": 0.8 * 0.03 / 0.03 - 1}})
    torch.testing.assert_close(found, predicted(narrower), rtol=1e-9, atol=1e-12)


def test_off_the_centre_another_disc_passes(make_session: Make, number: int) -> None:
    values = get_effect(f"iris{number}").parameter_values({"radius_error": 0.1, "decentre_y": 0.5, "decentre_x": -0.25})
    relay = getattr(
        get_effect(f"iris{number}").actual_system(make_session().nominal_system(), values), f"relay{number}"
    )
    assert relay.iris_na == pytest.approx(0.033)
    assert relay.centre_na == pytest.approx((0.015, -0.0075))


@pytest.mark.parametrize("square", [0.02, "first order at 532 nm", "first order"])
def test_a_square_stop_grows_and_moves_in_its_own_half_sides(
    make_session: Make, square: float | str, number: int
) -> None:
    system = make_session().nominal_system().edit({f"relay{number}": {"square": square, "centre_na": [0.001, 0.0]}})
    values = get_effect(f"iris{number}").parameter_values({"radius_error": -0.2, "decentre_x": 0.5})
    relay = getattr(get_effect(f"iris{number}").actual_system(system, values), f"relay{number}")
    pitch_m = system.modulators[0].pitch_m
    before, after = (r.square.half_side_sine(550e-9, pitch_m) for r in (getattr(system, f"relay{number}"), relay))
    assert after == pytest.approx(0.8 * before)
    assert relay.centre_na == pytest.approx((0.001, 0.5 * before))


def test_it_says_how_wide_it_is(make_session: Make, number: int) -> None:
    said = get_effect(f"iris{number}").format_finding(make_session().nominal_system(), {"radius_error": -0.2})
    assert said == f"The iris of relay {number} has an aperture of 0.024, not 0.03."


@pytest.mark.parametrize(
    ("relay", "values", "words"),
    [
        ({"iris_na": 0.03}, {"decentre_x": -0.1}, "iris of relay {} is off its centre by 0 mrad (y) and -3 mrad (x)."),
        ({"square": 0.03}, {"radius_error": 0.1}, "square stop of relay {} has half a side of 0.033, not 0.03."),
        (
            {"square": "first order at 560 nm"},
            {"radius_error": 0.1, "decentre_y": 0.2},
            "has half a side of 0.0385, not 0.035 and is off its centre by 7 mrad (y) and 0 mrad (x).",
        ),
        ({"square": "first order"}, {"radius_error": -0.2}, "has half a side, at 550 nm, of 0.0275, not 0.03438."),
        (
            {"square": 0.03, "iris_na": 0.02},
            {"radius_error": 0.1},
            "iris of relay {} has an aperture of 0.022, not 0.02.",
        ),
    ],
)
def test_it_says_what_is_wrong_with_which_stop(
    make_session: Make, relay: dict[str, float | str], values: dict[str, float], words: str, number: int
) -> None:
    system = make_session().nominal_system().edit({f"relay{number}": relay})
    assert get_effect(f"iris{number}").format_finding(system, values).endswith(words.format(number))
