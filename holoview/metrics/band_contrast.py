"""Contrast of an image in a band of visual spatial frequencies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError

Band = tuple[float, float]


def band_contrast(image: NDArray[np.floating], degrees_per_sample: float, band: Band) -> float:
    """Root mean square of an image's part in a band of frequencies, over its mean.

    image: (y, x) luminance. degrees_per_sample: visual angle of a sample. band: lowest and highest frequency, cycles a
    degree. The image is multiplied by a Hann window, so that its borders don't count; a grating of modulation m has the
    contrast m/√2 (Michelson's is m).

    Raises UserError for an image that is dark, or too small or too coarse for the band.
    """
    spectrum = _band_spectrum(image, degrees_per_sample, band)
    return float(np.sqrt((np.abs(spectrum) ** 2).sum()))


def contrast_like(
    image: NDArray[np.floating], reference: NDArray[np.floating], degrees_per_sample: float, band: Band
) -> float:
    """The contrast in a band of the part of an image that is like a reference of the same shape (y, x).

    The part is the reference's structure times the factor that fits best, so that speckle and other structure don't
    count; where contrast is reversed, it is negative. The other arguments are those of `band_contrast`, and of the
    reference with itself it is that.

    Raises UserError as `band_contrast` does.
    """
    seen, wanted = (_band_spectrum(each, degrees_per_sample, band) for each in (image, reference))
    size = float(np.sqrt((np.abs(wanted) ** 2).sum()))
    return float((wanted.conj() * seen).sum().real) / size if size > 0 else 0.0


def _band_spectrum(image: NDArray[np.floating], degrees_per_sample: float, band: Band) -> NDArray[np.complex128]:
    """Fourier coefficients in the band of an image over its mean, whose squares add to the squared contrast."""
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
    spectrum = np.fft.fft2((image / mean - 1) * window)[inside]
    return np.asarray(spectrum / np.sqrt(image.size * float((window**2).sum())))
