"""The discrete spectrum of one pixel: equal samples, or samples of a wave whose phase has a slope."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def pixel_spectrum(padded: int, upsample: int, slope: float) -> NDArray[np.complex128]:
    """The spectrum of one pixel along an axis, (padded,): Σ_j exp(2πi·j·(slope − k/padded)), j < upsample.

    padded: length of the FFT of samples. upsample: samples of the pixel. slope: of the phase, turns a sample.

    The FFT of an upsampled pattern is the FFT of its pixels, repeated `upsample` times, times this spectrum.
    """
    turns = slope - np.arange(padded) / padded
    spectrum: NDArray[np.complex128] = np.exp(2j * math.pi * np.outer(np.arange(upsample), turns)).sum(axis=0)
    return spectrum
