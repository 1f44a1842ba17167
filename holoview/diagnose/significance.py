"""Whether movements from capture to capture have a common direction: jitter has none, a fault has one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

Floats = NDArray[np.float64]


def mean_is_significant(samples: Floats, p_value: float) -> NDArray[np.bool_]:
    """Whether means over the first axis are larger than those of zero-mean jitter, but for a probability `p_value`.

    Two-sided t-test (Student), since the scatter of a few captures is itself uncertain. A single sample is significant.
    """
    if len(samples) < 2:
        return np.ones(samples.shape[1:], dtype=bool)
    standard_error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return np.abs(samples.mean(axis=0)) > student.isf(p_value / 2, len(samples) - 1) * standard_error
