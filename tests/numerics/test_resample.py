"""Maps that are blurred and warped: what is exact, and what goes on at the edges."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from holoview.light.numerics.resample import (
    affine_warp,
    centred_indices,
    gaussian_blur,
    weighted_blur,
)


def _map(dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(18, 25, dtype=dtype, generator=torch.Generator().manual_seed(3))


@pytest.mark.parametrize("sigma", [0.9, 1.7, 3.0])
def test_a_blur_is_the_gaussian_of_scipy_with_edges_continued(sigma: float) -> None:
    smooth = gaussian_filter(_map().numpy(), 2.0)  # of noise, a sampled Gaussian would alias the highest frequencies
    expected = gaussian_filter(smooth, sigma, mode="nearest", truncate=8.0)
    found = gaussian_blur(torch.from_numpy(smooth), sigma).numpy()
    # The kernels differ by what scipy's aliases. Summed by parts that is at most a quarter of the gain at the highest
    # frequency times the map's second differences, largest at the edges' kinks. The far edge, 4.8 σ off, weighs < 3e-6.
    kinks = sum(np.abs(np.diff(np.pad(smooth, 1, mode="edge"), n=2, axis=axis)).max() for axis in (0, 1))
    aliased = math.exp(-((math.pi * sigma) ** 2) / 2) / 4
    np.testing.assert_allclose(found, expected, atol=aliased * kinks + 3e-6 * np.abs(smooth).max())


def test_a_blur_depends_on_the_square_of_a_small_width() -> None:
    changes = [float((gaussian_blur(_map(), s) - _map()).norm()) for s in (0.01, 0.02)]
    assert changes[1] / changes[0] == pytest.approx(4.0, rel=1e-2)


def test_no_blur_is_the_map_itself_to_rounding() -> None:
    torch.testing.assert_close(gaussian_blur(_map(), 0.0), _map())


def test_gradients_reach_the_width() -> None:
    variance = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
    loss = gaussian_blur(_map(), variance.sqrt()).square().sum()
    (slope,) = torch.autograd.grad(loss, variance)
    up, down = (float(gaussian_blur(_map(), math.sqrt(0.5 + d)).square().sum()) for d in (1e-5, -1e-5))
    assert float(slope) == pytest.approx((up - down) / 2e-5, rel=1e-6)


@pytest.mark.parametrize("dtype", [torch.float64, torch.complex128])
def test_half_a_sample_is_the_mean_of_two(dtype: torch.dtype) -> None:
    values = _map(dtype)
    found = affine_warp(values, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.5)))
    torch.testing.assert_close(found[:, :-1], (values[:, :-1] + values[:, 1:]) / 2)
    torch.testing.assert_close(found[:, -1], values[:, -1])  # beyond the edge it goes on as it was


def test_a_warp_to_another_shape_is_about_both_centres() -> None:
    y, x = (centred_indices(n, torch.float64, torch.device("cpu")) for n in (18, 25))
    ramp = 3 * y[:, None] - 2 * x[None, :]
    found = affine_warp(ramp, ((2.0, 0.0, 0.25), (0.0, 0.5, 1.0)), shape=(4, 6))
    v, u = (centred_indices(n, torch.float64, torch.device("cpu")) for n in (4, 6))
    torch.testing.assert_close(found, 3 * (2 * v + 0.25)[:, None] - 2 * (0.5 * u + 1.0)[None, :])


@pytest.mark.parametrize("sigma", [0.2, 0.6, 2.5])
def test_neighbours_weigh_as_a_gaussian_of_their_distance(sigma: float) -> None:
    values = np.random.default_rng(1).random((9, 14))
    found = weighted_blur(torch.from_numpy(values), math.exp(-1 / (2 * sigma**2))).numpy()
    expected = gaussian_filter(values, sigma, mode="nearest", truncate=6.0)
    assert found == pytest.approx(expected, abs=1e-7)  # either cuts weights of 1e-8


def test_the_weights_of_neighbours_have_a_slope_from_zero_on() -> None:
    values = torch.from_numpy(np.random.default_rng(2).random((5, 6)))
    for weight in (0.0, 0.4):
        neighbour = torch.tensor(weight, dtype=torch.float64, requires_grad=True)
        (slope,) = torch.autograd.grad(weighted_blur(values, neighbour).square().sum(), neighbour)
        step = 1e-6
        ahead, here = (float(weighted_blur(values, w).square().sum()) for w in (weight + step, weight))
        assert float(slope) == pytest.approx((ahead - here) / step, rel=1e-4)
