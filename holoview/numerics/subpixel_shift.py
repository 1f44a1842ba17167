"""Moving pictures by fractions of a pixel, and their slopes, with a windowed sinc: exact up to about 0.8 of Nyquist."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

Images = NDArray[np.float32]
Floats = NDArray[np.float64]

_REACH, _BETA = 6, 5.0  # taps each side; Kaiser's window
_SLOPE_REACH, _SLOPE_BAND = 8, 0.8  # taps each side; of Nyquist, up to which slopes are right to 2 %
_TAPS = np.arange(-_REACH, _REACH + 1, dtype=np.float64)


def shift_images(images: Images, shift: Floats) -> Images:
    """Pictures (capture, y, x), each moved by its (y, x) pixels; edges go on outwards."""
    result = np.empty_like(images)
    for image, (y, x), out in zip(images, shift, result, strict=True):
        out[...] = _along_both(image, _sinc_kernel(float(y)), _sinc_kernel(float(x)))
    return result


def image_gradient(images: Images) -> tuple[Images, Images]:
    """∂/∂y and ∂/∂x per pixel."""
    kernel = _gradient_kernel()
    return tuple(convolve1d(images, kernel, axis=axis, mode="nearest") for axis in (1, 2))


def _along_both(image: NDArray[np.float32], y: Floats, x: Floats) -> NDArray[np.float32]:
    return np.asarray(convolve1d(convolve1d(image, y, axis=0, mode="nearest"), x, axis=1, mode="nearest"))


def _sinc_kernel(shift: float) -> Floats:
    kernel = np.sinc(_TAPS - shift) * _window(_TAPS - shift)
    return np.asarray(kernel / kernel.sum())


@cache
def _gradient_kernel() -> Floats:
    """An odd kernel whose response Σ 2cₙ sin(ωn) is nearest to ω, in least squares of the relative error."""
    n = np.arange(1, _SLOPE_REACH + 1)
    frequency = np.linspace(1e-3, _SLOPE_BAND, 50 * _SLOPE_REACH) * np.pi
    response = 2.0 * np.sin(np.outer(frequency, n)) / frequency[:, None]
    c = np.linalg.lstsq(response, np.ones_like(frequency), rcond=None)[0]
    return np.concatenate([c[::-1], [0.0], -c])


def _window(at: Floats) -> Floats:
    inside = np.sqrt(np.maximum(1.0 - np.square(at / (_REACH + 1)), 0.0))
    return np.asarray(np.i0(_BETA * inside) / np.i0(_BETA))
