"""Windowed sinc interpolation of a rotated map against the waves that it is a sum of."""

from __future__ import annotations

import math

import pytest
import torch

from holoview.numerics.resample import band_limited_warp

SIDE, SHAPE, WAVES = 160, (40, 56), 30


def waves(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Amplitudes, and frequencies (wave, 2) up to a quarter of the sampling frequency."""
    random = torch.Generator().manual_seed(seed)
    frequencies = (torch.rand(WAVES, 2, generator=random, dtype=torch.float64) - 0.5) / 2
    return torch.randn(WAVES, generator=random, dtype=torch.complex128), frequencies


def summed(amplitudes: torch.Tensor, frequencies: torch.Tensor, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    turns = y[..., None] * frequencies[:, 0] + x[..., None] * frequencies[:, 1]
    return (amplitudes * torch.polar(torch.ones_like(turns), 2 * math.pi * turns)).sum(-1)


def grid(shape: tuple[int, int]) -> tuple[torch.Tensor, ...]:
    """Coordinates from the centre."""
    return torch.meshgrid(*(torch.arange(n, dtype=torch.float64) - (n - 1) / 2 for n in shape), indexing="ij")


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, -0.02, 0.2, -0.5])
@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128])
def test_a_turned_sum_of_waves_is_that_sum_at_turned_places(angle: float, dtype: torch.dtype) -> None:
    amplitudes, frequencies = waves(1)
    values = summed(amplitudes, frequencies, *grid((SIDE, SIDE))).to(dtype)
    c, s = 1.7 * math.cos(angle), 1.7 * math.sin(angle)
    y, x = grid(SHAPE)
    expected = summed(amplitudes, frequencies, c * y - s * x + 0.3, s * y + c * x - 0.7)
    found = band_limited_warp(values, ((c, -s, 0.3), (s, c, -0.7)), SHAPE)
    assert float((found - expected).abs().max() / expected.abs().max()) < 1.5e-4  # ripples of two passes, -80 dB each


def test_real_maps_and_gradients_pass() -> None:
    amplitudes, frequencies = waves(2)
    values = summed(amplitudes, frequencies, *grid((24, 24))).real.requires_grad_()
    c, s = math.cos(0.1), math.sin(0.1)
    source = ((c, -s, 0.2), (s, c, 0.1))
    assert torch.autograd.gradcheck(lambda v: band_limited_warp(v, source, (6, 5)), (values,))


def test_a_map_is_continued_outwards() -> None:
    found = band_limited_warp(torch.full((8, 8), 3.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), (40, 40))
    assert float((found - 3.0).abs().max()) < 1e-3
