"""Patterns of modulators as files that the product opens."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.pictures import PATH_PATTERN, pattern_pixels, write_png


def write_pattern(
    path: str | os.PathLike[str], drive: NDArray[np.floating], bits: int = 8, texts: Mapping[str, str] | None = None
) -> None:
    """Writes the pattern (y, x) of one modulator as a greyscale PNG, as `holoview export` does. texts: further ones."""
    write_png(path, pattern_pixels(drive, bits), {"holoview.pattern": PATH_PATTERN} | dict(texts or {}))
