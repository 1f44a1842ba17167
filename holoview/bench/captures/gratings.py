"""Gratings of grey levels, and a test pattern: whether a signal arrives at a modulator unscaled and whole.

Three faults are usual. An operating system that shows everything at 125 % resamples the pattern. A video signal of
limited range has 16 for black and 235 for white: where the sender compresses to it and nobody expands, levels merge and
the stroke shrinks by 219/255; where the receiver expands what nobody compressed, the levels up to 16 and from 235 on
become one. And lower bits are lost where a link carries fewer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Levels = NDArray[np.unsignedinteger]

CLIPPED_LEVELS = 16
"""Levels of 256 that a receiver of limited range makes one at each end: 0 to 16, and 235 to 255 (the last 20)."""


def grating(shape: tuple[int, int], period: int, low: int, high: int, *, dtype: type = np.uint8) -> Levels:
    """Bars (y, x) of two levels, half a period (pixels) wide each, one beside the other along x."""
    bars = np.where(np.arange(shape[1]) % period < period // 2, low, high)
    return np.broadcast_to(bars, shape).astype(dtype)


def signal_pattern(shape: tuple[int, int], bits: int) -> Levels:
    """A pattern (y, x) of `bits` in six bands of bars, from top to bottom.

    Bars of 1 and of 2 pixels with half the levels between them: beats of brightness along them mean that the pattern
    was resampled. Then bars of 8 pixels: of the 16 darkest of 256 levels, of as many in the middle and of the 16
    brightest; where the signal is clipped to limited range the first and the last vanish. Last one level beside the
    next, eight times along x: where all bits arrive, all eight are there.
    """
    top, dtype = 2**bits - 1, np.uint8 if bits <= 8 else np.uint16
    step, middle = (top + 1) * CLIPPED_LEVELS // 256, (top + 1) // 2
    x = np.arange(shape[1])
    unit = middle + (8 * x) // shape[1] + (x // 4) % 2
    bands = [
        grating((1, shape[1]), 2, 0, middle, dtype=dtype)[0],
        grating((1, shape[1]), 4, 0, middle, dtype=dtype)[0],
        grating((1, shape[1]), 16, 0, step, dtype=dtype)[0],
        grating((1, shape[1]), 16, middle, middle + step, dtype=dtype)[0],
        grating((1, shape[1]), 16, top - step, top, dtype=dtype)[0],
        unit.astype(dtype),
    ]
    band = np.arange(shape[0]) * len(bands) // shape[0]
    return np.stack(bands)[band]
