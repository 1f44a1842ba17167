"""Figures of regions, lines and pixels on images whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.holograms.metrics.speckle import independent_pattern_count, laser_luminances
from holoview.light.colour import D65_WHITE, SRGB_TO_XYZ, observer_weights
from holoview.util.errors import UserError
from holoview.viewer.app.panels import gamut
from holoview.viewer.document.measurements import contrast_by_wavelength, line_profile, measure_region, sample_pixel
from tests.document.conftest import small_system

WHOLE = (0, 0, 256, 256)
CONTRAST_TOLERANCE = 0.02  # of 65 536 independent samples: σ of the contrast is below 1/√65 536 · 2


def _speckle(seed: int, patterns: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).gamma(patterns, 1 / patterns, (256, 256))


def test_a_region_of_even_speckle_has_its_contrast_and_mean() -> None:
    figures = measure_region(0.5 * _speckle(0)[..., None] * D65_WHITE, WHOLE)
    assert figures.contrast == pytest.approx(1.0, abs=CONTRAST_TOLERANCE)
    assert figures.mean == pytest.approx(0.5, rel=0.02) and figures.n_pixels == 256 * 256
    assert figures.psnr_db is None and figures.delta_e is None


def test_with_a_target_its_structure_is_divided_out_and_fidelity_is_known() -> None:
    target = np.ones((256, 256, 3)) * np.linspace(0.2, 0.8, 256)[:, None]
    error = 0.05 * np.sign(np.arange(256) % 2 - 0.5)
    xyz = (target + error[:, None]) @ SRGB_TO_XYZ.T
    figures = measure_region(xyz, WHOLE, target)
    assert figures.psnr_db == pytest.approx(20 * np.log10(1 / 0.05), abs=1e-6)
    assert figures.contrast < 0.5 * figures.raw_contrast
    assert figures.delta_e is not None and 1 < figures.delta_e < 10
    same = measure_region(target @ SRGB_TO_XYZ.T, WHOLE, target)
    assert same.delta_e == pytest.approx(0.0, abs=1e-6) and same.contrast == pytest.approx(0.0, abs=1e-6)


def test_a_black_target_falls_back_on_the_plain_contrast_and_a_wrong_shape_is_refused() -> None:
    xyz = _speckle(1)[..., None] * D65_WHITE
    black = measure_region(xyz, WHOLE, np.zeros((256, 256, 3)))
    assert black.contrast == black.raw_contrast
    with pytest.raises(UserError, match="target"):
        measure_region(xyz, WHOLE, np.zeros((4, 4, 3)))
    with pytest.raises(UserError, match="region"):
        measure_region(xyz, (250, 250, 20, 20))


def test_independent_lasers_lower_the_contrast_as_theory_says() -> None:
    system = small_system(observer="mono")
    stacks = [_speckle(10 + i) for i in range(3)]
    curve = contrast_by_wavelength(lambda i: stacks[i], system, WHOLE)
    assert curve.independent == pytest.approx(1 / np.sqrt([1, 2, 3]))
    assert curve.measured == pytest.approx(curve.independent, abs=CONTRAST_TOLERANCE)
    assert independent_pattern_count(system) == pytest.approx(3.0)
    equal = contrast_by_wavelength(lambda i: stacks[0], system, WHOLE)
    assert equal.measured == pytest.approx([equal.measured[0]] * 3), "one pattern in all lasers isn't averaged"


def test_the_brightest_laser_comes_first_and_those_that_are_off_not_at_all() -> None:
    system = small_system(amplitudes=[[1.0, 0.0, 1.0]])
    curve = contrast_by_wavelength(lambda i: _speckle(i), system, WHOLE)
    assert curve.wavelengths_m.tolist() == [638e-9, 460e-9]
    power = laser_luminances(small_system())
    assert power[0] == pytest.approx(observer_weights("eye", [460e-9, 532e-9, 638e-9])[:, 1])


def test_sources_and_frames_count_as_patterns() -> None:
    system = small_system(observer="mono", frames=2)
    assert independent_pattern_count(system) == pytest.approx(6.0)
    several = system.edit({"source.directions": [[0.0, 0.0], [0.0, 0.005]]})
    assert independent_pattern_count(several) == pytest.approx(12.0)


def test_a_profile_runs_along_its_line_in_metres() -> None:
    ramp = np.arange(20.0)[None, :] + np.zeros((10, 1))
    profile = line_profile(ramp, (2.0, 5.0, 12.0, 5.0), 4e-6)
    assert profile.values[:, 0] == pytest.approx(np.arange(2.0, 13.0))
    assert profile.distance_m == pytest.approx(np.arange(11) * 4e-6)
    slanted = line_profile(np.stack([ramp, -ramp], axis=-1), (0.0, 0.0, 4.0, 3.0), 1.0)
    assert slanted.distance_m[-1] == pytest.approx(5.0) and slanted.values[-1] == pytest.approx([4.0, -4.0])
    with pytest.raises(UserError, match="line"):
        line_profile(ramp, (0.0, 0.0, 20.0, 0.0), 1.0)


def test_pixels_have_values_inside_the_image_and_none_outside() -> None:
    xyz = np.zeros((4, 5, 3))
    xyz[1, 2] = D65_WHITE
    values = sample_pixel(2, 1, xyz, np.arange(40.0).reshape(2, 4, 5))
    assert values is not None and values.linear_rgb == pytest.approx([1.0, 1.0, 1.0])
    assert values.intensity is not None and values.intensity.tolist() == [7.0, 27.0]
    assert sample_pixel(5, 0, xyz) is None and sample_pixel(-1, 0, xyz) is None


def test_lasers_lie_on_the_horseshoe_and_span_a_polygon() -> None:
    shoe, points = gamut.spectral_locus(), gamut.laser_chromaticities(small_system())
    distances = np.linalg.norm(shoe[None] - points[:, None], axis=-1).min(axis=1)
    assert distances.max() < 0.01, "a 2 nm step of the horseshoe is shorter"
    assert len(gamut.laser_gamut(small_system())) == 3
    assert len(gamut.laser_gamut(small_system(amplitudes=[[1.0, 0.0, 1.0]]))) == 2


def test_the_cloud_leaves_black_out_and_is_bounded() -> None:
    xyz = np.zeros((50, 50, 3))
    xyz[:25] = D65_WHITE
    xy, colours = gamut.image_chromaticities(xyz, most=100)
    assert 50 < len(xy) <= 100 and np.allclose(xy, gamut.D65_XY) and (colours == 255).all()
