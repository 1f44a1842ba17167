"""Camera images prepared for comparison with a model: black level subtracted, unusable pixels masked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from holoview.captures.dataset import Camera, Captures

Images = NDArray[np.float32]
Masks = NDArray[np.bool_]

BORDER_PX = 10
"""Pixels at each edge of an image that are masked: light that left the modulator's area isn't modelled well there."""
_MAX_STUCK_VARIANCE = 0.02  # over the captures, relative to the median of the neighbours, of a dead or hot pixel
_MIN_CAPTURES_FOR_STUCK = 4


@dataclass(frozen=True)
class PreparedCaptures:
    """Captures with the images as a comparison needs them.

    light: (capture, y, x), counts above the nominal black level.
    usable: (capture, y, x), False for pixels that a comparison must leave out.
    """

    captures: Captures
    light: Images
    usable: Masks

    @property
    def camera(self) -> Camera:
        """The camera's data sheet values."""
        return self.captures.camera


def prepare_captures(captures: Captures) -> PreparedCaptures:
    """Subtracts the nominal black level and masks the borders, saturated pixels and stuck pixels.

    A saturated pixel only gives a lower bound of the light. Its neighbours stay usable: charge of scientific CMOS
    sensors doesn't spill over to them.
    """
    camera = captures.camera
    light = captures.images.astype(np.float32) - np.float32(camera.black_level)
    usable = captures.images < camera.saturation
    usable &= _border_mask(captures.shape) & ~stuck_pixel_mask(captures.images)
    return PreparedCaptures(captures, light, usable)


def stuck_pixel_mask(images: NDArray[np.uint16]) -> Masks:
    """True for dead, hot and stuck pixels (y, x): they hardly vary over the captures although their neighbours do.

    All False with fewer than four captures, where the variance says too little.
    """
    if len(images) < _MIN_CAPTURES_FOR_STUCK:
        return np.zeros(images.shape[1:], dtype=bool)
    mean = images.mean(axis=0, dtype=np.float64)
    variance = sum(np.square(image - mean) for image in images) / len(images)  # a picture at a time: few of them fit
    return variance < _MAX_STUCK_VARIANCE * median_filter(variance, size=5, mode="nearest")


def _border_mask(shape: tuple[int, int]) -> Masks:
    """True inside the borders, (y, x). A border takes at most a quarter of a small image."""
    inner = np.zeros(shape, dtype=bool)
    y, x = (min(BORDER_PX, n // 4) for n in shape)
    inner[y : shape[0] - y, x : shape[1] - x] = True
    return inner
