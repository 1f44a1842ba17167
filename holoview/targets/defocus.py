"""Defocus blur kernels (square or disc), and FFT convolution without wrap-around.

In incoherent light, a point at distance d gives on the plane z the shape of the aperture, scaled to the half-width
|z − d|·tan θ with the half-angle θ of the light cone: a square for the eyebox of a pixelated modulator, a disc for a
round iris. Each sample of a kernel is the fraction of the shape's area in that pixel, so that the width needn't be a
whole number of pixels.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Aperture = Literal["square", "disc"]
_STRIPS_PER_PIXEL = 64


def diffraction_half_angle(wavelength_m: float, pitch_m: float) -> float:
    """Half-angle (rad) of the cone that a modulator of pixel pitch p diffracts into: θ = asin(λ / 2p).

    The grating equation for the finest grating that the pixels can show, of period 2p; it gives the half-width of the
    square eyebox. Arguments: wavelength and modulator pitch in metres.

    Raises ValueError when either isn't positive or λ > 2p, where no such angle exists.
    """
    if not (wavelength_m > 0 and pitch_m > 0 and wavelength_m <= 2 * pitch_m):
        raise ValueError(f"wavelength {wavelength_m} m, pitch {pitch_m} m: expected 0 < wavelength ≤ 2 · pitch")
    return math.asin(wavelength_m / (2 * pitch_m))


def blur_radius_px(distance_m: float, half_angle_rad: float, pitch_m: float) -> float:
    """Half-width of the blur, in pixels of `pitch_m`, at `distance_m` from focus: |Δz|·tan θ / pitch."""
    return abs(distance_m) * math.tan(half_angle_rad) / pitch_m


def blur_kernel(radius_px: float, aperture: Aperture) -> NDArray[np.float64]:
    """The blur of a point, shape (2r + 1, 2r + 1) with r = ceil(radius − ½) and sum 1.

    radius_px: half the side of the square, or radius of the disc. Below half a pixel the kernel is a single sample.
    The disc's area in a pixel is exact along one axis and a sum over 64 strips along the other; the average with its
    transpose makes x and y equal.
    """
    reach = max(math.ceil(radius_px - 0.5), 0)
    if reach == 0:
        return np.ones((1, 1))
    if aperture == "square":
        line = _pixel_overlap(np.array([radius_px]), reach)[0]
        shape = np.outer(line, line)
    else:
        across = (np.arange((2 * reach + 1) * _STRIPS_PER_PIXEL) + 0.5) / _STRIPS_PER_PIXEL - 0.5 - reach
        chords = np.sqrt(np.maximum(radius_px**2 - across**2, 0))
        strips = _pixel_overlap(chords, reach).reshape(2 * reach + 1, _STRIPS_PER_PIXEL, -1).sum(axis=1)
        shape = strips + strips.T
    return np.asarray(shape / shape.sum())


def kernel_share_in_frame(
    blur: NDArray[np.float64], shape: tuple[int, int], window: tuple[slice, slice] = (slice(None), slice(None))
) -> NDArray[np.float32]:
    """Fraction of the kernel inside an image of `shape` (y, x) when centred on each pixel of `window`; 1 far inside."""
    reach = blur.shape[0] // 2
    sums = np.zeros((blur.shape[0] + 1, blur.shape[1] + 1))
    sums[1:, 1:] = blur.cumsum(axis=0).cumsum(axis=1)
    (top, bottom), (left, right) = (
        (np.clip(reach - index, 0, 2 * reach + 1), np.clip(reach + size - index, 0, 2 * reach + 1))
        for size, index in ((size, np.arange(size)[part]) for size, part in zip(shape, window, strict=True))
    )
    inside = sums[bottom][:, right] - sums[top][:, right] - sums[bottom][:, left] + sums[top][:, left]
    return np.asarray(inside, dtype=np.float32)


class FftConvolver:
    """Convolves one picture (channel, y, x) with many kernels; its spectrum is computed once.

    The picture is padded with zeros by `reach`, the largest radius of a kernel, so that nothing wraps around.
    """

    def __init__(self, picture: NDArray[np.float32], reach: int) -> None:
        from scipy import fft  # slow start: a picture needs it, and most programs that can open one don't

        self._picture = picture
        self._reach = reach
        self._size = [fft.next_fast_len(max(n, reach + 1) + reach, real=True) for n in picture.shape[1:]]
        self._spectrum: NDArray[np.complex64] | None = None

    def convolve(self, blur: NDArray[np.float64]) -> NDArray[np.float32]:
        """The picture convolved with `blur`, of the same shape. Raises ValueError for a kernel wider than `reach`."""
        from scipy import fft

        reach = blur.shape[0] // 2
        if reach == 0:
            return self._picture
        if reach > self._reach:
            raise ValueError(f"kernel reaches {reach} px: expected at most {self._reach}")
        if self._spectrum is None:
            self._spectrum = fft.rfft2(self._picture, s=self._size)
        centred = np.zeros(self._size, dtype=np.float32)
        centred[: blur.shape[0], : blur.shape[1]] = blur
        transfer = fft.rfft2(np.roll(centred, (-reach, -reach), axis=(0, 1)))
        full = fft.irfft2(self._spectrum * transfer, s=self._size)
        return np.asarray(full[:, : self._picture.shape[1], : self._picture.shape[2]], dtype=np.float32)


def _pixel_overlap(half_widths: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Length of [−h, h] inside each pixel [k − ½, k + ½], k = −reach … reach; shape (len(h), 2·reach + 1)."""
    k = np.arange(-reach, reach + 1)
    h = half_widths[:, None]
    length: NDArray[np.float64] = np.maximum(np.minimum(k + 0.5, h) - np.maximum(k - 0.5, -h), 0)
    return length
