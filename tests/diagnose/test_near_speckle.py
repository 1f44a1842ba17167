"""Large faults together on near fields of an independent program: speckle finds their light too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.plain_light import Beam
from benchmarks.real_benches import Drawn, draw, measure
from holoview.bench.captures.capture_file import read_captures
from holoview.bench.captures.dataset import Captures
from holoview.bench.diagnose.speckle_evidence import light_by_speckle, window_for_light
from holoview.light.model.effects.registry import listed_effects
from holoview.util.progress import no_progress
from tests.explored import explored

RADIUS_PX, STROKE, HALF_PX = 15.0, 0.7, 32.0
WAVE = {(2, 2): 0.5, (3, 1): 0.6, (3, -1): -0.5}  # rad r.m.s.: astigmatism and both comas


def _captures(drawn: Drawn, folder: Path) -> Captures:
    return read_captures(measure(drawn, folder, 3).with_suffix(".h5"))


def _nominal(kind: str, lines: int) -> Drawn:
    """Two pictures by 64 × 48 pixels of a bench without faults."""
    drawn = draw(5, "none", kind, 64)
    wavelength_m = drawn.wavelengths_m[0]
    shape = (48, 64)
    bench = replace(drawn.bench, shape=shape, camera=(72, 96))
    return replace(drawn, bench=bench, pictures=2, wavelengths_m=(wavelength_m, wavelength_m + 60e-9)[:lines])


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
    assert window is not None and np.array_equal(window.images, captures.images)  # near fields as they are
    light = light_by_speckle(window, no_progress)
    assert light is not None and light.before < 0.6 and light.after > 0.95
    assert HALF_PX / light.values["beam"]["size"] == pytest.approx(RADIUS_PX, rel=0.2)
    assert 1 + light.values["stroke"]["stroke_error"] == pytest.approx(STROKE, rel=0.1)


def test_a_near_field_without_faults_needs_no_such_search(tmp_path: Path) -> None:
    """The nominal bench predicts the pictures."""
    captures = _captures(_nominal("near", 1), tmp_path)
    assert window_for_light(captures, list(listed_effects())) is None
