"""What the camera saw, ready to be compared: counts above black, and which pixels may be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from holoview.captures.dataset import Camera, Captures

Images = NDArray[np.float32]
Masks = NDArray[np.bool_]

BORDER = 10  # pixels at the edge of the picture that are left out: light from beyond the modulator's edge ends there
_STUCK = 0.02  # a pixel that varies less than this share of its neighbours' variance over the captures is dead or hot
_LEAST_FOR_STUCK = 4  # captures


@dataclass(frozen=True)
class PreparedCaptures:
    """light (capture, y, x): counts above the nominal black level. usable (capture, y, x): trusted pixels."""

    captures: Captures
    light: Images
    usable: Masks

    @property
    def camera(self) -> Camera:
        """The camera as its maker describes it."""
        return self.captures.camera


def prepare_captures(captures: Captures) -> PreparedCaptures:
    """Black subtracted; borders, saturated pixels and pixels that never change left out.

    A saturated pixel tells only "at least so much". Its neighbours in the picture stay: charge doesn't spill over in
    the sensors that this field uses.
    """
    camera = captures.camera
    light = captures.images.astype(np.float32) - np.float32(camera.black_level)
    usable = captures.images < camera.saturation
    usable &= _border_mask(captures.shape) & ~stuck_pixel_mask(captures.images)
    return PreparedCaptures(captures, light, usable)


def stuck_pixel_mask(images: NDArray[np.uint16]) -> Masks:
    """Pixels (y, x) that hardly vary over the captures although those around them do: dead, hot or stuck ones."""
    if len(images) < _LEAST_FOR_STUCK:
        return np.zeros(images.shape[1:], dtype=bool)
    variance = images.var(axis=0, dtype=np.float64)
    return variance < _STUCK * median_filter(variance, size=5, mode="nearest")


def _border_mask(shape: tuple[int, int]) -> Masks:
    """True away from the border; of small pictures at least the middle half is kept."""
    inner = np.zeros(shape, dtype=bool)
    y, x = (min(BORDER, n // 4) for n in shape)
    inner[y : shape[0] - y, x : shape[1] - x] = True
    return inner
