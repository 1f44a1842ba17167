"""Effects of many fields are found though a simple effect imitates them, and beside each other."""

from __future__ import annotations

import pytest

from holoview.diagnose.fit import CandidateFit
from holoview.diagnose.judge import Verdict, rank_on_held_out
from holoview.diagnose.pipeline import diagnose
from holoview.diagnose.refine import refine_fit
from holoview.diagnose.search import with_costly_in_place
from holoview.model.effects.registry import listed_effects
from tests.diagnose.conftest import MakeContext


def test_an_extended_source_is_tried_in_place_of_the_blur_that_imitates_it(make_context: MakeContext) -> None:
    """Beside the right distance, a blur of the camera leaves several times as much of the excess."""
    distance = {"distance_error": -2.5e-4}
    context = make_context({"distance": distance, "source_extent": {"radius": 1.5e-3}})
    start = CandidateFit(("camera_blur", "distance"), {"camera_blur": {"sigma": 1.0}, "distance": distance}, 0.0)
    blurred = rank_on_held_out(context, [refine_fit(context, start)])
    effects = [context.effects[name] for name in ("bandwidth", "source_extent", "tilt")]
    found = with_costly_in_place(context, blurred, effects)
    best = rank_on_held_out(context, [*found, blurred.best.fit]).best
    assert {*best.causes} == {"distance", "source_extent"}
    assert best.excess < 0.3 * blurred.best.excess


@pytest.mark.explores
def test_a_bandwidth_is_found_beside_a_flicker(make_context: MakeContext) -> None:
    """Their fields multiply: 6 moments of each of 7 lines."""
    hidden = {"bandwidth": {"sigma": 3.5e-9}, "flicker": {"depth": 0.12}}
    captures = make_context(hidden).data.captures
    effects = [listed_effects()[name] for name in ("bandwidth", "camera_blur", "flicker")]
    found = diagnose(captures, effects, free_maps=False)
    assert found.verdict is Verdict.EXPLAINED and {cause.effect for cause in found.causes} == hidden.keys()
