"""Starting values where the picture is smeared along a line: the residual's part that second derivatives explain.

To first order, a line of length (y, x) adds (y²·m_yy + 2·y·x·m_yx + x²·m_xx)/24 to the prediction m. Least squares give
the three coefficients; their symmetric matrix has the line along its principal axis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from holoview.diagnose.comparison import Comparison, GainFit
from holoview.diagnose.displacement_starts import StartingValues
from holoview.model.effects.effect import Effect, StartKind


class SmearStarts:
    """For an effect that smears images along a line, the line that the captures suggest; none for others."""

    def __init__(self, fitted: GainFit, comparison: Comparison) -> None:
        self._line = _principal_line(_second_moments(fitted, comparison))

    def __call__(self, effect: Effect) -> StartingValues:
        if self._line is None or StartKind.SMEAR not in effect.start_kinds:
            return []
        return [dict(zip(("length_y", "length_x"), self._line, strict=True))]


def _second_moments(fitted: GainFit, comparison: Comparison) -> NDArray[np.float64]:
    """24 times the coefficients of the second derivatives, as the symmetric matrix (y, x) × (y, x), px²."""
    model = fitted.expected
    yy, xx = (correlate1d(model, (1.0, -2.0, 1.0), axis=axis, mode="nearest") for axis in (1, 2))
    yx = np.gradient(np.gradient(model, axis=1), axis=2)
    columns = np.stack([(comparison.weight * m).ravel() for m in (model, yy, 2 * yx, xx)])
    normal = (columns @ columns.T).astype(np.float64)
    right = (columns @ fitted.residual.ravel()).astype(np.float64)
    _, a, b, c = np.linalg.lstsq(normal, right, rcond=None)[0]
    return 24 * np.array([[a, b], [b, c]])


def _principal_line(moments: NDArray[np.float64]) -> tuple[float, float] | None:
    """(y, x) of the line with the moments' largest principal value, y ≥ 0; None where no value is positive."""
    values, axes = np.linalg.eigh(moments)
    if not values[-1] > 0:
        return None
    y, x = np.sqrt(values[-1]) * axes[:, -1] * (1.0 if axes[0, -1] >= 0 else -1.0)
    return float(y), float(x)
