"""Contrast of an image in a band of visual spatial frequencies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError


def band_contrast(image: NDArray[np.floating], degrees_per_sample: float, band: tuple[float, float]) -> float:
    """Root mean square of an image's part in a band of frequencies, over its mean.

    image: (y, x) luminance. degrees_per_sample: visual angle of a sample. band: lowest and highest frequency, cycles a
    degree. The image is multiplied by a Hann window, so that its borders don't count; a grating of modulation m has the
    contrast m/√2 (Michelson's is m).

    Raises UserError for an image that is dark, or too small or too coarse for the band.
    """
    rows, columns = image.shape
    window = np.outer(np.hanning(rows), np.hanning(columns))
    total = float((image * window).sum())
    y, x = (np.fft.fftfreq(n, degrees_per_sample) for n in image.shape)
    frequency = np.hypot(y[:, None], x[None, :])
    inside = (frequency >= band[0]) & (frequency <= band[1])
    if total <= 0 or not inside.any() or band[1] > 0.5 / degrees_per_sample:
        raise UserError(
            "contrast",
            f"an image of {columns} x {rows} samples, {1 / degrees_per_sample:.3g} a degree",
            expected=f"light, and a size and a sampling for {band[0]:g} to {band[1]:g} cycles a degree",
        )
    mean = total / float(window.sum())
    spectrum = np.fft.fft2((image - mean) * window)
    power = float((np.abs(spectrum[inside]) ** 2).sum()) / image.size
    return float(np.sqrt(power / float((window**2).sum()))) / mean
