"""Discrete Fourier transforms of a part of the samples, at a part of the frequencies; all differentiable by torch.

    X_k = Σ_n x_n·exp(−2πi·k·(n + offset)/P),   x_n = 1/P·Σ_k X_k·exp(2πi·k·(n + offset)/P)

Between a window and a band: a field that fills `count` of P samples, and of whose spectrum only some frequencies pass a
stop, needs neither the other samples nor the other frequencies. In two dimensions, lines outside the window or the band
are never transformed. Markel, IEEE Trans. Audio Electroacoust. 19, 305 (1971).

At any equally spaced frequencies: the chirp-z transform.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from holoview.light.numerics.resample import centred_indices
from holoview.light.numerics.sampling import next_fast_length


@dataclass(frozen=True)
class PrunedAxis:
    """One axis: `count` samples from `offset` on a grid of `padded`, and `frequencies` indices from `lowest` upwards.

    padded: P. offset, count: the window, inside the grid. lowest: signed index of the band's first frequency.
    frequencies: number of frequencies in the band, at most P. Frequencies are periodic in P.
    """

    padded: int
    offset: int
    count: int
    lowest: int
    frequencies: int

    @staticmethod
    def for_band(padded: int, offset: int, count: int, lowest: int, highest: int) -> PrunedAxis:
        """The axis of a band from `lowest` to `highest`, both included; of `fftfreq` order if that is all."""
        frequencies = max(0, highest - lowest + 1)
        return PrunedAxis(padded, offset, count, 0 if frequencies >= padded else lowest, min(frequencies, padded))

    @property
    def indices(self) -> NDArray[np.int64]:
        """The signed frequency index of each entry of a spectrum, from −P/2 to (P − 1)/2; (frequencies,)."""
        half = self.padded // 2
        return (np.arange(self.frequencies) + self.lowest + half) % self.padded - half

    def forward(self, field: Tensor, dim: int) -> Tensor:
        """The spectrum in the band, `frequencies` long in an axis, of a field that is `count` long there."""
        return self._to_band(torch.fft.fft, field, dim)

    def inverse(self, spectrum: Tensor, dim: int) -> Tensor:
        """The field in the window, `count` long in an axis, of a spectrum that is `frequencies` long there."""
        return self._to_window(torch.fft.ifft, spectrum, dim)

    def forward_transposed(self, spectrum: Tensor, dim: int) -> Tensor:
        """The matrix of `forward`, transposed and not conjugated: Σ_k X_k·exp(−2πi·k·(n + offset)/P) in the window."""
        return self._to_window(torch.fft.fft, spectrum, dim)

    def inverse_transposed(self, field: Tensor, dim: int) -> Tensor:
        """The matrix of `inverse`, transposed: 1/P·Σ_n x_n·exp(2πi·k·(n + offset)/P) in the band."""
        return self._to_band(torch.fft.ifft, field, dim)

    def inverse_at(self, spectrum: Tensor, index: int, dim: int) -> Tensor:
        """The sample of an index of `inverse`, without its axis."""
        weights = self.sample_phasor(index).to(spectrum.dtype).to(spectrum.device)
        return torch.tensordot(torch.movedim(spectrum, dim, -1), weights, dims=1)

    def sample_phasor(self, index: int) -> Tensor:
        """1/P·exp(2πi·k·(index + offset)/P) of each frequency: `inverse_transposed` of a 1 at a sample, complex128."""
        turns = torch.from_numpy((self.indices * (index + self.offset)) % self.padded).double() / self.padded
        return phasor_of_turns(turns) / self.padded

    def _to_band(self, function: Callable[..., Tensor], field: Tensor, dim: int) -> Tensor:
        after = self.padded - self.offset - self.count
        spectrum = _transformed(function, _padded(field, dim, self.offset, after), dim)
        first = self.lowest % self.padded
        start = spectrum.narrow(dim, first, min(self.frequencies, self.padded - first))
        missing = self.frequencies - start.shape[dim]
        return start if missing == 0 else torch.cat([start, spectrum.narrow(dim, 0, missing)], dim=dim)

    def _to_window(self, function: Callable[..., Tensor], spectrum: Tensor, dim: int) -> Tensor:
        first, rest = self.lowest % self.padded, self.padded - self.frequencies
        missing = max(0, first + self.frequencies - self.padded)
        if missing:
            wrapped = spectrum.narrow(dim, self.frequencies - missing, missing)
            start = spectrum.narrow(dim, 0, self.frequencies - missing)
            spectrum = torch.cat([_padded(wrapped, dim, 0, rest), start], dim=dim)
        else:
            spectrum = _padded(spectrum, dim, first, rest - first)
        return _transformed(function, spectrum, dim).narrow(dim, self.offset, self.count)


@dataclass(frozen=True)
class PrunedTransform:
    """Two axes (y, x): fields (…, count_y, count_x) and spectra (…, frequencies_y, frequencies_x)."""

    axes: tuple[PrunedAxis, PrunedAxis]

    def forward(self, field: Tensor) -> Tensor:
        """The spectrum in the band, which is that of the padded field."""
        y, x = self.axes
        return y.forward(x.forward(field, -1), -2)

    def inverse(self, spectrum: Tensor) -> Tensor:
        """The field in the window, of a spectrum that is zero outside the band."""
        y, x = self.axes
        return x.inverse(y.inverse(spectrum, -2), -1)

    def inverse_lines(self, spectrum: Tensor, row: int, column: int) -> tuple[Tensor, Tensor]:
        """One row (count_x,) and one column (count_y,) of `inverse`, which need no transform of the whole."""
        y, x = self.axes
        return x.inverse(y.inverse_at(spectrum, row, -2), -1), y.inverse(x.inverse_at(spectrum, column, -1), -1)

    def at_sample(self, row: int, column: int) -> Tensor:
        """W (frequencies_y, frequencies_x) complex128 with `inverse`(X) at the sample (row, column) = Σ W·X."""
        y, x = self.axes
        return y.sample_phasor(row)[:, None] * x.sample_phasor(column)[None, :]

    def forward_transposed(self, spectrum: Tensor) -> Tensor:
        """The matrix of `forward`, transposed and not conjugated."""
        y, x = self.axes
        return x.forward_transposed(y.forward_transposed(spectrum, -2), -1)

    def inverse_transposed(self, field: Tensor) -> Tensor:
        """The matrix of `inverse`, transposed."""
        y, x = self.axes
        return y.inverse_transposed(x.inverse_transposed(field, -1), -2)


def _transformed(function: Callable[..., Tensor], values: Tensor, dim: int) -> Tensor:
    """An FFT along an axis; of no lines, which not every library accepts, it is no lines."""
    return function(values, dim=dim) if values.numel() else values


def _padded(values: Tensor, dim: int, before: int, after: int) -> Tensor:
    """Values with zeros before and after them in an axis, counted from the end."""
    if before == after == 0:
        return values
    dim = dim if dim < 0 else dim - values.ndim
    return torch.nn.functional.pad(values, [0, 0] * (-dim - 1) + [before, after])


# --- chirp-z transform ------------------------------------------------------------------------------------------------

# X_k = Σ_j x_j·exp(−2πi·(first + k·step)·(j − (n − 1)/2)),  k = 0 … count − 1
#
# Bluestein's algorithm: with j·k = (j² + k² − (k − j)²)/2 the sum becomes a convolution with a chirp, which FFTs of n +
# count − 1 samples compute (Rabiner, Schafer and Rader, Bell Syst. Tech. J. 48, 1249 (1969)). Small sums are a matrix
# product instead. Phases are computed in float64 whatever the precision of the samples.


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
        return values @ _matrix(n, first, step, count, values.dtype).to(values.device).T
    before, chirp, after = _chirps(n, first, step, count, values.dtype)
    length = len(chirp)
    spectrum = torch.fft.fft(values * before, n=length) * chirp
    return torch.fft.ifft(spectrum)[..., n - 1 : n - 1 + count] * after


# A camera stays where it is while other effects are fitted: the same factors serve thousands of pictures. They are
# ordinary tensors, which derivatives may pass, whatever the mode of the first call.


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _chirps(n: int, first: float, step: float, count: int, dtype: torch.dtype) -> tuple[Tensor, Tensor, Tensor]:
    """The factor of the samples, (n,), that of their spectrum, and the factor of the sums, (count,)."""
    j = torch.arange(n, dtype=torch.float64)
    k = torch.arange(count, dtype=torch.float64)
    lags = torch.arange(-(n - 1), count, dtype=torch.float64)
    before = phasor_of_turns(-(first * j + 0.5 * step * j * j))
    after = phasor_of_turns((first + k * step) * ((n - 1) / 2) - 0.5 * step * k * k)
    chirp = torch.fft.fft(phasor_of_turns(0.5 * step * lags * lags), n=next_fast_length(n + count - 1))
    return before.to(dtype), chirp.to(dtype), after.to(dtype)


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _matrix(n: int, first: float, step: float, count: int, dtype: torch.dtype) -> Tensor:
    return dft_matrix(n, first, step, count).to(dtype)


def dft_matrix(n: int, first: float, step: float, count: int) -> Tensor:
    """The matrix of the sums, (count, n) complex128: exp(−2πi·frequency·position)."""
    frequencies = first + step * torch.arange(count, dtype=torch.float64)
    positions = centred_indices(n, torch.float64, torch.device("cpu"))
    return phasor_of_turns(-frequencies[:, None] * positions[None, :])


# --- phases in turns --------------------------------------------------------------------------------------------------


def phasor_of_turns(turns: torch.Tensor) -> torch.Tensor:
    """exp(2πi·turns) of a real tensor of any shape, complex of the same precision.

    The turns are reduced modulo 1 first, so that thousands of turns cost no precision in the sine and cosine.
    """
    phase = (2 * math.pi) * torch.remainder(turns, 1.0)
    return torch.polar(torch.ones_like(phase), phase)
