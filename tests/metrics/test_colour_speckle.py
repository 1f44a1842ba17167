"""Colour speckle: closed forms and draws of independent lasers, and Jzazbz beside colour-science."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.holograms.metrics.colour_speckle import (
    DRAWN,
    INSIDE_95,
    colour_speckle,
    ellipse_area,
    independent_colours,
    independent_covariance,
    jzazbz,
    uv_prime,
)
from holoview.holograms.metrics.grains import PixelNoise
from holoview.holograms.metrics.speckle_measurement import LaserImages, SpeckleMeasurement, measure_speckle
from holoview.light.colour import D65_WHITE, SRGB_TO_XYZ, import_colour_science, observer_weights

LASERS_NM = (450.0, 532.0, 638.0)


def _laser_xyz() -> np.ndarray:
    """Mean XYZ of three lasers that mix to white."""
    weights = observer_weights("eye", np.array(LASERS_NM) * 1e-9)
    return np.linalg.solve(weights.T, D65_WHITE)[:, None] * weights


@pytest.mark.parametrize("contrasts", [(0.02, 0.02, 0.02), (0.03, 0.01, 0.02)])
def test_the_covariance_of_independent_lasers_is_that_of_100_000_drawn_samples(
    contrasts: tuple[float, float, float],
) -> None:
    """A sample variance of n has the relative deviation √(2/n) = 0.45 %, a covariance about as much of √(σσ).

    Second order in C: the fourth power over the square, about 10·C² = 1 % at 3 %.
    """
    found = colour_speckle(independent_colours(_laser_xyz(), contrasts))
    assert found is not None
    known = independent_covariance(_laser_xyz(), contrasts)
    scale = np.sqrt(np.outer(np.diag(known), np.diag(known)))
    tolerance = 5 * np.sqrt(2 / DRAWN) + 10 * max(contrasts) ** 2
    assert np.abs(found.covariance_uv - known).max() <= tolerance * scale.max()
    assert np.all(np.abs(np.diag(found.covariance_uv) / np.diag(known) - 1) < tolerance)
    assert found.area == pytest.approx(ellipse_area(known), rel=2 * tolerance)
    # the mean moves by second order only, and by the deviation of a mean
    assert np.abs(found.mean_uv - uv_prime(D65_WHITE)).max() < 5 * np.sqrt(known.max() / DRAWN) + max(contrasts) ** 2


def test_drawn_lasers_have_their_contrasts_and_stay_independent() -> None:
    """Gamma laws of contrasts 1, 1/2 and 0; the error of a contrast is C·√((1 + C²)/2n)."""
    contrasts = np.array([1.0, 0.5, 0.0])
    drawn = independent_colours(np.eye(3), contrasts)
    measured = drawn.std(axis=0) / drawn.mean(axis=0)
    errors = contrasts * np.sqrt((1 + contrasts**2) / (2 * DRAWN))
    assert (np.abs(measured - contrasts) <= 5 * errors).all()
    assert abs(np.corrcoef(drawn[:, 0], drawn[:, 1])[0, 1]) < 5 / np.sqrt(DRAWN)


def test_the_ellipse_holds_95_per_cent_of_a_normal_law() -> None:
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    drawn = np.random.default_rng(0).multivariate_normal([0, 0], covariance, 100_000)
    inside = np.einsum("ni,ij,nj->n", drawn, np.linalg.inv(covariance), drawn) <= INSIDE_95
    assert inside.mean() == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / 1e5))
    assert ellipse_area(covariance) == pytest.approx(np.pi * 5.991 * np.sqrt(7.0), rel=1e-4)


def test_white_has_its_chromaticity_and_light_of_one_colour_does_not_scatter() -> None:
    assert uv_prime(D65_WHITE) == pytest.approx([0.1978, 0.4683], abs=5e-5)  # CIE 15
    found = colour_speckle(np.random.default_rng(0).exponential(size=(500, 1)) * D65_WHITE, grains=100)
    assert found is not None and found.area < 1e-12 and found.jzazbz_scatter > 0.01  # lightness scatters
    assert colour_speckle(np.zeros((10, 3))) is None


@pytest.mark.parametrize("count", [2, 4, 1000])
def test_two_lasers_scatter_along_a_line_that_has_no_area(count: int) -> None:
    """Rounding leaves a covariance that may be singular or not; the area, and its error, are none either way."""
    for seed in range(20):
        light = np.random.default_rng(seed).exponential(size=(count, 2)) @ _laser_xyz()[:2]
        found = colour_speckle(light, grains=count)
        assert found is not None and np.trace(found.covariance_uv) > 0
        assert found.area == 0 and found.area_error is not None and 0 <= found.area_error < 1e-7


def test_the_area_of_few_grains_is_as_uncertain_as_said() -> None:
    """The relative deviation of √det of a covariance of n samples is 1/√n: 400 draws know it to 3.5 %, of which 5."""
    rng, n = np.random.default_rng(1), 200
    areas = [ellipse_area(np.cov(rng.normal(size=(2, n)))) for _ in range(400)]
    assert np.std(areas) / np.mean(areas) == pytest.approx(1 / np.sqrt(n), rel=5 / np.sqrt(800))


def test_jzazbz_is_that_of_colour_science() -> None:
    """Its constants are printed to eight digits; both compute in double precision."""
    colour = import_colour_science()
    xyz = np.random.default_rng(2).uniform(0.01, 100, (50, 3)) * D65_WHITE
    assert np.allclose(jzazbz(xyz), colour.XYZ_to_Jzazbz(xyz), rtol=1e-7, atol=1e-9)


def _colour_camera(light: np.ndarray, noise: PixelNoise | None = None) -> SpeckleMeasurement:
    """What is measured of counts (channel, y, x) of a camera whose channels are those of sRGB."""
    names = ("red", "green", "blue")
    channels = LaserImages(names, names, SRGB_TO_XYZ.T, light, noise=noise)
    return measure_speckle(np.tensordot(SRGB_TO_XYZ[1], light, axes=1), (0, 0, *light.shape[:0:-1]), None, channels)


def _electrons(light: np.ndarray, noise: PixelNoise, rng: np.random.Generator) -> np.ndarray:
    """Counts of a camera of this gain and read noise: Poisson's law and a normal one."""
    gain = noise.electrons_per_count
    assert gain is not None
    return rng.poisson(light * gain) / gain + rng.normal(0, noise.read_noise_counts, light.shape)


@pytest.mark.parametrize(("shape", "counts"), [(16.0, 400.0), (4.0, 200.0), (64.0, 200.0)])
def test_a_camera_s_noise_is_no_colour_speckle(shape: float, counts: float) -> None:
    """Each of 12 drawn pictures beside the same light without noise, whose scatter numpy tells.

    The mean of the differences is zero within 5 of its own standard errors, and within what the third order in
    noise over light leaves: (σ/s)² of what the noise adds, at the mean light of the darkest channel.
    """
    noise, rng, side = PixelNoise(1.0, 3.0), np.random.default_rng(5), 64
    differences, areas = [], []
    for _ in range(12):
        light = counts * np.array([0.5, 1.0, 0.6])[:, None, None] * rng.gamma(shape, 1 / shape, (3, side, side))
        true = np.cov(uv_prime(light.reshape(3, -1).T @ SRGB_TO_XYZ.T).T, bias=True)
        found = _colour_camera(_electrons(light, noise, rng), noise).colour
        assert found is not None and found.area_error is not None and found.noise_share > 0.01
        scale = np.sqrt(np.outer(np.diag(true), np.diag(true)))
        differences.append((found.covariance_uv - true) / scale)
        areas.append(found.area / ellipse_area(true) - 1)
        assert abs(areas[-1]) < 5 * found.area_error / found.area
    raw = _colour_camera(_electrons(light, noise, rng)).colour
    assert raw is not None
    darkest, added = 0.5 * counts, raw.area / ellipse_area(true) - 1
    third_order = added * (darkest + 9) / darkest**2
    for values in (np.array(differences), np.array(areas)):
        errors = values.std(axis=0, ddof=1) / np.sqrt(len(values))
        assert np.all(np.abs(values.mean(axis=0)) < 5 * errors + third_order)
    assert added > 0.015  # with the noise, at least 3 times what is allowed


def test_noise_that_hides_the_colour_speckle_is_said() -> None:
    rng, noise = np.random.default_rng(6), PixelNoise(1.0, 3.0)
    found = _colour_camera(_electrons(np.full((3, 64, 64), 200.0), noise, rng), noise)
    assert found.colour is None
    assert any("the camera's noise hides the colour speckle" in note for note in found.notes)
