"""Gains, jitter and movements of the camera are nobody's fault; what all captures share is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Prediction
from holoview.bench.captures.prepared_captures import PreparedCaptures, prepare_captures
from holoview.bench.diagnose.likelihood import Comparison
from holoview.light.numerics.subpixel_shift import shift_images
from tests.diagnose.conftest import SHAPE, pictures

COUNT = 8
SIZE = (2 * SHAPE[0], 2 * SHAPE[1])


class Fake:
    """Predicts smooth speckle; the effect `camera_alignment` moves it, `black` adds counts."""

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        self.speckle = gaussian_filter(rng.exponential(size=(COUNT, *SIZE)), (0, 1.3, 1.3)).astype(np.float32)

    def __call__(self, indices: NDArray[np.intp], values: Mapping[str, Any], *, grad: bool = False) -> Prediction:
        aim = values.get("camera_alignment", {})
        shift = np.array([aim.get("shift_y", 0.0), aim.get("shift_x", 0.0)]) / 4e-6
        signal = self.speckle[indices]
        if shift.any():
            signal = shift_images(signal, np.tile(shift, (len(indices), 1)))
        return Prediction(torch.from_numpy(signal), 64.0 + values.get("black", {}).get("counts", 0.0))


def _session(gain: NDArray[np.float64], shift: NDArray[np.float64], black: float = 0.0) -> tuple[Captures, Fake]:
    """Noisy pictures of the speckle with a gain and a movement a capture."""
    rng, fake = np.random.default_rng(4), Fake()
    signal = 1000.0 * gain[:, None, None] * shift_images(fake.speckle, shift)
    electrons = rng.poisson(np.maximum(signal, 0) * 4.0) + 3.0 * rng.standard_normal(signal.shape)
    images = np.clip(np.rint(electrons / 4.0 + 64 + black), 0, 4094).astype(np.uint16)
    return pictures(COUNT, images=images), fake


def _comparison(captures: Captures, fake: Fake, shifts: bool = False, black: float = 0.0) -> Comparison:
    seen: PreparedCaptures = prepare_captures(captures)
    variance = captures.camera.noise_variance(np.maximum(seen.light - black, 0))
    smooth = gaussian_filter(variance, (0, 3, 3))
    return Comparison(fake, seen, np.arange(COUNT), smooth, fit_shifts=shifts)


STILL = np.zeros((COUNT, 2))
SCATTER = 0.08
"""Five σ of χ²/n, √(2/n) = 0.0097 for n = 8·44·60, and 3 % for variances taken from smoothed pictures, which are too
large by 1 %, with saturated pixels among them by 2 %."""


def test_any_gain_fits_and_is_told() -> None:
    gain = np.random.default_rng(5).uniform(0.5, 2.0, COUNT)
    captures, fake = _session(gain, STILL)
    fitted = _comparison(captures, fake).fit_gains({})
    assert fitted.gain / 1000 == pytest.approx(gain, rel=2.7e-3)  # 6 σ of 2640 pixels of 2000 electrons or more
    assert _comparison(captures, fake).chi2_per_pixel({}) == pytest.approx(1.0, abs=SCATTER)


def test_a_black_level_that_is_off_is_not_a_gain() -> None:
    captures, fake = _session(np.ones(COUNT), STILL, black=150.0)
    comparison = _comparison(captures, fake, black=150.0)
    assert comparison.chi2_per_pixel({}) > 1.3
    assert comparison.chi2_per_pixel({"black": {"counts": 150.0}}) == pytest.approx(1.0, abs=SCATTER)


def test_movements_without_direction_are_taken_out() -> None:
    shift = 0.15 * np.random.default_rng(6).standard_normal((COUNT, 2))
    shift -= shift.mean(axis=0)
    captures, fake = _session(np.ones(COUNT), shift)
    # 3.4 for the mean of 14 squares of movements; all as small as this once in 10⁷ times
    assert _comparison(captures, fake).chi2_per_pixel({}) > 1.1
    shaken = _comparison(captures, fake, shifts=True)
    assert shaken.chi2_per_pixel({}) == pytest.approx(1.0, abs=SCATTER)
    found = shaken.fit_gains({}).shift
    assert found is not None and found == pytest.approx(shift, abs=0.03)  # 6 σ of each


def test_a_movement_that_all_share_stays_in() -> None:
    captures, fake = _session(np.ones(COUNT), np.tile([0.2, -0.15], (COUNT, 1)))
    comparison = _comparison(captures, fake, shifts=True)
    assert comparison.chi2_per_pixel({}) > 1.3
    aimed = {"camera_alignment": {"shift_y": 0.2 * 4e-6, "shift_x": -0.15 * 4e-6}}
    assert comparison.chi2_per_pixel(aimed) == pytest.approx(1.0, abs=SCATTER)


def test_pixels_that_arent_trusted_weigh_nothing() -> None:
    captures, fake = _session(np.ones(COUNT), STILL)
    images = captures.images.copy()
    images[:, 30:34, 30:34] = captures.camera.saturation
    spoilt = pictures(COUNT, images=images)
    assert _comparison(spoilt, fake).pixel_count == _comparison(captures, fake).pixel_count - 16 * COUNT
    assert _comparison(spoilt, fake).chi2_per_pixel({}) == pytest.approx(1.0, abs=SCATTER)


@pytest.mark.parametrize("captures_at_once", [1, 3, COUNT])
def test_parts_hold_every_residual_once(monkeypatch: pytest.MonkeyPatch, captures_at_once: int) -> None:
    captures, fake = _session(np.linspace(0.5, 2.0, COUNT), STILL)
    whole = _comparison(captures, fake)
    monkeypatch.setattr("holoview.bench.diagnose.likelihood._MAX_PART_PIXELS", captures_at_once * SIZE[0] * SIZE[1] + 1)
    values, parts = {"black": {"counts": 1.5}}, whole.parts()
    assert [len(part.indices) for _, part in parts] == {1: [1] * 8, 3: [3, 3, 2], 8: [8]}[captures_at_once]
    found = np.full(whole.weight.size, np.nan, np.float32)
    for where, part in parts:
        found[where] = part.residual(values)
    np.testing.assert_array_equal(found, whole.residual(values))
    assert sum(part.pixel_count for _, part in parts) == whole.pixel_count


def test_movements_are_fitted_in_all_captures_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What they share is an effect, and no part knows it."""
    captures, fake = _session(np.ones(COUNT), STILL)
    whole = _comparison(captures, fake, shifts=True)
    monkeypatch.setattr("holoview.bench.diagnose.likelihood._MAX_PART_PIXELS", 1)
    ((where, only),) = whole.parts()
    assert only is whole and where == slice(None)
