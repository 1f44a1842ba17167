"""The middle of large pictures, in which a search finds causes faster than in whole ones."""

from __future__ import annotations

import math

from holoview.captures.dataset import Captures
from holoview.captures.records.central_region import central_region
from holoview.diagnose.config.preparation import RegionConfig


def middle_of(captures: Captures, config: RegionConfig, further_speckles: int = 0) -> Captures:
    """The middle of a session, whatever it saves.

    In the near field some pixels of the modulators across, with a margin for light that walks off. On a Fourier bench
    some speckles across, fewer the more captures there are, and `further_speckles` on either side.
    """
    if not captures.is_fourier:
        return central_region(captures, config.side_px, config.further_px)
    enough = math.ceil(math.sqrt(config.all_speckles / len(captures)))
    side = min(config.side_px, max(config.min_side_speckles, enough))
    return central_region(captures, side, further_speckles)


def saving(whole: Captures, cut: Captures) -> float:
    """How many times the modulator's pixels a session has of those of its middle, on a Fourier bench the camera's."""
    parts = (whole.images, cut.images) if whole.is_fourier else (whole.levels, cut.levels)
    return parts[0].size / parts[1].size
