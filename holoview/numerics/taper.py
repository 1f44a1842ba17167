"""A window that falls to zero at both ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def taper(n: int, share: float) -> NDArray[np.float64]:
    """1 in the middle, falling to 0 over this share of the n samples at each end as a squared sine."""
    edge = max(2, round(share * n))
    rise = np.sin(np.pi / 2 * (np.arange(edge) + 0.5) / edge) ** 2
    window = np.ones(n)
    window[:edge], window[n - edge :] = rise, rise[::-1]
    return window
