"""An error is told to live where it was put, and noise nowhere."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from holoview.bench.diagnose.fit_statistics import ExcessBin, ExcessBreakdown, break_down_excess
from tests.diagnose.conftest import SHAPE, pictures

COUNT = 8
SIZE = (2 * SHAPE[0], 2 * SHAPE[1])
PIXELS = COUNT * SIZE[0] * SIZE[1]
ROUGH = np.arange(COUNT, dtype=float)


def _excess(more: np.ndarray | float) -> ExcessBreakdown:
    """Of white noise plus an error in σ."""
    rng = np.random.default_rng(0)
    residual = (rng.standard_normal((COUNT, *SIZE)) + more).astype(np.float32)
    expected = rng.exponential(size=(COUNT, *SIZE)).astype(np.float32)
    captures = pictures(COUNT, distance_m=np.repeat([3e-3, 4e-3], COUNT // 2))
    ones = np.ones((COUNT, *SIZE), np.float32)
    comparison: Any = SimpleNamespace(
        indices=np.arange(COUNT),
        weight=ones,
        pixels_per_capture=ones.sum((1, 2)).astype(float),
        pixel_count=float(PIXELS),
    )
    fitted: Any = SimpleNamespace(residual=residual, expected=expected, squares=np.square(residual).sum((1, 2)))
    return break_down_excess(captures, comparison, fitted, ROUGH)


def _bins(found: ExcessBreakdown) -> list[tuple[ExcessBin, ...]]:
    return [found.wavelength, found.plane, found.smoothness, found.radius, found.frequency, found.brightness]


def _named(bins: tuple[ExcessBin, ...], part: str) -> ExcessBin:
    return next(b for b in bins if part in b.name)


def test_noise_lives_nowhere() -> None:
    """χ²/n = 1 in every class, to five σ of the smallest class, a sixteenth of the pixels."""
    for bins in _bins(_excess(0.0)):
        assert [b.chi2_per_pixel for b in bins] == pytest.approx([1.0] * len(bins), abs=5 * (32 / PIXELS) ** 0.5)


def test_classes_hold_all_of_the_residual() -> None:
    """Shares sum to 1, also those of the bands of the spectrum (Parseval)."""
    for bins in _bins(_excess(0.5)):
        assert sum(b.share for b in bins) == pytest.approx(1.0)


def test_an_error_of_one_wavelength_is_found_there() -> None:
    more = np.zeros((COUNT, 1, 1))
    more[::2] = 3.0
    found = _excess(more).wavelength
    assert _named(found, "450 nm").share > 0.99 and _named(found, "450 nm").chi2_per_pixel == pytest.approx(
        10.0, rel=0.05
    )
    assert _named(found, "600 nm").chi2_per_pixel == pytest.approx(1.0, abs=5 * (4 / PIXELS) ** 0.5)


def test_an_error_of_one_plane_and_of_rough_patterns_too() -> None:
    more = np.zeros((COUNT, 1, 1))
    more[COUNT // 2 :] = 3.0
    found = _excess(more)
    assert _named(found.plane, "4 mm").share > 0.99
    assert _named(found.smoothness, "roughest").share + _named(found.smoothness, "rougher").share > 0.99


def test_an_error_of_the_corners_grows_with_the_radius() -> None:
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in SIZE), indexing="ij")
    found = _excess(3.0 * (np.hypot(y, x) > 1.2)[None]).radius
    # Five σ of the inner class, which has a twelfth of the pixels or more.
    assert found[-1].share > 0.8 and found[0].chi2_per_pixel == pytest.approx(1.0, abs=5 * (24 / PIXELS) ** 0.5)


@pytest.mark.parametrize(("cycles", "band"), [(0.05, 0), (0.2, 1), (0.3, 2), (0.45, 3)])
def test_a_wave_is_in_its_band(cycles: float, band: int) -> None:
    wave = 2.0 * np.cos(2 * np.pi * np.round(cycles * SIZE[1]) / SIZE[1] * np.arange(SIZE[1]))
    found = _excess(wave[None, None, :]).frequency
    assert found[band].share > 0.95
