"""Large faults together, on pictures of an independent program: speckle finds the light where least squares can't."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.plain_light import Beam, Bench, Sensor, hologram_levels
from benchmarks.real_benches import draw, measure
from holoview.bench.captures.capture_file import read_captures
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.picture_import import KnownBench, PictureAndPattern, import_pictures
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.speckle_measure import window_of
from holoview.bench.diagnose import pipeline, speckle_search
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.speckle_evidence import _PART_PX, light_by_speckle, window_for_light
from holoview.bench.diagnose.speckle_light import NOMINAL, NOMINAL_LENGTHS, Circle, Pictures
from holoview.bench.diagnose.speckle_search import FoundLight
from holoview.light.model.effects.registry import listed_effects
from holoview.util.progress import no_progress
from tests.captures.far_field import CAMERA_PITCH_M, PITCH_M, WAVELENGTH_M, FarField, photograph, spread_pattern
from tests.explored import explored

HALF_PX = 64.0  # of the modulator's longer side


def _captures(bench: FarField, seed: int, pictures: int = 1) -> Captures:
    patterns = [spread_pattern(seed + number) for number in range(pictures)]
    shown = [
        PictureAndPattern(photograph(pattern, bench, seed + 50), pattern, f"{k}", f"{k}")
        for k, pattern in enumerate(patterns)
    ]
    return import_pictures(shown, KnownBench(WAVELENGTH_M, PITCH_M, CAMERA_PITCH_M, 0.25)).captures


@pytest.mark.explores
@pytest.mark.parametrize(("pictures", "unmodulated"), [(1, 0.0), (2, 0.0), (2, 0.2)])
def test_a_disc_with_coma_and_half_the_stroke_is_named_and_measured(pictures: int, unmodulated: float) -> None:
    """Coma a·(3ρ³ − 2ρ)·cos is a/√8 r.m.s., which is Noll's z8. The edge exp(−ρ⁸) is at ρ = 1 where the beam's is.
    Unmodulated light is named where there is some; a single picture hides it in its saturated zero order."""
    bench = FarField(unmodulated=unmodulated)
    found = diagnose(_captures(bench, 20, pictures), free_maps=False)
    causes = {cause.effect: found.values[cause.effect] for cause in found.causes}
    assert {"beam", "stroke"} <= set(causes)
    assert not {"camera_blur", "source_extent", "bandwidth", "motion_blur"} & set(causes)
    assert ("undiffracted" in causes) == (unmodulated > 0)
    assert HALF_PX / causes["beam"]["size"] == pytest.approx(bench.radius, rel=0.1)
    assert 1 + causes["stroke"]["stroke_error"] == pytest.approx(bench.stroke, rel=0.1)
    wanted = bench.coma / math.sqrt(8) * WAVELENGTH_M / (2 * math.pi)
    assert causes["beam"]["z8"] == pytest.approx(wanted, rel=0.25)
    assert found.speckle.before < 0.6 and found.speckle.after > found.speckle.before + 0.2
    assert found.speckle.significance > 5


@pytest.mark.explores
@pytest.mark.parametrize(("stroke", "radius"), [(0.6, 1e3), (1.0, 40.0)])
def test_what_was_estimated_of_a_picture_is_put_right_and_not_named(stroke: float, radius: float) -> None:
    """Nobody stated the black level, nor where the axis is: what differs from their estimates is no fault."""
    found = diagnose(_captures(FarField(coma=0.0, defocus=0.0, stroke=stroke, radius=radius), 20), free_maps=False)
    assert [cause.effect for cause in found.causes] == ["stroke" if stroke < 1 else "beam"]
    assert {*found.known} <= {"camera_black", "camera_alignment"}
    said = [note for note in found.notes if note.startswith("Known effects were corrected within")]
    assert bool(found.known) == bool(said)


@pytest.mark.long
@pytest.mark.parametrize("radians", explored([0.0, 0.9], 1))
def test_light_beside_the_middle_is_found_with_its_wavefront_where_a_retrieval_finds_none(
    radians: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A beam of 15 of 64 pixels, off the middle by its radius, with as much defocus as coma along both axes: 1.6 rad
    r.m.s. together, from which ascents from even phases are too far."""
    nothing = speckle_search._Leader(0.0, NOMINAL, Circle(0.5), NOMINAL_LENGTHS)
    monkeypatch.setattr(speckle_search, "_from_retrieved", lambda task: nothing)
    drawn = draw(5, "none", "fourier", 64)
    beam = Beam(15.0, 2.0, (8.0, -13.0))
    wave = {(2, 0): -radians, (3, 1): -radians, (3, -1): radians}
    spoilt = replace(drawn.bench, shape=(48, 64), beam=beam, wave=wave, wave_radius_px=15.0)
    measured = replace(drawn, bench=replace(spoilt, stroke_m=0.75 * drawn.bench.stroke_m), pictures=3)
    captures = read_captures(measure(measured, tmp_path, 3).with_suffix(".h5"))
    window = window_for_light(captures, list(listed_effects()))
    assert window is not None
    light = light_by_speckle(window, no_progress, lambda text: None)
    assert light is not None and light.after > 0.8  # the ascent may not have ended
    assert 32 / light.values["beam"]["size"] == pytest.approx(15.0, rel=0.3)
    places = [light.values["beam"][f"centre_{axis}"] * 32 for axis in "yx"]
    assert places == pytest.approx([8.0, -13.0], abs=5.0)  # a third of the radius


@pytest.mark.long
@pytest.mark.parametrize("speckle", [0.95, 0.85])
def test_a_decisive_cause_is_named_beside_light_whose_speckle_stands(
    speckle: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The room's light beside a disc and a stroke in one picture. Where speckle stands less well, the light isn't right
    yet, and nothing is sought beside it."""
    drawn = draw(5, "none", "fourier", 64)
    spoilt = replace(drawn.bench, beam=Beam(14.0, 8.0, (3.0, -5.0)), stroke_m=0.7 * drawn.bench.stroke_m)
    room = replace(drawn.sensor, stray=(12.0, 5.0, -5.0))
    measured = measure(replace(drawn, bench=spoilt, sensor=room, pictures=1), tmp_path, 3)
    shape = {"size": 32 / 14, "edge": 4.0, "centre_y": 3 / 32, "centre_x": -5 / 32}
    light = FoundLight({"beam": shape, "stroke": {"stroke_error": -0.3}}, 0.3, speckle, {})
    monkeypatch.setattr(pipeline, "light_by_speckle", lambda *args: light)
    found = diagnose(read_captures(measured.with_suffix(".h5")), free_maps=False)
    named = {cause.effect for cause in found.causes}
    assert named == {"beam", "stroke", "ambient"} if speckle > 0.9 else "ambient" not in named
    assert (found.verdict in (Verdict.EXPLAINED, Verdict.AMBIGUOUS)) == (speckle > 0.9)


def _on_a_large_modulator() -> Captures:
    """One picture of 8 bits as a real bench took it: a beam of 0.43 of half the rows near the middle, with 3 rad r.m.s.
    of coma, half the stroke, a saturated zero order, gain and axis unknown."""
    rng, shape, focal_m, radius = np.random.default_rng(1), (384, 512), 0.3146, 82.6
    beam, wave = Beam(radius, 8.0, (7.4, -5.9)), {(3, 1): -3.1, (3, -1): 0.35, (4, 0): 0.2, (2, 0): -0.5}
    bench = Bench(shape, (556, 730), 36e-6, 5.86e-6, 0.513 * WAVELENGTH_M, beam=beam, wave=wave, wave_radius_px=radius)
    pattern = hologram_levels(rng, shape, "blobs")
    light = replace(bench, focal_length_m=focal_m, axis_px=(20.3, -31.6)).picture([pattern], WAVELENGTH_M)
    counts = Sensor(electrons=10.0).counts(rng, light * 251 / np.quantile(light, 0.99)).astype(np.uint8)
    known = KnownBench(WAVELENGTH_M, bench.pitch_m, bench.camera_pitch_m, focal_m)
    return import_pictures([PictureAndPattern(counts, pattern, "picture", "pattern")], known).captures


@pytest.mark.long
@pytest.mark.parametrize("radius", [25.0, 40.0, None])
def test_places_all_over_the_modulator_do_not_crowd_out_its_middle(
    radius: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a beam in the middle the search ends no lower than from beams in the middle alone. On a large modulator these
    lead to the light, and of the many places some score higher by chance."""
    captures = _on_a_large_modulator() if radius is None else _captures(FarField(radius=radius), 3)
    pictures = Pictures(prepare_captures(window_of(captures, _PART_PX)))
    task = speckle_search._Task(pictures, {}, lambda number: None)
    found, beams = speckle_search._from_simple_beams(task), speckle_search._start_beams
    middle = [beam for beam in beams(pictures, speckle_search._START_SIZES) if not any(beam.centre)]
    monkeypatch.setattr(speckle_search, "_start_beams", lambda part, sizes: middle)
    alone = speckle_search._from_simple_beams(task)
    assert (radius is None or alone.score > 0.3) and found.score >= alone.score


@pytest.mark.explores
def test_pictures_that_another_pattern_made_have_no_such_light() -> None:
    """The captures' own patterns were never shown: no light makes their speckle stand, and none is named."""
    captures = _captures(FarField(coma=-0.3, defocus=0.1), 30)
    levels = captures.levels.copy()
    levels[0, 0] = spread_pattern(77).astype(levels.dtype)
    wrong = Captures(**{name: getattr(captures, name) for name in captures.__dataclass_fields__} | {"levels": levels})
    window = window_for_light(wrong, list(listed_effects()))
    assert window is not None and light_by_speckle(window, no_progress, lambda text: None) is None


@pytest.mark.long
def test_a_bench_that_is_right_needs_no_such_search() -> None:
    """Even light that fills the modulator, a full turn: the speckle stands; errors of estimates leave the rest."""
    captures = _captures(FarField(radius=1e3, coma=0.0, defocus=0.0, stroke=1.0), 40)
    window = window_for_light(captures, list(listed_effects()))
    assert window is None or not window.is_first
    found = diagnose(captures, free_maps=False)
    assert not found.causes and not any("sought by speckle" in note for note in found.notes)


@pytest.mark.long
def test_a_search_that_is_asked_to_end_says_so() -> None:
    """The second question is answered with yes, long before the light is found."""
    asked = iter([False])
    found = diagnose(_captures(FarField(), 20), free_maps=False, is_asked_to_end=lambda: next(asked, True))
    assert any("search by speckle was ended" in note for note in found.notes)
    assert not found.causes
