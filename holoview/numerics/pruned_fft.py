"""Discrete Fourier transforms between a window of samples and a band of frequencies, on a longer grid of zeros.

    X_k = Σ_n x_n·exp(−2πi·k·(n + offset)/P),   x_n = 1/P·Σ_k X_k·exp(2πi·k·(n + offset)/P)

A field that fills `count` of P samples, and of whose spectrum only some frequencies pass a stop, needs neither the
other samples nor the other frequencies: in two dimensions, lines outside the window or the band are never transformed.
All functions are differentiable by torch. Markel, IEEE Trans. Audio Electroacoust. 19, 305 (1971).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

Tensor = torch.Tensor


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


def _transformed(function: Callable[..., Tensor], values: Tensor, dim: int) -> Tensor:
    """An FFT along an axis; of no lines, which not every library accepts, it is no lines."""
    return function(values, dim=dim) if values.numel() else values


def _padded(values: Tensor, dim: int, before: int, after: int) -> Tensor:
    """Values with zeros before and after them in an axis, counted from the end."""
    if before == after == 0:
        return values
    dim = dim if dim < 0 else dim - values.ndim
    return torch.nn.functional.pad(values, [0, 0] * (-dim - 1) + [before, after])
