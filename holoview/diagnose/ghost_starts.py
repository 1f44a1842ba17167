"""Where to start when a shifted copy lies over the picture: peaks of the residual's correlation with the prediction.

Known by its parameters, not by its name: an effect with a strength and a shift (y, x) in pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.displacement_starts import StartProvider
from holoview.diagnose.free_parameters import FittedValues
from holoview.model.effects.effect import Effect

_NAMES = {"strength", "shift_y", "shift_x"}
_PEAKS, _NEAREST_PX, _APART_PX = 3, 3, 3


def ghost_starts(base: FittedValues, comparison: Comparison) -> StartProvider:
    """For an effect that copies pictures, the shifts and strengths that the captures suggest; none for others."""
    fitted = comparison.fit_gains(base)
    usable = comparison.weight > 0
    residual = np.where(usable, fitted.residual / np.where(usable, comparison.weight, 1.0), 0.0)
    model = np.where(usable, fitted.expected, 0.0)
    peaks = _correlation_peaks(residual, model)

    def of(effect: Effect) -> list[dict[str, float]]:
        units = {p.name: p.unit for p in effect.parameters}
        if set(units) != _NAMES or units["shift_y"] != "px":
            return []
        return [{"strength": s, "shift_y": float(y), "shift_x": float(x)} for s, y, x in peaks]

    return of


def _correlation_peaks(residual: NDArray[np.float32], model: NDArray[np.float32]) -> list[tuple[float, int, int]]:
    """(strength, y, x) of the strongest positive correlations away from zero shift."""
    shape = model.shape[1:]
    detailed = model - model.mean(axis=(1, 2), keepdims=True)
    spectra = zip(np.fft.rfft2(residual), np.fft.rfft2(detailed), strict=True)
    total = np.fft.irfft2(sum(r * m.conj() for r, m in spectra), s=shape)
    power = float(np.square(detailed, dtype=np.float64).sum())
    y, x = (np.fft.fftfreq(n, 1 / n).round().astype(int) for n in shape)
    total[np.hypot(y[:, None], x[None, :]) < _NEAREST_PX] = -np.inf
    found = []
    for _ in range(_PEAKS):
        at = np.unravel_index(int(np.argmax(total)), shape)
        if not total[at] > 0:
            break
        found.append((float(min(total[at] / power, 1.0)), int(y[at[0]]), int(x[at[1]])))
        away = np.hypot(_wrapped(y - y[at[0]], shape[0])[:, None], _wrapped(x - x[at[1]], shape[1])[None, :])
        total[away < _APART_PX] = -np.inf
    return found


def _wrapped(difference: NDArray[np.int_], n: int) -> NDArray[np.int_]:
    return (difference + n // 2) % n - n // 2
