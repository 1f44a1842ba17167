"""Parts of large pictures, the middle and the corners, are predicted like the whole and find what grows outwards."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from holoview.bench.captures import Captures
from holoview.bench.captures.predictor import PLAIN, Predictor
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.config import RegionConfig, SearchConfig
from holoview.bench.diagnose.crop import (
    middle_captures,
    middle_of_context,
    through_windows,
    without_light_from_beyond,
)
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.parts import cut_parts, parts_of_context
from holoview.bench.diagnose.pipeline import diagnose, prepare_search
from holoview.bench.diagnose.search import Beside, InitialCandidates, Policy, Until, refine_candidates
from holoview.bench.diagnose.search_context import SearchContext
from holoview.bench.diagnose.worker_pool import WorkerPool
from holoview.light.model.effects.hook_contexts import CameraContext, ModulatorContext, Pose
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import small_system

CONFIG = SearchConfig(region=RegionConfig(side_px=16, further_px=4, min_saving=1.5))
EFFECTS = [listed_effects()[name] for name in ("gap", "source_profile", "vignetting")]
TRUTH = {"gap": {"gap_error": 1e-4}, "source_profile": {"fall": 1.0}}


def _large(camera_pitch_m: float = 4e-6) -> SearchContext:
    context, _ = prepare_search(_session(camera_pitch_m), (), EFFECTS, {}, PLAIN, CONFIG, WorkerPool(1))
    return context


@cache
def _session(camera_pitch_m: float = 4e-6) -> Captures:
    """Near planes, so that light walks off by few pixels."""
    system = small_system().edit({"shape": [110, 130], "gap": "0.4 mm", "planes": ["1 mm"]})
    settings = AcquisitionSettings(
        captures_per_condition=4, seed=3, camera_shape=(160, 200), camera_pitch_m=camera_pitch_m
    )
    return make_captures(system, TRUTH, settings)


def _parts(whole: SearchContext) -> SearchContext:
    middle = middle_of_context(whole)
    assert middle is not None
    parts = parts_of_context(whole, middle.data.captures, {})
    assert parts is not None and len(parts.windows) == 5
    return parts


@pytest.mark.parametrize("camera_pitch_m", [4e-6, 5.37e-6], ids=["two pixels a pixel", "no whole number"])
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("source_profile", {"fall": 0.4, "slope_x": 0.2}),
        ("vignetting", {"fall_y": 0.2, "slope_x": 0.1}),
        ("slm_flatness", {"z4_1": 8e-8, "z7_2": 5e-8}),
        ("stroke_map", {"z4_1": 0.2}),
        ("slm_alignment", {"shift_x": 2e-6, "rotation": 2e-3, "magnification": 2e-3}),
        ("camera_alignment", {"shift_y": 3e-6, "rotation": 2e-3, "magnification": 2e-3}),
        ("slm1_stuck", {"rows": (30, 31), "row_levels": (0.0, 0.0)}),
        ("camera_fringes", {"path_x": 5e-6, "path_y": 2e-6, "cos1": 0.2}),
    ],
)
def test_effects_of_a_place_act_in_parts_as_there_in_the_whole(
    effect: str, values: dict[str, object], camera_pitch_m: float
) -> None:
    """The cut changes light by less than it does without the effect, twice: with it, and by the rest of the light."""
    whole = _large(camera_pitch_m)
    parts, captures, index = _parts(whole), whole.data.captures, np.array([0])
    rows = parts.data.captures.shape[0] // 5
    errors = []
    for on in ({}, {effect: values}):
        seen = through_windows(parts.windows, Predictor(captures)(index, on).signal.numpy()[0])
        cut = parts.predictor(index, on).signal.numpy()[0]
        squares = np.square(cut - seen).reshape(5, rows, -1).mean((1, 2))
        errors.append(np.sqrt(squares) / seen.mean())
    assert (errors[1] < 2 * errors[0].max()).all()


@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.2, -0.3), (-0.9, 0.9)])
@pytest.mark.parametrize("radius", [0.05, 0.3, 5.0])
def test_parts_lie_beneath_a_beam_side_by_side_within_the_pictures(radius: float, centre: tuple[float, float]) -> None:
    """However small it is and wherever: as near to its middle as five parts that share no pixel can be."""
    whole = _large()
    like = middle_captures(whole.data.captures, CONFIG.region)
    beam = {"size": 1 / radius, "centre_y": centre[0], "centre_x": centre[1]}
    parts = cut_parts(whole.data, like, beam)
    assert parts is not None
    seen = np.zeros(whole.data.captures.shape, dtype=int)
    for window, part in zip(parts.windows, parts.captures, strict=True):
        assert seen[window].shape == like.shape == part.shape
        seen[window] += 1
        np.testing.assert_array_equal(whole.data.captures.images[:, *window], part.images)
    assert seen.max() == 1
    if radius == 0.3 and abs(centre[1]) < 0.9:  # where there is room on either side
        pitch_m = whole.data.captures.slms[0].pitch_m
        assert parts.captures[0].centre_m[1] == pytest.approx(centre[1] * 65 * pitch_m, abs=pitch_m)


@pytest.mark.long
def test_a_cause_that_grows_outwards_is_found_in_parts() -> None:
    """The fit that a middle finds leaves what only the corners show."""
    whole = _large()
    parts = without_light_from_beyond(whole, _parts(whole), {"gap": TRUTH["gap"]})
    fits = (CandidateFit(("gap",), {"gap": TRUTH["gap"]}, 0.0),)
    initial = InitialCandidates(fits, Policy(Beside.OVER_FIELD, Until.EXPLAINED))
    effects = {name: parts.effects[name] for name in TRUTH}
    found = refine_candidates(replace(parts, field_budget=1e6, effects=effects), initial, lambda *_: None)
    assert {*found.best.causes} == {*TRUTH}
    assert found.best.fit.values["source_profile"]["fall"] == pytest.approx(1.0, rel=0.05)
    assert parts.split.held_out.tolist() == whole.split.held_out.tolist()


@pytest.mark.explores
def test_whole_pictures_judge_what_was_fitted_to_parts() -> None:
    found = diagnose(_session(), EFFECTS, free_maps=False, config=CONFIG)
    assert found.verdict is Verdict.EXPLAINED and {cause.effect for cause in found.causes} == {*TRUTH}
    assert any("five parts fitted them, whole ones judged" in note for note in found.notes)
    for cause in found.causes:
        for name, interval in cause.intervals.items():
            truth = TRUTH[cause.effect].get(name, 0.0)
            assert abs(interval.value - truth) < 3 * interval.half_width


@pytest.mark.long
@pytest.mark.parametrize(
    ("doing", "found_before"),
    [
        ("light from beyond the middle", set()),
        ("stops that fit", {"gap"}),
        ("light from beyond the parts, as predicted", {"gap"}),
    ],
)
def test_a_search_that_ends_between_two_views_keeps_what_it_has(doing: str, found_before: set[str]) -> None:
    """Somebody asks for the end while light from beyond the middle or parts is measured or predicted."""
    said: list[str] = []
    found = diagnose(
        _session(),
        EFFECTS,
        free_maps=False,
        config=CONFIG,
        progress=lambda _, __, what: said.append(what),
        is_asked_to_end=lambda: doing in said,
    )
    assert doing in said and any("was interrupted" in note for note in found.notes)
    assert found_before <= {cause for candidate in found.candidates for cause in candidate.causes}


def test_a_part_knows_where_it_is() -> None:
    """The pose of a part moves its points as that of the whole does; positions and first pixels count in the whole."""
    pose, centre = Pose((2e-6, -1e-6), 0.02, 1.01), (3e-3, -2e-3)
    (a, b, c), (d, e, f) = pose.inverse_affine(1.0)
    (_, _, y), (_, _, x) = pose.about(centre).inverse_affine(1.0)
    moved = (a * centre[0] + b * centre[1] + c - centre[0], d * centre[0] + e * centre[1] + f - centre[1])
    assert (y, x) == pytest.approx(moved, abs=1e-15)
    part = ModulatorContext(0, 5e-7, 8e-7, 8e-6, (4, 6), 2, frame=(20, 30), centre_m=(16e-6, -24e-6))
    whole = ModulatorContext(0, 5e-7, 8e-7, 8e-6, (20, 30), 2)
    (top, left), (ys, xs) = part.first_pixel, whole.positions(torch.zeros(20, 30, dtype=torch.float64))
    own = part.positions(torch.zeros(4, 6, dtype=torch.float64))
    assert torch.allclose(own[0], ys[top : top + 4]) and torch.allclose(own[1], xs[:, left : left + 6])
    camera = CameraContext(4e-6, (4, 6), frame=(8, 12), centre_m=(4e-6, 8e-6)).positions(torch.zeros(4, 6))
    frame = CameraContext(4e-6, (8, 12)).positions(torch.zeros(8, 12))
    assert torch.allclose(camera[0], frame[0][3:7]) and torch.allclose(camera[1], frame[1][:, 5:11])
