"""Discrete Fourier sums at equally spaced frequencies that needn't be those of an FFT (the chirp-z transform).

    X_k = Σ_j x_j·exp(−2πi·(first + k·step)·(j − (n − 1)/2)),  k = 0 … count − 1

Bluestein's algorithm: with j·k = (j² + k² − (k − j)²)/2 the sum becomes a convolution with a chirp, which FFTs of
n + count − 1 samples compute (Rabiner, Schafer and Rader, Bell Syst. Tech. J. 48, 1249 (1969)). Small sums are a matrix
product instead. Phases are computed in float64 whatever the precision of the samples.
"""

from __future__ import annotations

import torch

from holoview.numerics.fft_grid import next_fast_length
from holoview.numerics.phasor import phasor_of_turns
from holoview.numerics.resample import centred_indices

Tensor = torch.Tensor

MATRIX_LIMIT = 160
"""Numbers of samples and frequencies up to which a matrix product is faster than FFTs."""


def chirp_z_transform(
    values: Tensor, first: float, step: float, count: int, *, matrix_limit: int = MATRIX_LIMIT
) -> Tensor:
    """The sums along the last axis of a complex tensor.

    values: (…, n) complex samples, whose positions count from their centre, (n − 1)/2.
    first, step: the first frequency and the distance between frequencies, cycles a sample.
    count: number of frequencies.
    matrix_limit: sums of at most so many samples and frequencies are computed as a matrix product.

    Returns (…, count), of the dtype of `values`.
    """
    n = values.shape[-1]
    if max(n, count) <= matrix_limit:
        return values @ dft_matrix(n, first, step, count).to(values.dtype).to(values.device).T
    j = torch.arange(n, dtype=torch.float64)
    k = torch.arange(count, dtype=torch.float64)
    lags = torch.arange(-(n - 1), count, dtype=torch.float64)
    length = next_fast_length(n + count - 1)
    before = phasor_of_turns(-(first * j + 0.5 * step * j * j))
    after = phasor_of_turns((first + k * step) * ((n - 1) / 2) - 0.5 * step * k * k)
    chirp = torch.fft.fft(phasor_of_turns(0.5 * step * lags * lags), n=length)
    spectrum = torch.fft.fft(values * before.to(values.dtype), n=length) * chirp.to(values.dtype)
    return torch.fft.ifft(spectrum)[..., n - 1 : n - 1 + count] * after.to(values.dtype)


def dft_matrix(n: int, first: float, step: float, count: int) -> Tensor:
    """The matrix of the sums, (count, n) complex128: exp(−2πi·frequency·position)."""
    frequencies = first + step * torch.arange(count, dtype=torch.float64)
    positions = centred_indices(n, torch.float64, torch.device("cpu"))
    return phasor_of_turns(-frequencies[:, None] * positions[None, :])
