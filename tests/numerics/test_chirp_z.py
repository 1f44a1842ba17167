"""Fourier sums at any equally spaced frequencies agree with the direct sums, by matrix and by chirps."""

from __future__ import annotations

import pytest
import torch

from holoview.numerics.fourier import chirp_z_transform, dft_matrix


@pytest.mark.parametrize("count", [5, 40, 300])
@pytest.mark.parametrize(("first", "step"), [(0.0, 1 / 37), (-0.31, 0.00271), (0.2, -0.013), (3.7, 0.4)])
@pytest.mark.parametrize("chirps", [True, False])
def test_sums_are_the_sums(first: float, step: float, count: int, chirps: bool) -> None:
    values = torch.randn(3, 37, dtype=torch.complex128, generator=torch.Generator().manual_seed(0))
    expected = values @ dft_matrix(37, first, step, count).T
    found = chirp_z_transform(values, first, step, count, matrix_limit=0 if chirps else 1000)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-9)  # chirps of 18000 turns


def test_the_frequencies_of_an_fft_give_the_fft() -> None:
    values = torch.randn(16, dtype=torch.complex128, generator=torch.Generator().manual_seed(1))
    centre = torch.exp(2j * torch.pi * torch.arange(16).double() * 7.5 / 16)  # positions count from the middle
    torch.testing.assert_close(chirp_z_transform(values[None], 0.0, 1 / 16, 16)[0], torch.fft.fft(values) * centre)


def test_single_precision_keeps_six_digits_at_full_size() -> None:
    values = torch.randn(2, 1920, dtype=torch.complex64, generator=torch.Generator().manual_seed(2))
    found = chirp_z_transform(values, -0.4, 0.8 / 2048, 2048)
    expected = chirp_z_transform(values.to(torch.complex128), -0.4, 0.8 / 2048, 2048)
    assert float((found - expected).norm() / expected.norm()) < 2e-6
