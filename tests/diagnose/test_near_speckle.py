"""Large faults together on near fields of an independent program: speckle finds their light too."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.plain_light import Beam
from benchmarks.real_benches import Drawn, draw, measure
from holoview.bench.captures.capture_file import read_captures
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.speckle_retrieval import beam_of_brightness
from holoview.bench.diagnose import speckle_evidence
from holoview.bench.diagnose.config import RegionConfig, SearchConfig
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.search_context import SearchEnded
from holoview.bench.diagnose.speckle_evidence import (
    LightWindow,
    describe_light,
    light_by_speckle,
    near_beam,
    window_for_light,
)
from holoview.bench.diagnose.speckle_light import (
    NOMINAL,
    Circle,
    Pictures,
    PointPredictor,
    SpeckleSearch,
    circle_of,
    rebased,
)
from holoview.light.effects import beam as beam_effect
from holoview.light.model.effects.registry import listed_effects
from holoview.util.progress import ProgressCallback, no_progress
from tests.explored import explored

RADIUS_PX, STROKE, HALF_PX = 15.0, 0.7, 32.0
WAVE = {(2, 2): 0.5, (3, 1): 0.6, (3, -1): -0.5}  # rad r.m.s.: astigmatism and both comas


def _captures(drawn: Drawn, folder: Path) -> Captures:
    return read_captures(measure(drawn, folder, 3).with_suffix(".h5"))


def _nominal(kind: str, lines: int, shape: tuple[int, int] = (48, 64)) -> Drawn:
    """Two pictures by a few pixels of a bench without faults."""
    drawn = draw(5, "none", kind, 64)
    wavelength_m = drawn.wavelengths_m[0]
    bench = replace(drawn.bench, shape=shape, camera=(shape[0] * 3 // 2, shape[1] * 3 // 2))
    if shape != (48, 64):  # nearer than light walks off by the width of a beam
        bench = replace(bench, distance_m=2e-3, gap_m=None if bench.gap_m is None else 0.5e-3)
        drawn = replace(drawn, stated=drawn.stated | {"distance": 2e-3} | ({"gap": 0.5e-3} if bench.gap_m else {}))
    return replace(drawn, bench=bench, pictures=2, wavelengths_m=(wavelength_m, wavelength_m + 60e-9)[:lines])


@pytest.mark.long
@pytest.mark.parametrize("bench", explored(["near, two lines", "near", "near-two"], 1))
def test_a_small_beam_with_a_wavefront_and_a_wrong_stroke_stands_for_the_pictures(bench: str, tmp_path: Path) -> None:
    """Strokes are told by pictures of several grains to some hundredths; the radius by where the light ends."""
    kind, *more = bench.split(", ")
    drawn = _nominal(kind, 1 + len(more))
    beam = Beam(RADIUS_PX, 2.0, (2.0, -4.0))
    spoilt = replace(
        drawn.bench, beam=beam, wave=WAVE, wave_radius_px=RADIUS_PX, stroke_m=drawn.bench.stroke_m * STROKE
    )
    captures = _captures(replace(drawn, bench=spoilt), tmp_path)
    window = window_for_light(captures, list(listed_effects()))
    assert window is not None and np.array_equal(window.captures.images, captures.images)  # near fields as they are
    light = light_by_speckle(window, no_progress, untold)
    assert light is not None and light.before < 0.6 and light.after > 0.95
    assert HALF_PX / light.values["beam"]["size"] == pytest.approx(RADIUS_PX, rel=0.2)
    assert 1 + light.values["stroke"]["stroke_error"] == pytest.approx(STROKE, rel=0.1)


@pytest.mark.parametrize("draw", range(2))
@pytest.mark.parametrize("kind", ["near", "near-two", "fourier"])
def test_values_of_effects_make_the_light_of_a_point(
    kind: str, draw: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each pixel with the light of its middle, as points have it. Coma about one centre has defocus and astigmatism
    about the beam's, though the point is without defocus. It has no tilts about the beam's, which are stated as a shift
    of the picture: what stays is rounding."""
    monkeypatch.setattr(beam_effect, "_MOST_WITHIN_PIXELS", math.inf)
    captures, random = _captures(_nominal(kind, 1), tmp_path), np.random.default_rng(draw)
    pictures, circle = Pictures(prepare_captures(captures)), Circle(0.55, *random.uniform(-0.3, 0.3, 2))
    point = NOMINAL | {"log_size": random.uniform(0.2, 0.9), "stroke": 0.7, "share": 0.1, "quadrature": 0.05}
    point |= {name: random.uniform(-0.3, 0.3) for name in ("centre_y", "centre_x")}
    point |= {name: random.uniform(-1, 1) for name in ("z5", "z6", "z7", "z8")}
    own = circle_of(point)
    centred = rebased(point, circle, own)
    point |= {name: -centred[name] * circle.radius / own.radius for name in ("z2", "z3")}
    absent = ["defocus", "trefoil", "spherical aberration", "stray light"]
    values = SpeckleSearch(pictures, circle).effect_values(point, absent)
    assert max(map(abs, values["camera_alignment"].values())) < 1e-3 * captures.camera.pitch_m
    predicted = Predictor(captures, cache_mb=1)(np.arange(2), values).signal
    with torch.no_grad():
        light = PointPredictor(pictures, circle)(point)
    assert float((predicted - light).norm() / light.norm()) < 1e-3


@pytest.mark.long
def test_a_wavefront_beside_which_speckle_nearly_stands_is_found_later(tmp_path: Path) -> None:
    """Over the circle around the modulator, of two pictures through two modulators: nothing else is wrong, so that
    derivatives are asked first. What is found lacks less than half of what the nominal bench lacks."""
    drawn = _nominal("near-two", 1)
    radius_px = math.hypot(*drawn.bench.shape) / 2
    wave = {term: 0.6 * size for term, size in WAVE.items()}
    captures = _captures(replace(drawn, bench=replace(drawn.bench, wave=wave, wave_radius_px=radius_px)), tmp_path)
    window = window_for_light(captures, list(listed_effects()))
    assert window is not None and not window.is_first
    light = light_by_speckle(window, no_progress, untold)
    assert light is not None and light.before < 1 - 2 * (1 - light.after)
    assert "slm_flatness" in light.values and not {"beam", "stroke", "undiffracted", "camera_black"} & {*light.values}
    for name, term in {"z8_1": (3, 1), "z7_1": (3, -1)}.items():  # weak astigmatism may be left out, and errs in these
        radians = light.values["slm_flatness"][name] * 2 * math.pi / drawn.wavelengths_m[0]
        assert radians == pytest.approx(wave[term], abs=0.2)


def untold(text: str) -> None:
    """Nothing is said where light is sought."""
    raise AssertionError(text)


SMALL_PARTS = RegionConfig(side_px=40, further_px=8)


def _large(pictures: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Captures:
    """Pictures whose light is sought in parts, of a beam with a radius of 70 pixels."""
    monkeypatch.setattr(speckle_evidence, "_MOST_NEAR_PX", 96 * 128 - 1)
    drawn = replace(_nominal("near", 1, (192, 256)), pictures=pictures)
    beam, stroke_m = Beam(70.0, 2.0, (20.0, -30.0)), drawn.bench.stroke_m * STROKE
    spoilt = replace(drawn.bench, beam=beam, wave=WAVE, wave_radius_px=70.0, stroke_m=stroke_m)
    return _captures(replace(drawn, bench=spoilt), folder)


@pytest.mark.long
def test_the_light_of_large_modulators_is_sought_in_parts_beneath_the_beam(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in whole pictures; a wavefront over the whole beam is one in all of its parts."""
    window = window_for_light(_large(2, tmp_path, monkeypatch), list(listed_effects()))
    assert window is not None
    light = light_by_speckle(window, no_progress, untold, SMALL_PARTS)
    assert light is not None and light.is_of_parts and "five parts" in describe_light(light)
    assert light.before < 0.8 and light.after > 0.95
    assert 128 / light.values["beam"]["size"] == pytest.approx(70.0, rel=0.05)
    assert 1 + light.values["stroke"]["stroke_error"] == pytest.approx(STROKE, rel=0.05)


@pytest.mark.long
def test_large_modulators_without_room_for_parts_are_not_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whole pictures of this size would take too long, and too much memory."""
    captures = _large(1, tmp_path, monkeypatch)
    window = LightWindow(captures, near_beam(captures), True)
    said: list[str] = []
    assert light_by_speckle(window, no_progress, said.append, RegionConfig(side_px=250)) is None
    assert said == [
        "The light wasn't sought by speckle: the pictures show too little around their middle for five parts"
    ]


@pytest.mark.long
@pytest.mark.parametrize("pictures", [1, 2])
def test_light_in_parts_is_fitted_there_and_judged_in_whole_pictures(
    pictures: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The beam and the stroke are named, and nothing that isn't there but where the picture lies."""
    captures = _large(pictures, tmp_path, monkeypatch)
    found = diagnose(captures, config=SearchConfig(region=SMALL_PARTS))
    named = {cause.effect: cause.intervals for cause in found.causes}
    assert {"beam", "stroke"} <= named.keys() <= {"beam", "stroke", "camera_alignment", "distance"}
    assert found.after.chi2_per_pixel < found.before.chi2_per_pixel / 10
    assert 1 + named["stroke"]["stroke_error"].value == pytest.approx(STROKE, rel=0.03)
    assert 128 / named["beam"]["size"].value == pytest.approx(70.0, rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize("stray", [0.0, 12.0])
def test_brightness_tells_stray_light_beside_a_beam(stray: float, tmp_path: Path) -> None:
    """Speckle hardly does: local contrasts are divided by their spread. To a tenth, as the beam's edge is blurred."""
    drawn = _nominal("near", 1, (96, 128))
    spoilt = replace(drawn.bench, beam=Beam(40.0, 2.0, (5.0, -8.0)), stroke_m=drawn.bench.stroke_m * STROKE)
    captures = _captures(replace(drawn, bench=spoilt), tmp_path)
    captures = replace(captures, images=np.minimum(captures.images + stray, captures.camera.saturation))
    light = light_by_speckle(LightWindow(captures, near_beam(captures), True), no_progress, untold)
    assert light is not None
    found = light.values.get("camera_black", {"black": 0.0})["black"]
    assert found == pytest.approx(stray, rel=0.1) if stray else found == 0.0


@pytest.mark.long
def test_pictures_in_several_planes_have_one_light(tmp_path: Path) -> None:
    """It is sought in the plane of the brightest picture, and stands in the others too."""
    drawn = _nominal("near", 1, (96, 128))
    beam, stroke_m = Beam(40.0, 2.0, (5.0, -8.0)), drawn.bench.stroke_m * STROKE
    both = []
    for place_m in (2e-3, 3e-3):
        spoilt = replace(drawn.bench, beam=beam, stroke_m=stroke_m, distance_m=place_m)
        (tmp_path / f"{place_m}").mkdir()
        there = replace(drawn, bench=spoilt, stated=drawn.stated | {"distance": place_m})
        both.append(_captures(there, tmp_path / f"{place_m}"))
    joined = {
        name: np.concatenate([getattr(one, name) for one in both])
        for name in ("levels", "images", "wavelength_m", "distance_m", "power", "exposure_s")
    }
    captures = replace(both[0], **joined)
    window = window_for_light(captures, list(listed_effects()))
    assert window is not None
    light = light_by_speckle(window, no_progress, untold)
    assert light is not None and light.after > 0.95
    assert 1 + light.values["stroke"]["stroke_error"] == pytest.approx(STROKE, rel=0.1)
    predicted = Predictor(captures)(np.arange(len(captures)), light.values).signal.numpy()
    for seen, expected in zip(captures.images, predicted, strict=True):
        assert np.corrcoef(seen.ravel(), expected.ravel())[0, 1] > 0.9


@pytest.mark.long
@pytest.mark.parametrize("gap_factor", explored([0.9, 1.0, 1.15], 1))
def test_a_second_modulator_out_of_its_place_is_found_beside_a_beam_and_a_wrong_stroke(
    gap_factor: float, tmp_path: Path
) -> None:
    """To a tenth of a pixel; and the gap to a twentieth of it, in which pictures change by less than their grain."""
    drawn = _nominal("near-two", 1, (96, 128))
    assert drawn.bench.gap_m is not None
    spoilt = replace(
        drawn.bench,
        beam=Beam(40.0, 2.0, (5.0, -8.0)),
        stroke_m=drawn.bench.stroke_m * 1.3,
        second_px=(-0.25, 1.25),
        gap_m=drawn.bench.gap_m * gap_factor,
    )
    captures = _captures(replace(drawn, bench=spoilt), tmp_path)
    light = light_by_speckle(LightWindow(captures, near_beam(captures), True), no_progress, untold)
    assert light is not None and light.after > 0.95
    place_m = light.values["slm_alignment"]
    found_px = np.array([place_m["shift_y"], place_m["shift_x"]]) / drawn.bench.pitch_m
    np.testing.assert_allclose(found_px, spoilt.second_px, atol=0.1)
    found_m = drawn.bench.gap_m + light.values.get("gap", {"gap_error": 0.0})["gap_error"]
    assert found_m == pytest.approx(spoilt.gap_m, rel=0.05)
    assert 1 + light.values["stroke"]["stroke_error"] == pytest.approx(1.3, rel=0.1)


@pytest.mark.long
def test_a_search_that_is_ended_keeps_the_light_that_it_has(tmp_path: Path) -> None:
    """Between its kicks: all parts are handed on, as nothing has judged them; earlier there is nothing to keep."""
    drawn = _nominal("near", 1)
    beam = Beam(RADIUS_PX, 2.0, (2.0, -4.0))
    captures = _captures(replace(drawn, bench=replace(drawn.bench, beam=beam, stroke_m=0.7e-6)), tmp_path)
    window = LightWindow(captures, near_beam(captures), True)

    light = light_by_speckle(window, _end_at(12), untold)
    assert light is not None and light.was_ended and not light.losses
    assert {"beam", "stroke", "undiffracted", "camera_black"} <= light.values.keys()
    assert "ended early" in describe_light(light)
    with pytest.raises(SearchEnded):
        light_by_speckle(window, _end_at(3), untold)


def _end_at(most: int) -> ProgressCallback:
    """A progress that ends a search by speckle at its stage `most`."""

    def progress(done: int, total: int, what: str) -> None:
        if done >= most:
            raise SearchEnded

    return progress


@pytest.mark.parametrize("kind", ["near", "near-two"])
@pytest.mark.parametrize("dropped", [set(), {"shape"}])
def test_the_light_of_effects_is_that_of_the_point_that_they_came_from(
    kind: str, dropped: set[str], tmp_path: Path
) -> None:
    """Terms of a wavefront over one circle are the same terms over another one."""
    pictures = Pictures(prepare_captures(_captures(_nominal(kind, 1), tmp_path)))
    search = SpeckleSearch(pictures, Circle(0.5, 0.1, -0.2))
    point = NOMINAL | {"stroke": 0.8, "share": 0.1, "quadrature": -0.05, "stray": 0.02, "z4": 0.3, "z8": -0.4}
    point |= {"z5": 0.2, "z11": 0.1} | ({"second_y": 0.4, "second_x": -0.7} if kind == "near-two" else {})
    point |= {} if dropped else {"log_size": 0.5, "edge": 3.0, "centre_y": 0.1, "centre_x": -0.1}
    again = search.point_of(search.effect_values(point, dropped))
    assert {name: again[name] for name in again if name not in ("z2", "z3")} == pytest.approx(
        {name: point[name] for name in point if name not in ("z2", "z3")}, abs=1e-6
    )


@pytest.mark.long
@pytest.mark.parametrize("kind", ["near", "near-two"])
def test_light_is_sought_from_causes_that_were_found_before(kind: str, tmp_path: Path) -> None:
    """A beam and a stroke of which the wavefront is missing: the first ascent finds it, before retrieved light."""
    drawn = _nominal(kind, 1)
    beam, stroke_m = Beam(RADIUS_PX, 2.0, (2.0, -4.0)), drawn.bench.stroke_m * STROKE
    spoilt = replace(drawn.bench, beam=beam, wave=WAVE, wave_radius_px=RADIUS_PX, stroke_m=stroke_m)
    captures = _captures(replace(drawn, bench=spoilt), tmp_path)
    place = {"centre_y": 2.0 / HALF_PX, "centre_x": -4.0 / HALF_PX}
    earlier = {"beam": {"size": HALF_PX / RADIUS_PX, "edge": 1.0, **place}, "stroke": {"stroke_error": STROKE - 1}}
    light = light_by_speckle(LightWindow(captures, near_beam(captures), False), _end_at(1), untold, earlier=earlier)
    assert light is not None and light.was_ended
    assert light.after > 0.95


@pytest.mark.long
@pytest.mark.parametrize("kind", explored(["near", "near-two"], 1))
def test_the_light_is_the_same_in_any_number_of_threads(kind: str, tmp_path: Path) -> None:
    """But for rounding, which differs from run to run."""
    drawn = _nominal(kind, 1)
    spoilt = replace(drawn.bench, beam=Beam(RADIUS_PX, 2.0, (2.0, -4.0)), stroke_m=drawn.bench.stroke_m * STROKE)
    captures = _captures(replace(drawn, bench=spoilt), tmp_path)
    window = LightWindow(captures, near_beam(captures), True)
    alone, side_by_side = (light_by_speckle(window, no_progress, untold, threads=threads) for threads in (1, 3))
    assert alone is not None and side_by_side is not None and alone.values.keys() == side_by_side.values.keys()
    for name, values in alone.values.items():
        assert side_by_side.values[name] == pytest.approx(values, rel=1e-5, abs=1e-12)
    assert side_by_side.losses == {part: pytest.approx(loss, abs=1e-5) for part, loss in alone.losses.items()}


def test_a_cause_that_is_no_candidate_is_not_sought(tmp_path: Path) -> None:
    """The search varies all of its causes together, so that none of them may be left out."""
    drawn = _nominal("near-two", 1)
    spoilt = replace(drawn.bench, beam=Beam(RADIUS_PX, 2.0, (2.0, -4.0)), stroke_m=drawn.bench.stroke_m * STROKE)
    captures, candidates = _captures(replace(drawn, bench=spoilt), tmp_path), list(listed_effects())
    assert window_for_light(captures, candidates) is not None
    for missing in ("distance", "gap", "slm_alignment", "beam", "stroke"):
        assert window_for_light(captures, [name for name in candidates if name != missing]) is None


def test_a_near_field_without_faults_needs_no_such_search(tmp_path: Path) -> None:
    """The nominal bench predicts the pictures."""
    captures = _captures(_nominal("near", 1), tmp_path)
    assert window_for_light(captures, list(listed_effects())) is None


@pytest.mark.parametrize("kind", explored(["near", "near-two"], 1))
def test_brightness_tells_the_beam_of_a_larger_field(kind: str, tmp_path: Path) -> None:
    """Whatever the stroke and the wavefront are, which move light by less than the cells of 16 pixels."""
    radius_px, centre_px = 40.0, (5.0, -8.0)
    drawn = _nominal(kind, 1, (96, 128))
    beam = Beam(radius_px, 2.0, centre_px)
    stroke_m = drawn.bench.stroke_m * STROKE
    spoilt = replace(drawn.bench, beam=beam, wave=WAVE, wave_radius_px=radius_px, stroke_m=stroke_m)
    captures = _captures(replace(drawn, bench=spoilt), tmp_path)
    beam_found = near_beam(captures)
    assert beam_found is not None and beam_found.explained > 0.5
    shape = beam_found.shape
    found_px = np.array([math.exp(-shape["log_size"]), shape["centre_y"], shape["centre_x"]]) * 64
    np.testing.assert_allclose(found_px, [radius_px, *centre_px], atol=0.15 * radius_px)


@pytest.mark.parametrize("kind", explored(["near", "near-two"], 1))
def test_even_light_has_no_beam(kind: str, tmp_path: Path) -> None:
    """Though nothing else is as assumed."""
    drawn = _nominal(kind, 1, (96, 128))
    bench = replace(drawn.bench, wave=WAVE, wave_radius_px=64.0, stroke_m=drawn.bench.stroke_m * STROKE)
    captures = _captures(replace(drawn, bench=bench), tmp_path)
    found = near_beam(captures)
    assert found is not None and found.explained == 0


def test_a_beam_is_found_exactly_where_brightness_shows_nothing_else() -> None:
    y, x = np.linspace(-0.75, 0.75, 25), np.linspace(-1, 1, 33)
    even = np.random.default_rng(0).uniform(0.5, 1.5, (2, 25, 33))
    square = ((y[:, None] + 0.2) ** 2 + (x - 0.3) ** 2) / 0.45**2
    measured = 3 * even * np.exp(-2 * square**1.7) + 0.2
    measured[0, 3, 4] = np.nan
    told = beam_of_brightness(measured, even, y, x)
    beam = told.beam
    np.testing.assert_allclose([beam.radius, beam.edge, *beam.centre], [0.45, 1.7, -0.2, 0.3], atol=2e-3)
    assert told.explained > 0.9999 and told.stray == pytest.approx(0.2, abs=1e-3) and told.without_stray > 100
    noise = np.random.default_rng(1).normal(0, 0.05, even.shape)
    assert beam_of_brightness(even + noise, even, y, x).explained < 0.1  # of 400 held cells a chance to gain 4/400
    alone = beam_of_brightness(measured - 0.2 + noise, even, y, x)
    assert alone.without_stray < 1.1  # a constant that isn't there gains as little
