"""Samples to camera pixels: the transpose, whole pixels, means, detail between samples, and what is covered."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.experiment.camera_loop.camera_problem import CameraSampling

_CASES = {
    "equal": ((12, 16), 4e-6, (0.0, 0.0)),
    "moved": ((12, 16), 4e-6, (1.3e-6, -5.1e-6)),
    "coarser": ((6, 7), 8e-6, (1e-6, -3e-6)),
    "finer and larger": ((30, 41), 2.5e-6, (0.0, 2e-6)),
}


@pytest.mark.parametrize("case", _CASES)
def test_the_transpose_is_that_of_the_picture(case: str) -> None:
    pixels, pitch_m, shift_m = _CASES[case]
    view = CameraSampling((12, 16), 4e-6, pixels, pitch_m, shift_m)
    generator = torch.Generator().manual_seed(1)
    samples = torch.randn(2, 12, 16, generator=generator, dtype=torch.float64)
    slopes = torch.randn(2, *pixels, generator=generator, dtype=torch.float64)
    left, right = (view.picture(samples) * slopes).sum(), (samples * view.transposed(slopes)).sum()
    assert float(left) == pytest.approx(float(right), rel=1e-12)


def test_a_camera_that_has_moved_by_whole_samples_sees_the_samples_that_are_there() -> None:
    samples = torch.arange(12.0 * 16, dtype=torch.float64).reshape(12, 16).sin()
    seen = CameraSampling((12, 16), 4e-6, (12, 16), 4e-6, (4e-6, -8e-6)).picture(samples)
    torch.testing.assert_close(seen[1:, :-2], samples[:-1, 2:], rtol=0, atol=1e-12)


def test_a_pixel_of_four_samples_is_their_mean() -> None:
    samples = torch.randn(12, 16, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    seen = CameraSampling((12, 16), 4e-6, (6, 8), 8e-6).picture(samples)
    torch.testing.assert_close(seen, samples.reshape(6, 2, 8, 2).mean(dim=(1, 3)), rtol=0, atol=1e-12)


def test_between_samples_fine_detail_is_kept_to_two_per_cent() -> None:
    """Half a sample is the worst shift; at 0.8 of the Nyquist frequency the error is 2.2 %."""
    x = np.arange(64)
    frequency = 0.75 * np.pi
    samples = torch.from_numpy(np.tile(np.cos(frequency * x), (8, 1)))
    seen = CameraSampling((8, 64), 4e-6, (8, 64), 4e-6, (0.0, 2e-6)).picture(samples).numpy()
    np.testing.assert_allclose(seen[:, 8:-8], np.tile(np.cos(frequency * (x - 0.5)), (8, 1))[:, 8:-8], atol=0.02)


def test_pixels_that_lie_partly_outside_arent_covered() -> None:
    view = CameraSampling((12, 16), 4e-6, (12, 16), 4e-6, (4e-6, -8e-6))
    expected = np.zeros((12, 16), bool)
    expected[1:, :-2] = True
    np.testing.assert_array_equal(view.covers(None), expected)
    assert view.covers((2, 3, 5, 4)).sum() == 20
    assert CameraSampling((12, 16), 4e-6, (6, 8), 8e-6).covers((1, 1, 4, 4)).sum() == 1
