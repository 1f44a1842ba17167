"""Contrast of lasers, groups and their correlation; both ways of IEC 62906-5-4; instruments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from holoview.bench.captures.speckle_meter import CameraLens, Meter, measure_hologram, pixel_means
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.grains import ContrastEstimate, Grains
from holoview.holograms.metrics.speckle import laser_luminances
from holoview.holograms.metrics.speckle_measurement import (
    MOVING_THRESHOLDS,
    Visibility,
    images_of_lasers,
    measure_speckle,
    visibility,
)
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.light.model.eye import Eye
from holoview.util.errors import UserError
from holoview.viewer.document.measurements import measure_region

SIDE = 96
WHOLE = (0, 0, SIDE, SIDE)
Floats = NDArray[np.float64]


def _patterns(count: int, seed: int = 0) -> Floats:
    """Independent, fully developed patterns (count, y, x) of mean about 1, every sample a grain."""
    return np.random.default_rng(seed).exponential(size=(count, SIDE, SIDE))


def _images(intensity: Floats, wavelengths_nm: tuple[float, ...], luminances: tuple[float, ...] = ()) -> object:
    colours = np.ones((len(intensity), 3))
    colours[:, 1] = luminances or 1.0
    return images_of_lasers(np.array(wavelengths_nm) * 1e-9, colours, intensity)


def test_lasers_of_unequal_powers_count_as_fewer() -> None:
    """1 : 4 : 1 gives N_eff = 36/18 = 2; powers are means of 9 216 samples, within 1 %, which N_eff follows."""
    intensity = _patterns(3)
    lasers = _images(intensity, (450, 540, 640), (1.0, 4.0, 1.0))
    luminance = np.tensordot([1.0, 4.0, 1.0], intensity, axes=1)
    found = measure_speckle(luminance, WHOLE, lasers=lasers)  # type: ignore[arg-type]
    assert found.patterns_of_powers == pytest.approx(2.0, rel=0.03)
    # correlations scatter by 1/96: N_eff by 2·ΣΣ m·m·ρ/Σm², with weights (1·4 + 4·1 + 1·1)/18 each
    assert found.patterns_of_correlation == pytest.approx(2.0, rel=0.03 + 5 * 2 * np.sqrt(16 + 16 + 1) / 18 / SIDE)
    assert found.luminance.contrast == pytest.approx(2**-0.5, abs=5 * found.luminance.standard_error)
    assert found.one_by_one == pytest.approx(2**-0.5, abs=5 * found.one_by_one_error)
    assert set(found.groups) == {"blue", "green", "red"}
    assert [laser.name for laser in found.lasers] == ["450 nm", "540 nm", "640 nm"]


@pytest.mark.long
@pytest.mark.parametrize("is_structured", [False, True])
@pytest.mark.parametrize("shared", [0.0, 0.6])
def test_the_errors_of_n_eff_are_its_scatter(shared: float, is_structured: bool) -> None:
    """Powers 1 : 4 : 2, each laser's pattern a part of its own and one that all share, before and beside a target.

    60 drawn values scatter by their deviation to 1/√118 = 9 %, and 64 blocks know theirs to 9 % each, 1 % all together:
    within 1 ± 0.5 by five deviations. Grains of 3 samples in blocks of 12 make 5 % of it.
    """
    rng, powers, found, errors = np.random.default_rng(51), np.array([1.0, 4.0, 2.0]), [], []
    picture = (
        np.kron(rng.uniform(0.2, 1, (8, 8)), np.ones((SIDE // 8,) * 2)) if is_structured else np.ones((SIDE, SIDE))
    )
    target = np.repeat(picture[..., None], 3, axis=-1) if is_structured else None
    for _ in range(60):
        field = rng.normal(size=(2, 4, SIDE + 3, SIDE + 3))
        patterns = np.square(ndimage.uniform_filter(field, (0, 0, 3, 3))[..., :SIDE, :SIDE]).sum(axis=0) * 4.5
        intensity = picture * ((1 - shared) * patterns[:3] + shared * patterns[3])
        lasers = _images(intensity, (450, 540, 640), tuple(powers))
        one = measure_speckle(np.tensordot(powers, intensity, axes=1), WHOLE, target, lasers)  # type: ignore[arg-type]
        found.append((one.patterns_of_powers, one.patterns_of_correlation))
        errors.append(one.pattern_errors)
    ratio = np.std(found, axis=0, ddof=1) / np.sqrt(np.square(errors).mean(axis=0))
    assert ((ratio > 0.5) & (ratio < 1.5)).all()
    table = one.as_json()
    assert (table["n_eff_powers_standard_error"], table["n_eff_correlation_standard_error"]) == one.pattern_errors


def test_lasers_that_share_a_pattern_are_one_pattern_together_and_several_one_by_one() -> None:
    one = _patterns(1)
    intensity = np.concatenate([one, one, one, one])
    lasers = _images(intensity, (450, 500, 550, 600))
    found = measure_speckle(intensity.sum(axis=0), WHOLE, lasers=lasers)  # type: ignore[arg-type]
    assert found.luminance.contrast == pytest.approx(found.lasers[0].estimate.contrast, rel=1e-12)
    assert found.one_by_one == pytest.approx(found.luminance.contrast / 2, rel=1e-12)
    assert found.correlation == pytest.approx(np.ones((4, 4)), abs=1e-9)
    assert found.patterns_of_correlation == pytest.approx(1.0, rel=1e-9)
    assert found.patterns_of_powers == pytest.approx(4.0, rel=1e-12)


def test_the_contrast_together_follows_from_contrasts_and_correlations() -> None:
    """C² = ΣΣ m·m·C·C·ρ/(Σm)² holds for any patterns, to rounding."""
    shared = _patterns(1, 3)
    intensity = 0.4 * _patterns(5) + shared * np.linspace(0, 1, 5)[:, None, None]
    lasers = _images(intensity, (450, 480, 530, 590, 650), (0.2, 1, 2, 3, 0.5))
    luminance = np.tensordot([0.2, 1, 2, 3, 0.5], intensity, axes=1)
    found = measure_speckle(luminance, WHOLE, lasers=lasers)  # type: ignore[arg-type]
    terms = np.array([laser.luminance_share * laser.estimate.contrast for laser in found.lasers])
    assert found.luminance.contrast == pytest.approx(float(np.sqrt(terms @ found.correlation @ terms)), rel=1e-9)


def test_structure_of_a_coloured_target_is_divided_out_of_every_laser() -> None:
    """Lasers light a target of two colours, each its own mixture of the channels; their speckle stays, C = 1."""
    y, x = np.mgrid[:SIDE, :SIDE]
    target = np.stack([0.2 + 0.7 * (x // 16 % 2), 0.3 + 0.5 * (y / SIDE), np.full(x.shape, 0.5)], axis=-1)
    mixtures = np.array([[0.0, 0.1, 1.0], [0.1, 1.0, 0.1], [1.0, 0.2, 0.0]])
    intensity = _patterns(3) * np.moveaxis(target @ mixtures.T, -1, 0)
    lasers = _images(intensity, (450, 540, 640))
    found = measure_speckle(intensity.sum(axis=0), WHOLE, target, lasers)  # type: ignore[arg-type]
    for laser in found.lasers:
        assert laser.estimate.contrast == pytest.approx(1.0, abs=5 * laser.estimate.standard_error)
    raw = measure_speckle(intensity.sum(axis=0), WHOLE, None, lasers)  # type: ignore[arg-type]
    assert raw.lasers[2].estimate.contrast > 1.1 and not raw.has_target and found.has_target


def test_a_target_that_is_black_in_the_region_is_told() -> None:
    found = measure_speckle(_patterns(1)[0], WHOLE, np.zeros((SIDE, SIDE, 3)))
    assert not found.has_target and "black in the region" in " ".join(found.notes)


def test_more_contrast_than_speckle_has_is_told_where_one_sample_makes_it() -> None:
    """A sample of 200 means among 4096: C² = 1 + 200²/4096, about. All of it is in one block, so that C is known to a
    half of itself, and isn't withheld."""
    light = np.random.default_rng(8).exponential(size=(64, 64))
    target = np.full((64, 64, 3), 0.5) + 0.01 * np.arange(64)[:, None] / 64
    plain = measure_speckle(light, (0, 0, 64, 64), target)
    assert not any("of 1 at most" in note for note in plain.notes)
    light[20, 30] = 200.0
    found = measure_speckle(light, (0, 0, 64, 64), target)
    assert not found.withheld and found.luminance.contrast > 2
    assert any("contrast of 1 at most" in note for note in found.notes)
    assert (
        "contrast of 1 at most" in measure_region(np.repeat(light[..., None], 3, axis=-1), (0, 0, 64, 64), target).doubt
    )


def test_few_grains_are_told() -> None:
    found = measure_speckle(_patterns(1)[0], (0, 0, 4, 4))
    assert "independent grains only" in found.notes[0]


@pytest.mark.parametrize(
    ("contrast", "error", "verdict"),
    [(0.05, 0.001, "visible"), (0.02, 0.001, "not visible"), (0.031, 0.001, "undecided"), (0.028, 0.001, "undecided")],
)
def test_visibility_is_undecided_within_two_standard_errors(contrast: float, error: float, verdict: str) -> None:
    assert Visibility("luminance", contrast, error, 0.03, "").verdict == verdict


def test_thresholds_are_the_published_ones() -> None:
    found = replace(measure_speckle(_patterns(1)[0], WHOLE), groups={
        name: ContrastEstimate(0.05, 0.0, Grains(1.0, (1.0, 1.0))) for name in ("blue", "green", "red")
    })  # fmt: skip
    rows = {row.what.split(",")[0]: row for row in visibility(found)}
    assert (rows["luminance"].threshold, MOVING_THRESHOLDS) == (0.03, {"red": 0.069, "green": 0.060, "blue": 0.048})
    assert [rows[name].verdict for name in ("blue", "green", "red")] == ["visible", "not visible", "not visible"]


# --- holograms and instruments ----------------------------------------------------------------------------------------


def _hologram(**changes: object) -> Hologram:
    system = preset.load("holochrome-8").edit({"shape": [96, 128], "propagation": "periodic", **changes})
    return Hologram(random_drive(system), system)


REGION = (64, 48, 128, 96)


def test_a_hologram_is_measured_as_the_viewer_measures_it() -> None:
    hologram = _hologram()
    measured = measure_hologram(hologram, 10e-3, REGION)
    assert measured.found.luminance.contrast == measure_region(measured.view.xyz[0], REGION).contrast
    assert len(measured.found.lasers) == 8
    shares = laser_luminances(hologram.system).sum(axis=0)
    found = np.array([laser.luminance_share for laser in measured.found.lasers])
    assert found == pytest.approx(shares / shares.sum(), rel=0.15)  # some thousand grains of contrast 1


def test_lines_of_one_laser_are_one_laser() -> None:
    hologram = _hologram(effects={"second_line": {"share": 0.3, "offset": "20 nm"}})
    assert len(measure_hologram(hologram, 10e-3, REGION).found.lasers) == 8


def test_a_smaller_pupil_makes_wider_grains_and_lasers_alike() -> None:
    """Grains of λ/D: those of 1.2 mm are 2.5 times as wide as those of 3 mm, which the first order's 2.8 mm narrows."""
    hologram = _hologram()
    bare, iec, eye = (measure_hologram(hologram, 10e-3, REGION, meter=Meter(name)) for name in ("", "iec", "eye"))
    widths = [np.mean(of.found.lasers[3].estimate.grains.width_px) for of in (bare, iec)]
    assert 1.8 < widths[1] / widths[0] < 3.0
    assert iec.found.luminance.contrast > bare.found.luminance.contrast
    assert "λ/D = 1.59'" in iec.reading.grain and iec.reading.pixels_a_grain == pytest.approx(4.63, abs=0.01)
    assert "fills 2.7" in " ".join(eye.reading.notes)
    assert eye.found.lasers[3].estimate.contrast < bare.found.lasers[3].estimate.contrast  # cones average


def test_iec_has_no_aberrations_and_tells_coarse_samples() -> None:
    hologram = _hologram(eye={"pupil": "2 mm", "prescription": {"sphere": "-2 D"}, "eyepiece": "8 mm"})
    system = Meter("iec").bench(hologram.system)
    assert isinstance(system.eye, Eye) and not system.eye.chromatic and not system.eye.prescription.mean_sphere_dpt
    assert system.eye.pupil_m == 1.2e-3 and system.eye.eyepiece_m == 8e-3
    notes = measure_hologram(hologram, 10e-3, REGION, meter=Meter("iec")).reading.notes
    assert any("wider than half a grain" in note for note in notes)


def test_a_camera_s_noise_is_taken_off_and_its_conditions_are_told() -> None:
    hologram = _hologram()
    dark = measure_hologram(hologram, 10e-3, REGION, meter=Meter("camera", CameraLens(30.0, 4e-6, exposure=0.05)))
    bright = measure_hologram(hologram, 10e-3, REGION, meter=Meter("camera", CameraLens(30.0, 4e-6, exposure=0.1)))
    # the same light with other noise: √(2s² + 4sC²(1 + 2C²))/(2C√n) of shares s of 0.13 and 0.06 % in 12 000 pixels
    assert dark.found.luminance.contrast == pytest.approx(bright.found.luminance.contrast, abs=5 * 0.0006)
    assert dark.reading.full_scale_sigma is not None and dark.reading.full_scale_sigma > 20
    coarse = measure_hologram(hologram, 10e-3, REGION, meter=Meter("camera", CameraLens(8.0, 8e-6, 8, 0.4))).reading
    assert all(any(part in note for note in coarse.notes) for part in ("half a grain", "8 bits", "20 are recommended"))


def test_pixels_average_waves_by_sinc() -> None:
    n, width, cycles = 120, 2.5, 6 / 120
    wave = 1 + np.cos(2 * np.pi * cycles * np.arange(n)) * np.ones((n, 1))
    found = pixel_means(wave, (0, 0, n, n), width)
    assert found.shape == (48, 48)
    centres = width * (np.arange(48) + 0.5) - 0.5
    known = 1 + np.sinc(cycles * width) * np.cos(2 * np.pi * cycles * centres)
    assert np.allclose(found, known, atol=1e-4)  # cubic splines of 20 samples a period: (2π/20)⁴/384 and a little
    with pytest.raises(UserError, match="at least 2 × 2 pixels"):
        pixel_means(wave, (0, 0, 3, 3), width)
