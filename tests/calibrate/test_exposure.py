"""Exposures that fill the camera's range, from a linear camera whose rate is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from holoview.bench.calibrate.exposure import ExposureLimits, plan_exposures
from holoview.bench.captures.dataset import Captures
from holoview.util.errors import UserError

BLACK = 64.0


def _lit(small: Captures, counts: dict[float, float]) -> Captures:
    """Pictures of 100 counts above black with 1 % of the pixels brighter by λ; power 0.5, exposure 10 ms."""
    images = np.full(small.images.shape, BLACK + 100, np.uint16)
    for k, λ in enumerate(small.wavelength_m):
        images[k].flat[::100] = BLACK + counts[λ]
    count = len(small)
    return dataclasses.replace(small, images=images, power=np.full(count, 0.5), exposure_s=np.full(count, 10e-3))


def test_the_brightest_pixels_reach_the_headroom_at_the_highest_power(small: Captures) -> None:
    counts = dict(zip(small.wavelengths_m, (500.0, 1000.0, 2000.0), strict=True))
    captures = _lit(small, counts)
    room = 0.9 * (captures.camera.saturation - BLACK)
    for line in plan_exposures(captures):
        rate = counts[line.wavelength_m] / (0.5 * 10e-3)
        assert line.power == 1.0
        assert line.exposure_s == pytest.approx(room / rate, rel=0.01)  # three digits, rounded down
        assert line.reached <= room
        assert line.note == ""


def test_limits_are_kept_and_what_they_cost_is_said(small: Captures) -> None:
    counts = dict(zip(small.wavelengths_m, (500.0, 1000.0, 2000.0), strict=True))
    captures = _lit(small, counts)
    room = 0.9 * (captures.camera.saturation - BLACK)
    long = plan_exposures(captures, limits=ExposureLimits(exposures_s=(0.1, 1.0)))
    for line in long:  # the shortest exposure is too long for full power: power comes down
        assert line.exposure_s == 0.1
        assert line.power == pytest.approx(room / (counts[line.wavelength_m] / 5e-3) / 0.1, rel=0.01)
    assert "dim at" in plan_exposures(captures, limits=ExposureLimits(exposures_s=(1e-4, 1e-3)))[0].note
    assert "too bright" in plan_exposures(captures, limits=ExposureLimits((0.5, 1.0), (1.0, 2.0)))[2].note


def test_a_clipped_first_capture_is_no_measurement(small: Captures) -> None:
    full = small.camera.saturation - BLACK
    captures = _lit(small, dict.fromkeys(small.wavelengths_m, full))
    line = plan_exposures(captures)[0]
    assert "clipped" in line.note
    assert line.power * line.exposure_s < 0.3 * 0.5 * 10e-3


def test_a_dark_picture_replaces_the_nominal_black(small: Captures) -> None:
    captures = _lit(small, dict.fromkeys(small.wavelengths_m, 500.0))
    dark = np.full(captures.shape, BLACK + 50, np.uint16)
    room, rate = 0.9 * (captures.camera.saturation - BLACK - 50), 450 / 5e-3
    assert plan_exposures(captures, dark)[0].exposure_s == pytest.approx(room / rate, rel=0.01)
    with pytest.raises(UserError, match="lasers off"):
        plan_exposures(captures, np.full(captures.shape, 2000, np.uint16))
    with pytest.raises(UserError, match="as the captures"):
        plan_exposures(captures, dark[1:])


def test_limits_that_cannot_be_are_refused() -> None:
    with pytest.raises(UserError, match="powers"):
        ExposureLimits(powers=(1.0, 0.5))
    with pytest.raises(UserError, match="headroom"):
        ExposureLimits(headroom=1.0)
