"""Captures of several lasers with equal patterns: the contrast of their sum, against drawn speckle of known laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import holoview as hv
from holoview.bench.captures.capture_speckle import TogetherContrast, capture_noise, capture_sets, measure_set
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.holograms.metrics.colour_speckle import uv_prime
from holoview.light.colour import observer_weights

EXPOSURES = np.array([1.0, 0.5, 2.0])
MEANS = np.array([400.0, 500.0, 300.0])  # counts above black of each laser
REGION = (0, 0, 96, 64)


@pytest.fixture(scope="module")
def blank() -> Captures:
    """Captures of three lasers, of one pattern each."""
    system = hv.load("simultaneous").edit({"shape": [32, 48], "planes": ["10 mm"]})
    return make_captures(system, settings=AcquisitionSettings(captures_per_condition=1, blur_sigmas_px=(0.0,)))


def drawn(blank: Captures, seed: int, sets: int, *, shared: float) -> Captures:
    """`sets` sets of captures of exponential speckle, one grain a pixel; shared: part of the patterns that all lasers
    have. With photon noise and read noise of the camera."""
    random, camera = np.random.default_rng(seed), blank.camera
    images, levels, order = [], [], np.argsort(blank.wavelength_m)
    shape = blank.images.shape[1:]
    for number in range(sets):
        common = random.normal(size=(2, *shape))
        for mean in MEANS:
            own = random.normal(size=(2, *shape))
            field = np.sqrt(shared) * common + np.sqrt(1 - shared) * own
            electrons = random.poisson(0.5 * mean * np.square(field).sum(axis=0) * camera.electrons_per_count)
            read = camera.read_noise * random.normal(size=shape)
            images.append((electrons + read) / camera.electrons_per_count + camera.black_level)
            levels.append(np.full(blank.levels.shape[1:], number, blank.levels.dtype))
    counts = np.clip(np.rint(images), 0, camera.saturation).astype(np.uint16)

    def repeated(values: np.ndarray) -> np.ndarray:
        return np.tile(values[order], sets)

    return replace(
        blank,
        images=counts,
        levels=np.array(levels),
        wavelength_m=repeated(blank.wavelength_m),
        distance_m=repeated(blank.distance_m),
        power=repeated(blank.power),
        exposure_s=np.tile(EXPOSURES * 1e-3, sets),
    )


def together(captures: Captures) -> TogetherContrast:
    noise, _ = capture_noise(captures)
    return TogetherContrast.of([measure_set(captures, one, REGION, noise) for one in capture_sets(captures)])


@pytest.mark.parametrize("shared", [0.0, 0.5, 1.0])
def test_the_contrast_of_the_sum_is_that_of_its_law(blank: Captures, shared: float) -> None:
    """Intensities of fields with correlation ρ have correlation ρ²: C² = Σ_ij s_i·s_j·r_ij, s the shares of luminance
    for equal exposures; r_ij = shared² for i ≠ j."""
    captures = drawn(blank, 1, 4, shared=shared)
    sets = together(captures)
    found, count = sets.found, 4 * 96 * 64
    wavelengths_m = np.sort(np.unique(captures.wavelength_m))
    luminance = observer_weights("eye", wavelengths_m)[:, 1] * MEANS / EXPOSURES
    shares = luminance / luminance.sum()
    correlation = np.full((3, 3), shared**2) + (1 - shared**2) * np.eye(3)
    expected = float(np.sqrt(shares @ correlation @ shares))
    assert sets.count == 4 and sets.left_out == 0
    # 5 standard errors of C, of 4 · 6144 pixels: less than C/√(2n) of an exponential law times 2 for its long tail.
    assert found.luminance.contrast == pytest.approx(expected, abs=5 * 2 * expected / np.sqrt(2 * count))
    independent = float(np.linalg.norm(shares))
    assert found.one_by_one == pytest.approx(independent, abs=5 * 2 / np.sqrt(2 * count))
    assert found.patterns_of_powers == pytest.approx(1 / independent**2, rel=0.05)
    assert found.patterns_of_correlation == pytest.approx(1 / expected**2, rel=0.1)
    # a correlation of n pairs of exponential laws scatters by less than 2/√n
    assert np.allclose(found.correlation, correlation, atol=5 * 2 / np.sqrt(count))
    assert [laser.luminance_share for laser in found.lasers] == pytest.approx(shares.tolist(), abs=5 / np.sqrt(count))
    # each group is one laser, fully developed
    assert set(found.groups) == {"blue", "green", "red"}
    for group in found.groups.values():
        assert group.contrast == pytest.approx(1.0, abs=5 * 2 / np.sqrt(2 * count))
        assert 0 < group.standard_error < 5 * 2 / np.sqrt(2 * count)


def test_the_colours_of_a_sum_are_those_of_its_lasers(blank: Captures) -> None:
    """Their mean is that of independent exponential laws, which are drawn, where lasers share no pattern; where they
    share one, all pixels have one colour, that of the mean light."""
    captures = drawn(blank, 3, 4, shared=0.0)
    found = together(captures).found
    assert found.colour is not None and found.independent_colour is not None
    # the deviation of u' and v' is below 0.15, of their mean by 4 · 6144 pixels and 100 000 draws
    assert np.allclose(found.colour.mean_uv, found.independent_colour.mean_uv, atol=5 * 0.15 * (4 * 96 * 64) ** -0.5)
    ratio = found.colour.area / found.independent_colour.area
    assert ratio == pytest.approx(1.0, abs=5 * 3 * (4 * 96 * 64) ** -0.5)  # kurtosis below 9
    assert found.colour.area_error is not None and 0 < found.colour.area_error < 0.1 * found.colour.area
    one = together(drawn(blank, 4, 2, shared=1.0)).found
    wavelengths_m = np.sort(np.unique(captures.wavelength_m))
    colour = uv_prime((MEANS / EXPOSURES) @ observer_weights("eye", wavelengths_m))
    assert one.colour is None or (one.colour.area < 0.05 * found.colour.area)
    assert one.independent_colour is not None
    assert found.colour.mean_uv != pytest.approx(colour, abs=1e-3)  # chromaticity isn't linear in the light


def test_sets_of_other_lasers_are_left_out_and_counted(blank: Captures) -> None:
    captures = drawn(blank, 5, 3, shared=0.0)
    levels = captures.levels.copy()
    levels[4, 0, 0, 0] += 1
    found = together(replace(captures, levels=levels))
    assert (found.count, found.left_out) == (2, 1) and len(found.found.lasers) == 3
    assert found.as_json()["sets_of_other_lasers"] == 1


def test_an_observer_weighs_the_lasers(blank: Captures) -> None:
    captures = drawn(blank, 6, 1, shared=0.0)
    (chosen,) = capture_sets(captures)
    for observer in ("age 70, field 4", "cie1931"):
        found = measure_set(captures, chosen, REGION, None, observer)
        luminance = observer_weights(observer, np.sort(captures.wavelength_m))[:, 1]
        counts = [(captures.images[i] - captures.camera.black_level).mean() / captures.exposure_s[i] for i in chosen]
        shares = luminance * counts / (luminance @ counts)
        assert [laser.luminance_share for laser in found.lasers] == pytest.approx(shares.tolist(), rel=1e-6)


def test_only_captures_of_equal_patterns_and_distances_are_a_set(blank: Captures) -> None:
    captures = drawn(blank, 2, 2, shared=0.0)
    assert capture_sets(captures) == [[0, 1, 2], [3, 4, 5]]
    levels = captures.levels.copy()
    levels[4, 0, 0, 0] += 1
    assert capture_sets(replace(captures, levels=levels)) == [[0, 1, 2], [3, 5]]
    distance_m = captures.distance_m.copy()
    distance_m[0] += 1e-3
    assert capture_sets(replace(captures, distance_m=distance_m)) == [[1, 2], [3, 4, 5]]
    alone = np.arange(6)[:, None, None, None] + np.zeros_like(captures.levels)
    assert capture_sets(replace(captures, levels=alone)) == []
