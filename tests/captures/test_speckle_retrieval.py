"""Light on the modulator from a picture and its pattern, without a starting point."""

from __future__ import annotations

import math

import pytest
import torch

from holoview.bench.captures.picture_import import KnownBench, PictureAndPattern, import_pictures
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.speckle_retrieval import LightRetrieval, nearest_beam
from holoview.light.numerics.surfaces import zernike
from tests.captures.far_field import CAMERA_PITCH_M, PITCH_M, WAVELENGTH_M, FarField, photograph, spread_pattern

HALF_PX = 64.0  # of the modulator's longer side
TERMS = tuple(range(2, 12))


def test_the_beam_that_resembles_a_light_is_that_light() -> None:
    """Light that is a beam is found again: the phase of 2 rad r.m.s. and more has turns in it."""
    y, x = torch.linspace(-0.75, 0.75, 60), torch.linspace(-1, 1, 80)
    radius, centre, wave = 0.45, (0.1, -0.2), {2: 1.5, 4: -0.8, 8: 1.2, 9: 0.2}
    down, across = torch.meshgrid((y - centre[0]) / radius, (x - centre[1]) / radius, indexing="ij")
    distance, angle = torch.hypot(down, across), torch.atan2(down, across)
    phase = sum(size * zernike(noll, distance, angle) for noll, size in wave.items())
    found = nearest_beam(torch.polar(torch.exp(-(distance**4)), torch.as_tensor(phase)), y, x, TERMS)
    assert found.radius == pytest.approx(radius, rel=0.01)
    assert found.edge == pytest.approx(2.0, rel=0.05)
    assert found.centre == pytest.approx(centre, abs=0.01)
    # Differences are exact where neighbours differ by less than half a turn, which holds where there is light.
    assert found.terms == pytest.approx({noll: wave.get(noll, 0.0) for noll in TERMS}, abs=0.02)
    assert found.overlap == pytest.approx(1.0, abs=1e-3)


@pytest.mark.long
def test_light_is_retrieved_without_a_start() -> None:
    """Coma a·(3ρ³ − 2ρ)·cos is a/√8 r.m.s., which is Noll's z8. Nodes are 8.5 pixels apart, a fifth of the radius."""
    bench = FarField(radius=36.0)
    pattern = spread_pattern(3)
    captures = import_pictures(
        [PictureAndPattern(photograph(pattern, bench, 4), pattern)],
        KnownBench(WAVELENGTH_M, PITCH_M, CAMERA_PITCH_M, bench.focal_length_m),
    ).captures
    retrieval = LightRetrieval(prepare_captures(captures))
    found = retrieval.ascend(retrieval.start(0.7), 25)
    beam = retrieval.nearest_beam(found, TERMS)
    assert found.held_out > 0.6  # patterns that weren't shown leave 0.3
    assert found.stroke == pytest.approx(bench.stroke, rel=0.15)
    assert beam.radius * HALF_PX == pytest.approx(bench.radius, rel=0.2)
    assert beam.terms[8] == pytest.approx(bench.coma / math.sqrt(8), rel=0.35)
