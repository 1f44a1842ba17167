"""Starting values where a shifted copy lies over the image: peaks of the residual's correlation with the prediction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison, GainFit
from holoview.diagnose.config import StartConfig
from holoview.diagnose.displacement_starts import StartingValues
from holoview.model.effects.effect import Effect, StartKind


class GhostStarts:
    """For an effect that copies images, the shifts and strengths that the captures suggest; none for others."""

    def __init__(self, fitted: GainFit, comparison: Comparison, config: StartConfig) -> None:
        model = np.where(comparison.weight > 0, fitted.expected, 0.0)
        self._peaks = _correlation_peaks(comparison.residual_counts(fitted), model, config)

    def __call__(self, effect: Effect) -> StartingValues:
        if StartKind.GHOST not in effect.start_kinds:
            return []
        return [{"strength": s, "shift_y": float(y), "shift_x": float(x)} for s, y, x in self._peaks]


def _correlation_peaks(
    residual: NDArray[np.float32], model: NDArray[np.float32], config: StartConfig
) -> list[tuple[float, int, int]]:
    """(strength, y, x) of the highest positive peaks away from zero shift."""
    shape = model.shape[1:]
    centred = model - model.mean(axis=(1, 2), keepdims=True)
    spectra = zip(np.fft.rfft2(residual), np.fft.rfft2(centred), strict=True)
    total = np.fft.irfft2(sum(r * m.conj() for r, m in spectra), s=shape)
    power = float(np.square(centred, dtype=np.float64).sum())
    y, x = (np.fft.fftfreq(n, 1 / n).round().astype(int) for n in shape)
    total[np.hypot(y[:, None], x[None, :]) < config.ghost_min_shift_px] = -np.inf
    peaks = []
    for _ in range(config.ghost_peaks):
        at = np.unravel_index(int(np.argmax(total)), shape)
        if not total[at] > 0:
            break
        peaks.append((float(min(total[at] / power, 1.0)), int(y[at[0]]), int(x[at[1]])))
        away = np.hypot(_wrapped(y - y[at[0]], shape[0])[:, None], _wrapped(x - x[at[1]], shape[1])[None, :])
        total[away < config.ghost_separation_px] = -np.inf
    return peaks


def _wrapped(difference: NDArray[np.int_], n: int) -> NDArray[np.int_]:
    """Differences of positions on a period of n, in −n/2 … n/2."""
    return (difference + n // 2) % n - n // 2
