"""Speckle on the retina: what cones average, the laws of independent patterns, and what no pupil changes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j1

from holoview.metrics.speckle import (
    CONE_ARCMIN,
    PUPILS_M,
    default_pupils,
    independent_contrast,
    mean_wavelength,
    pupils_of,
    retinal_contrast,
    seen_by_cones,
    speckle_contrast,
)
from holoview.model import preset
from holoview.model.system import System
from holoview.util.errors import UserError
from holoview.view import random_drive, simulate


def _one_laser(**changes: object) -> System:
    lasers = {"wavelengths": ["550 nm"], "amplitudes": [[1.0]], "shape": [48, 64], "propagation": "periodic"}
    return preset.load("holochrome-8").edit({**lasers, "eye": {"chromatic": False}, **changes})


def test_cones_see_a_wave_as_bright_as_the_mean_over_a_disc_makes_it() -> None:
    """A disc of diameter d damps a wave of frequency f by 2·J₁(πdf)/(πdf) (Bracewell, ch. 12)."""
    degrees, rows, columns = 1 / 180, 30, 60
    v = np.pi * CONE_ARCMIN / 60 * 7 / (columns * degrees)
    wave = np.cos(2 * np.pi * 7 * np.arange(columns) / columns) * np.ones((rows, 1))
    assert np.allclose(seen_by_cones(3 + wave, degrees), 3 + 2 * j1(v) / v * wave, atol=1e-12)
    assert 0.5 < 2 * j1(v) / v < 0.99


def test_fully_developed_speckle_of_one_laser_has_contrast_one_through_every_pupil() -> None:
    """Of n grains, the contrast has the standard error √(1/n): C = 1 with (1 + C²)/2n (docs/speckle-contrast.md)."""
    system = _one_laser()
    drive = random_drive(system)
    for seen in pupils_of(system, (1.5e-3, 3e-3)):
        luminance = simulate(seen, drive, [10e-3], "torch").xyz[0, ..., 1]
        found = retinal_contrast(seen, luminance)
        rows, columns = luminance.shape
        grains = rows * columns * (4e-6 * found.pupil_m / (550e-9 * 40e-3)) ** 2
        assert abs(found.contrast - 1) < 5 / np.sqrt(grains)
        assert found.cone_contrast < found.contrast
        assert found.grain_arcmin == pytest.approx(np.degrees(550e-9 / found.pupil_m) * 60)


def test_a_pupil_wider_than_the_eyebox_changes_nothing_that_an_eye_without_colour_error_sees() -> None:
    system = preset.load("holochrome-8").edit({"shape": [16, 24], "eye": {"chromatic": False, "pupil": "12 mm"}})
    drive = random_drive(system)
    bare, seen = (simulate(of, drive, [10e-3], "torch64").xyz[0, ..., 1] for of in (system.with_(eye=None), system))
    known = speckle_contrast(bare).contrast
    assert retinal_contrast(system, seen).contrast == pytest.approx(known, rel=1e-6)


def test_structure_of_the_target_is_divided_out_as_cones_see_it() -> None:
    """A target of fine stripes alone has no speckle, at every sample and for cones."""
    stripes = np.tile([1.0, 3.0], (96, 64))
    found = retinal_contrast(_one_laser(), 5 * stripes, (10, 10, 60, 60), stripes)
    assert found.contrast < 1e-12 and found.cone_contrast < 1e-12
    assert retinal_contrast(_one_laser(), stripes).contrast == pytest.approx(0.5)


def test_equal_lasers_have_the_contrast_of_independent_patterns() -> None:
    equal = _one_laser(wavelengths=["550 nm"] * 4, amplitudes=[[1.0] * 4])
    assert independent_contrast(equal) == pytest.approx(0.5)
    one_seen = _one_laser(wavelengths=["550 nm", "600 nm"], amplitudes=[[1.0, 0.0]])
    assert independent_contrast(one_seen) == pytest.approx(1.0) and mean_wavelength(one_seen) == pytest.approx(550e-9)


def test_pupils_that_cannot_be_are_refused_and_those_that_do_not_fit_left_out() -> None:
    system = _one_laser()
    assert [of.eye.pupil_m for of in pupils_of(system, PUPILS_M) if of.eye is not None] == list(PUPILS_M)
    for pupils_m, complaint in (((), "0"), ((0.0,), "out of range"), ((3e-3,) * 51, "1 to 50")):
        with pytest.raises(UserError, match=complaint):
            pupils_of(system, pupils_m)
    for call in (lambda: pupils_of(system.with_(eye=None), (3e-3,)), lambda: retinal_contrast(
        system.with_(eye=None), np.ones((4, 4))
    )):  # fmt: skip
        with pytest.raises(UserError, match="no eye"):
            call()
    short = system.edit({"eye": {"eyepiece": "2.2 mm", "pupil": "1 mm", "pupil_x": "0.5 mm"}})
    assert default_pupils(short) == (2e-3, 2.5e-3, 3e-3)
    assert len(pupils_of(short, default_pupils(short))) == 3
    tiny = system.edit({"eye": {"eyepiece": "1 mm", "pupil": "0.5 mm", "pupil_x": "0.5 mm"}})
    assert len(pupils_of(tiny, default_pupils(tiny))) == 1
    assert default_pupils(system) == PUPILS_M == default_pupils(system.with_(eye=None))
