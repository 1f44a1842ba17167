"""Effects of many fields are found though a simple effect imitates them, and beside each other."""

from __future__ import annotations

from dataclasses import replace

import pytest

from holoview.bench.diagnose.fit import CandidateFit, local_fit
from holoview.bench.diagnose.judge import JITTER_CHI2, Verdict, rank_on_held_out
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.refine import refine_fit
from holoview.bench.diagnose.search import shared_with_costly, with_others_in_place
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import NOISE_CHI2, MakeContext


@pytest.mark.long
def test_an_extended_source_is_tried_in_place_of_the_blur_that_imitates_it(make_context: MakeContext) -> None:
    """Beside the right distance, a blur of the camera leaves several times as much. The budget was spent just then."""
    distance = {"distance_error": -2.5e-4}
    context = make_context({"distance": distance, "source_extent": {"radius": 1.5e-3}})
    start = CandidateFit(("camera_blur", "distance"), {"camera_blur": {"sigma": 1.0}, "distance": distance}, 0.0)
    blurred = rank_on_held_out(context, [refine_fit(context, start)])
    effects = [context.effects[name] for name in ("bandwidth", "source_extent", "tilt")]
    spent = replace(context, field_budget=0.5 * context.predictor.fields_requested)
    found = with_others_in_place(spent, blurred, effects)
    best = rank_on_held_out(context, [*found, blurred.best.fit]).best
    assert {*best.causes} == {"distance", "source_extent"}
    assert best.excess < 0.3 * blurred.best.excess


@pytest.mark.explores
def test_it_is_tried_in_place_of_a_lone_blur_but_not_of_another_costly_effect(make_context: MakeContext) -> None:
    """Small: between the first two points of its scan, of which the last takes hundreds of fields a capture."""
    context = make_context({"source_extent": {"radius": 0.8e-3}})
    effects = [context.effects[name] for name in ("bandwidth", "source_extent")]
    (blur,), (line,) = _alone(context, camera_blur={"sigma": 0.8}), _alone(context, bandwidth={"sigma": 3e-9})
    blurred = rank_on_held_out(context, [refine_fit(context, blur)])
    best = rank_on_held_out(context, [*with_others_in_place(context, blurred, effects), blurred.best.fit]).best
    assert best.causes == ("source_extent",) and best.excess < 0.3 * blurred.best.excess
    assert with_others_in_place(context, rank_on_held_out(context, [line]), effects) == []


@pytest.mark.long
def test_a_blur_is_tried_in_place_of_a_motion_before_effects_of_many_fields(make_context: MakeContext) -> None:
    """Beside three other causes. Motions along both axes imitate a blur of the same variance, length² / 12 = sigma²."""
    others = {"gap": {"gap_error": 1e-4}, "stroke": {"stroke_error": 0.1}, "ambient": {"level": 300.0}}
    context = make_context({**others, "camera_blur": {"sigma": 1.0}})
    motion = {"length_y": 12**0.5, "length_x": 12**0.5}
    start = CandidateFit((*others, "motion_blur"), {**others, "motion_blur": motion}, 0.0)
    moved = rank_on_held_out(context, [refine_fit(context, start)])
    found = with_others_in_place(context, moved, [*context.effects.values()])
    assert found and "source_extent" not in {name for fit in found for name in fit.causes}
    best = rank_on_held_out(context, [*found, moved.best.fit]).best
    assert {*best.causes} == {*others, "camera_blur"} and best.chi2_per_pixel < NOISE_CHI2 < moved.best.chi2_per_pixel


@pytest.mark.long
def test_an_extended_source_is_found_beside_a_true_blur(make_context: MakeContext) -> None:
    """Either alone is fitted too large, the best first; beside the blur alone nothing is left for the source."""
    hidden = {"camera_blur": {"sigma": 1.6}, "source_extent": {"radius": 1.8e-3}}
    context = make_context(hidden)
    alone = _alone(context, **hidden)
    assert alone[0].values["camera_blur"]["sigma"] > 1.7 and alone[1].values["source_extent"]["radius"] > 1.9e-3
    (found,) = shared_with_costly(context, alone)
    best = rank_on_held_out(context, [found, *alone]).best
    assert {*best.causes} == hidden.keys() and best.chi2_per_pixel < JITTER_CHI2


@pytest.mark.long
def test_a_source_is_not_kept_beside_a_blur_where_there_is_none(make_context: MakeContext) -> None:
    """What a second cause, here light of the other polarisation, leaves isn't given to the source."""
    blur = {"sigma": 1.6}
    context = make_context({"camera_blur": blur, "polarisation": {"share": 0.1}})
    alone = _alone(context, camera_blur=blur, source_extent={"radius": 1.8e-3})
    smooth = context.data_weighted_comparison(context.split.coarse, 0.0)
    nominal = smooth.chi2_per_pixel({}) - 1
    assert all(smooth.chi2_per_pixel(fit.values) - 1 < 0.25 * nominal for fit in alone), "alike: a joint fit is tried"
    assert shared_with_costly(context, alone) == []


def _alone(context: SearchContext, **starts: dict[str, float]) -> list[CandidateFit]:
    """Fits of each effect alone, on smooth captures."""
    smooth = context.tolerant_comparison(context.split.coarse, context.relative_model_error({}))
    return [local_fit([context.effects[name]], {name: start}, smooth) for name, start in starts.items()]


@pytest.mark.explores
def test_a_bandwidth_is_found_beside_a_flicker(make_context: MakeContext) -> None:
    """Their fields multiply: 6 moments of each of 7 lines."""
    hidden = {"bandwidth": {"sigma": 3.5e-9}, "flicker": {"depth": 0.12}}
    captures = make_context(hidden).data.captures
    effects = [listed_effects()[name] for name in ("bandwidth", "camera_blur", "flicker")]
    found = diagnose(captures, effects, free_maps=False)
    assert found.verdict is Verdict.EXPLAINED and {cause.effect for cause in found.causes} == hidden.keys()
