"""Correlation of predicted and seen speckle, insensitive to what benches do to brightness and position.

A picture becomes its contrast: the root of the light, divided by its blurred background. Beams, vignetting and the
laser's power drop out, and few bright grains don't dominate. Contrasts are compared at several blurs and at all small
shifts. With p and q the power spectra of two unrelated contrasts, each normalised to a sum of 1, the correlation has
the variance

    var ρ = κ · Σ_f p(f)·q(f) = 1/G,   κ = N·Σw⁴/(Σw²)²

(Bartlett's formula in the frequency domain; κ accounts for the window w on N pixels). G is the number of independent
speckle grains.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.captures.records.settings import RecordSettings
from holoview.numerics.sampling import taper

Floats = NDArray[np.float64]
_MAX_CORRELATION = 0.9999  # atanh of 1 is infinite


@dataclass(frozen=True, eq=False)
class Contrast:
    """Spectra of one picture's contrast at every blur, (blur, y, x), of norm 1, and their powers."""

    spectra: NDArray[np.complex64]

    @cached_property
    def powers(self) -> NDArray[np.float32]:
        """|spectrum|², whose sum is 1 at each blur."""
        return np.square(np.abs(self.spectra))


@dataclass(frozen=True, eq=False)
class Match:
    """z = atanh ρ of one picture at every blur and shift, (blur, dy, dx); grains: G at each blur."""

    z: Floats
    grains: Floats


class SpeckleComparison:
    """Compares pictures of one shape (rows, columns)."""

    def __init__(self, shape: tuple[int, int], settings: RecordSettings) -> None:
        self._settings = settings
        self._bin = max(1, min(shape) // settings.side_px)
        self.shape = (shape[0] // self._bin, shape[1] // self._bin)
        self._window = np.outer(*(taper(n, settings.taper) for n in self.shape)).astype(np.float32)
        fy, fx = (scipy.fft.fftfreq(n) for n in self.shape)
        squared = fy[:, None] ** 2 + fx[None, :] ** 2
        blurs = np.array(settings.blurs_px)[:, None, None]
        self._blur = np.exp(-2 * (np.pi * blurs) ** 2 * squared).astype(np.float32)
        w2 = np.square(self._window, dtype=np.float64)
        self._window_factor = w2.size * float(np.square(w2).sum()) / float(w2.sum()) ** 2
        reach = max(1, round(settings.max_shift * min(self.shape)))
        shifts = np.arange(-reach, reach + 1)
        self._to_rows = torch.from_numpy(np.exp(2j * np.pi * np.outer(shifts, fy)).astype(np.complex64))
        self._to_columns = torch.from_numpy(np.exp(2j * np.pi * np.outer(fx, shifts)).astype(np.complex64))

    def contrast(self, light: NDArray[np.floating]) -> Contrast:
        """The contrast of a picture of light (y, x) in any unit; without light it is zero."""
        rows, columns = (n * self._bin for n in self.shape)
        binned = light[:rows, :columns].reshape(self.shape[0], self._bin, self.shape[1], self._bin).mean(axis=(1, 3))
        amplitude = np.sqrt(np.maximum(binned, 0.0)).astype(np.float32)
        background = gaussian_filter(amplitude, self._settings.background * min(self.shape), mode="nearest")
        floor = 1e-3 * float(background.max()) + 1e-30
        contrast = (amplitude - background) / np.maximum(background, floor)
        contrast -= np.average(contrast, weights=self._window)
        spectra = scipy.fft.fft2(contrast * self._window)[None] * self._blur
        norm = np.sqrt(np.square(np.abs(spectra)).sum(axis=(1, 2), keepdims=True))
        return Contrast((spectra / np.maximum(norm, 1e-30)).astype(np.complex64))

    def match(self, seen: Contrast, predicted: Contrast) -> Match:
        """The correlation at every shift of the seen picture.

        torch multiplies the matrices, because its threads are chosen where the work is: numpy's, for as small ones as
        these, wait for each other for most of the time where other programs run.
        """
        cross = torch.from_numpy(np.conj(predicted.spectra) * seen.spectra)
        correlation = (self._to_rows @ cross @ self._to_columns).real.double().numpy()
        variance = self._window_factor * np.einsum("byx,byx->b", seen.powers, predicted.powers, dtype=np.float64)
        clipped = np.clip(correlation, -_MAX_CORRELATION, _MAX_CORRELATION)
        return Match(np.arctanh(clipped), 1.0 / np.maximum(variance, 1e-12))

    @property
    def shift_count(self) -> int:
        """How many shifts are tried."""
        return len(self._to_rows) ** 2
