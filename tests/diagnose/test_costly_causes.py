"""An effect of many fields is found though a simple effect imitates it."""

from __future__ import annotations

from holoview.diagnose.fit import CandidateFit
from holoview.diagnose.judge import rank_on_held_out
from holoview.diagnose.refine import refine_fit
from holoview.diagnose.search import with_costly_in_place
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
