"""Lasers that drift either way are nobody's fault; lasers that are off are."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from holoview.bench.diagnose.nuisances import estimate_laser_drift

CURVATURE = 1e22  # Δχ² of a capture a square metre: 0.1 nm costs 100


class Paraboloid:
    """Each capture fits best at a wavelength of its own: 100 pixels of noise and a parabola."""

    def __init__(self, offsets: np.ndarray) -> None:
        self.offsets, self.pixel_count = offsets, 100.0 * len(offsets)

    def fit_gains(self, values: dict[str, dict[str, float]]) -> Any:
        at = values["wavelength_offset"]["offset"]
        return SimpleNamespace(squares=100.0 + CURVATURE * (at - self.offsets) ** 2)


def test_drift_is_measured_and_has_no_direction() -> None:
    offsets = 1e-9 * np.array([-0.12, -0.06, 0.06, 0.12, -0.02, 0.02, 0.0, 0.0])
    found = estimate_laser_drift(Paraboloid(offsets), {})  # type: ignore[arg-type]
    assert found.rms_m == pytest.approx(np.sqrt(np.mean(offsets**2)))
    assert found.chi2_per_pixel == pytest.approx(1.0) and not found.is_systematic


def test_a_wavelength_that_is_off_has_a_direction() -> None:
    found = estimate_laser_drift(Paraboloid(np.full(8, 0.06e-9)), {})  # type: ignore[arg-type]
    assert found.is_systematic and found.rms_m == pytest.approx(0.06e-9)


def test_steps_start_from_what_is_known() -> None:
    found = estimate_laser_drift(Paraboloid(np.full(8, 5e-9)), {"wavelength_offset": {"offset": 5e-9}})  # type: ignore[arg-type]
    assert found.rms_m == 0.0 and found.chi2_per_pixel == pytest.approx(1.0)
