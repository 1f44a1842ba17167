"""Whether what moves from capture to capture moves the same way: jitter has no direction, a fault has one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

Floats = NDArray[np.float64]


def mean_is_significant(samples: Floats, p_value: float) -> NDArray[np.bool_]:
    """Whether means over the first axis are larger than jitter gives with a probability of `chance`.

    By Student's t: the scatter of a few captures is itself known badly. A single sample stands out.
    """
    if len(samples) < 2:
        return np.ones(samples.shape[1:], dtype=bool)
    doubt = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return np.abs(samples.mean(axis=0)) > student.isf(p_value / 2, len(samples) - 1) * doubt
