"""Exposure times that use the camera's range without saturation, found from picture to picture."""

from __future__ import annotations

import numpy as np

from holoview.captures.dataset import Camera
from holoview.rig.devices import CameraDevice, Counts

BRIGHT_QUANTILE = 0.999
"""This quantile of the pixels counts as a picture's brightest; single ones may be dust or hot pixels."""

_TARGET, _ENOUGH, _TOO_MUCH = 0.8, 0.4, 0.95  # of the range above black
_STEP, _TRIES = 8.0, 12


def take_exposed(
    camera: CameraDevice, facts: Camera, start_s: float, bright_quantile: float = BRIGHT_QUANTILE
) -> tuple[Counts, float]:
    """A picture whose brightest pixels reach 0.4 to 0.95 of the range, or as near as exposures reach; and its exposure.

    start_s: the first exposure that is tried. bright_quantile: of the pixels, those above are the brightest.
    """
    low, high = camera.exposures_s
    exposure = camera.set_exposure(float(np.clip(start_s, low, high)))
    picture = camera.take()
    for _ in range(_TRIES):
        share = range_share(picture, facts, bright_quantile)
        if _ENOUGH <= share <= _TOO_MUCH:
            break
        factor = 1 / _STEP if share > _TOO_MUCH else float(np.clip(_TARGET / max(share, 1e-6), 1 / _STEP, _STEP))
        wanted = float(np.clip(exposure * factor, low, high))
        if wanted == exposure:
            break
        exposure = camera.set_exposure(wanted)
        picture = camera.take()
    return picture, exposure


def range_share(picture: Counts, facts: Camera, bright_quantile: float = BRIGHT_QUANTILE) -> float:
    """What the brightest pixels reach of the range above the black level."""
    bright = float(np.quantile(picture, bright_quantile))
    return (bright - facts.black_level) / (facts.saturation - facts.black_level)


def exposure_note(picture: Counts, facts: Camera) -> str:
    """In words, how a picture is exposed badly; "" if it isn't."""
    share = range_share(picture, facts)
    if share > _TOO_MUCH:
        return "too bright"
    return "too dark" if share < _ENOUGH else ""
