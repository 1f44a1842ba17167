"""Discrete Fourier sums at equally spaced frequencies that no FFT grid holds: Bluestein's chirp transform.

    X_k = Σ_j x_j·exp(−2πi·(first + k·step)·(j − (n − 1)/2)),  k < count

With j·k = (j² + k² − (k − j)²)/2 the sum is a convolution with a chirp, done by FFTs of n + count samples (Rabiner,
Schafer and Rader, Bell Syst. Tech. J. 48, 1249 (1969)). Phases are reduced in float64.
"""

from __future__ import annotations

import math

import torch

from holoview.numerics.fft_grid import next_fast_length

Tensor = torch.Tensor
_BY_MATRIX = 160  # frequencies and samples up to which one product of matrices is faster


def chirp_z_transform(values: Tensor, first: float, step: float, count: int) -> Tensor:
    """Sums along the last axis of `values` (…, n), complex: (…, count). Frequencies in cycles a sample."""
    n = values.shape[-1]
    if max(n, count) <= _BY_MATRIX:
        return values @ dft_matrix(n, first, step, count).to(values.dtype).to(values.device).T
    j = torch.arange(n, dtype=torch.float64)
    k = torch.arange(count, dtype=torch.float64)
    lags = torch.arange(-(n - 1), count, dtype=torch.float64)
    length = next_fast_length(n + count - 1)
    before = _turned(-(first * j + 0.5 * step * j * j))
    after = _turned((first + k * step) * ((n - 1) / 2) - 0.5 * step * k * k)
    chirp = torch.fft.fft(_turned(0.5 * step * lags * lags), n=length)
    whole = torch.fft.fft(values * before.to(values.dtype), n=length) * chirp.to(values.dtype)
    return torch.fft.ifft(whole)[..., n - 1 : n - 1 + count] * after.to(values.dtype)


def dft_matrix(n: int, first: float, step: float, count: int) -> Tensor:
    """(count, n) complex128: exp(−2πi·frequency·place) of each frequency and sample."""
    frequencies = first + step * torch.arange(count, dtype=torch.float64)
    places = torch.arange(n, dtype=torch.float64) - (n - 1) / 2
    return _turned(-frequencies[:, None] * places[None, :])


def _turned(turns: Tensor) -> Tensor:
    phase = (2 * math.pi) * torch.remainder(turns, 1.0)
    return torch.polar(torch.ones_like(phase), phase)
