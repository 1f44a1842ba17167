"""Places of the pupil: what a text describes, where the places lie, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import holoview as hv
from holoview.model.system import System
from holoview.optimise.eyes import OptimisedEyes, PupilPlaces, parse_pupils, places_between

SYSTEM = hv.load("holochrome-8").with_(eye={"pupil_x": "1 mm"})


def parse_places(text: str | None, system: System) -> PupilPlaces:
    return OptimisedEyes.from_text(text, "compensate").places_in(system)


def test_a_grid_lies_around_the_pupil() -> None:
    places = parse_places("1x3:0.5mm", SYSTEM).fixed
    assert np.array(places) == pytest.approx(np.array([[0, 0.5e-3], [0, 1e-3], [0, 1.5e-3]]))
    assert np.array(places_between(places)) == pytest.approx(np.array([[0, 0.75e-3], [0, 1.25e-3]]))
    assert len(parse_places("3x3:0.5mm", SYSTEM).held_out) == 4
    assert parse_places(None, SYSTEM) == PupilPlaces() and parse_places("1x1:1mm", SYSTEM).held_out == ()


@pytest.mark.parametrize(
    "text", ["3", "3x3", "0x3:1mm", "99x99:1mm", "3x3:", "3x3:0mm", "3x3:-1mm", "3x3:1 kg", "axb:1mm"]
)
def test_what_is_no_grid_of_places_is_refused(text: str) -> None:
    with pytest.raises(hv.UserError, match="--pupils"):
        parse_places(text, SYSTEM)


def test_places_need_an_eye() -> None:
    with pytest.raises(hv.UserError, match="--pupils: without an eye"):
        parse_places("3x3:1mm", SYSTEM.with_(eye=None))


def test_places_may_be_drawn_within_a_radius() -> None:
    pupils = parse_places("random:4:0.8mm", SYSTEM)
    assert (pupils.fixed, pupils.drawn, pupils.radius_m) == ((), 4, 0.8e-3)
    held_out = np.array(pupils.held_out) - [0, 1e-3]
    assert len(held_out) == 4 and np.abs(held_out) == pytest.approx(np.full((4, 2), 0.4e-3))
    assert SYSTEM.eye is not None and pupils.reach_m(SYSTEM.eye) == pytest.approx(0.8e-3)
    assert parse_places("1x3:0.5mm", SYSTEM).reach_m(SYSTEM.eye) == pytest.approx(0.5e-3)


@pytest.mark.parametrize(
    "text", ["random", "random:4", "random:0:1mm", "random:4:0mm", "random:4:1 kg", "random:99:1mm"]
)
def test_what_is_no_draw_is_refused(text: str) -> None:
    with pytest.raises(hv.UserError, match="--pupils"):
        parse_places(text, SYSTEM)


def test_a_draw_that_the_eyepiece_cant_show_is_refused() -> None:
    with pytest.raises(hv.UserError, match="eyepiece: 40 mm with a pupil that reaches"):
        parse_places("random:4:60mm", SYSTEM)


@pytest.mark.parametrize("text", ["3x3:0.8mm", "1x9:0.05mm", "random:4:0.8mm", "random:81:1.25mm"])
def test_places_are_written_as_they_are_read(text: str) -> None:
    assert str(parse_pupils(text)) == text


def test_colour_error_is_ignored_only_by_an_eye() -> None:
    eyes = OptimisedEyes.from_text("random:4:0.8mm", "ignore")
    seen = eyes.aimed(SYSTEM).eye
    assert seen is not None and SYSTEM.eye is not None and not seen.chromatic and SYSTEM.eye.chromatic
    assert (
        eyes.description == "pupils random:4:0.8mm, an eye without colour error" and OptimisedEyes().description == ""
    )
    with pytest.raises(hv.UserError, match="--chromatic: without an eye"):
        eyes.aimed(SYSTEM.with_(eye=None))
    with pytest.raises(hv.UserError, match='chromatic: "maybe"'):
        OptimisedEyes(chromatic="maybe")
