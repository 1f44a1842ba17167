"""The simulator of drawn benches and the predictor, two programs, agree where both describe the same bench."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import plain_light
from benchmarks.plain_light import Beam, Bench, smooth_levels, zernike
from holoview.bench.captures import Captures
from holoview.bench.captures.dataset import Camera, SlmSpec
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.bench_parts import Relay
from holoview.light.numerics.sampling import AREA

λ, PITCH_M, SHAPE = 532e-9, 8e-6, (24, 32)


def _captures(bench: Bench, levels: list[np.ndarray]) -> Captures:
    far = bench.focal_length_m is not None
    return Captures(
        levels=np.stack(levels)[None],
        images=np.full((1, *bench.camera), 99, np.uint16),
        wavelength_m=np.array([λ]),
        distance_m=np.array([bench.distance_m]),
        power=np.ones(1),
        exposure_s=np.ones(1),
        slms=(SlmSpec(bench.pitch_m, bench.num_levels, bench.stroke_m),) * len(levels),
        camera=Camera(bench.camera_pitch_m, 8, 10.0, 8.0, 0.0),
        gap_m=bench.gap_m,
        relay1=Relay(iris_na=bench.iris if bench.gap_m else None),
        relay2=Relay() if far else Relay(iris_na=bench.iris),
        focal_length_m=bench.focal_length_m,
        axis_m=tuple(a * bench.camera_pitch_m for a in bench.axis_px) if far else (0.0, 0.0),
    )


def _difference(one: np.ndarray, other: np.ndarray) -> float:
    """Relative, root mean square, with the factor between both left free."""
    other = other * (one * other).sum() / (other * other).sum()
    return float(np.linalg.norm(one - other) / np.linalg.norm(one))


FAR = Bench(SHAPE, (40, 52), PITCH_M, 4e-6, λ, focal_length_m=4e-3, axis_px=(3.3, -6.2))


@pytest.mark.parametrize(
    ("faults", "effects"),
    [
        ({}, {}),
        ({"stroke_m": 1.3 * λ}, {}),
        ({"unmodulated": 0.2}, {"undiffracted": {"share": 0.2}}),
        (
            {"tilt": (0.02, -0.01)},
            {"tilt": {"tilt_y": math.asin(0.02 * λ / 8e-6), "tilt_x": -math.asin(0.01 * λ / 8e-6)}},
        ),
    ],
)
def test_the_far_field_is_the_predictor_s(faults: dict, effects: dict) -> None:
    """Light that is constant over a pixel: both sum the pixels' transforms exactly. A camera pixel holds half a grain,
    and both average its area: the predictor with 3 places, whose mean of the finest structure errs by 0.0005. Tilted
    light goes on within a pixel; on parts of half a pixel it is taken as constant, so that sinc(k/2) stands for
    sinc((k − s)/2): with s = 0.02 turns a pixel and k ≤ 0.4 a change of at most s/2·|sinc'/sinc|(0.2) = 0.01·0.68."""
    bench = replace(FAR, **faults)
    levels = [smooth_levels(np.random.default_rng(3), SHAPE, 1.0)]
    predicted = Predictor(_captures(bench, levels), double_precision=True, points=AREA)([0], effects)
    tolerance = 0.01 if "tilt" in faults else 0.0005
    assert _difference(bench.picture(levels, λ), predicted.signal[0].numpy()) < tolerance


@pytest.mark.parametrize("gap_m", [None, 0.4e-3])
def test_the_near_field_is_the_predictor_s(gap_m: float | None) -> None:
    """Both cut at the iris, whose edge lies on other frequencies of each grid. What is in or out is a share of about
    1/(π·NA·width/λ) = 4 % of the band's light by area, of which pixels that are smooth over 2 pixels send little to the
    edge: from grid to grid of the predictor alone the picture changes by 0.3 to 0.7 %."""
    bench = Bench(SHAPE, tuple(2 * n for n in SHAPE), PITCH_M, 4e-6, λ, distance_m=1.5e-3, gap_m=gap_m)
    rng = np.random.default_rng(4)
    levels = [smooth_levels(rng, SHAPE, 2.0) for _ in range(2 if gap_m else 1)]
    predictor = Predictor(_captures(bench, levels), double_precision=True, finer=2, padding=4, points=AREA)
    assert _difference(bench.picture(levels, λ), predictor([0]).signal[0].numpy()) < 0.02


def test_zernike_terms_are_orthonormal_over_the_disc() -> None:
    """The mean of products over a disc of 10⁴ squares, whose edge leaves about 1/√N of the disc uncertain."""
    at = (np.arange(200) + 0.5) / 100 - 1
    y, x = at[:, None], at[None, :]
    inside = y**2 + x**2 <= 1
    terms = [zernike(n, m, y, x)[inside] for n, m in ((2, 0), (2, 2), (2, -2), (3, 1), (3, -1), (3, 3), (4, 0))]
    products = np.array([[np.mean(a * b) for b in terms] for a in terms])
    np.testing.assert_allclose(products, np.eye(len(terms)), atol=0.03)


def test_a_gaussian_beam_makes_a_gaussian_focus() -> None:
    """exp(−r²/w²) becomes exp(−2(πwk)²) in intensity, k periods a pixel, times the envelope of half pixels; beyond the
    modulator's edge lies e^−(12/3)² = 10⁻⁷ of the amplitude. A camera pixel is the mean of eight hundred points."""
    bench = replace(FAR, shape=(24, 24), beam=Beam(3.0), axis_px=(0.0, 0.0), camera_pitch_m=1e-6, camera=(41, 41))
    light = bench.picture([np.zeros((24, 24), np.uint8)], λ)
    step = 1e-6 * PITCH_M / (λ * 4e-3)
    k = (np.arange(41)[:, None] - 20 + (np.arange(800) + 0.5) / 800 - 0.5) * step
    expected = (np.exp(-2 * (np.pi * 3 * k) ** 2) * np.sinc(k / plain_light.PARTS) ** 2).mean(axis=1)
    assert _difference(light[20], expected) < 1e-6
