"""Lasers that drift from capture to capture: a nuisance like jitter of exposures, as long as the drift has no direction.

To first order a capture's residual is r = δ·∂r/∂λ; δ follows by least squares for each capture, from the slopes of one
more prediction. Drift is nobody's fault where it takes the residuals to the noise and its mean doesn't stand out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.unknowns import Found, unknowns
from holoview.effects.effect import Effect

_STANDS_OUT = 3.0  # σ of the mean
DRIFTING = "wavelength_offset"


@dataclass(frozen=True)
class Drift:
    """R.m.s. drift (SI) over the captures, and χ²/n once each capture has its own."""

    rms: float
    chi2: float
    has_direction: bool


def drift(comparison: Comparison, values: Found, effect: Effect) -> Drift:
    """What is left when the effect's first parameter may differ in each capture."""
    free = unknowns([effect])
    x = free.pack(values)
    step = free.bounds().step[0]
    before = comparison.fit(values).residual
    after = comparison.fit(free.unpack(x + step * np.eye(len(x))[0], values)).residual
    slope = (after - before) / np.float32(step)
    power = np.maximum(np.einsum("kyx,kyx->k", slope, slope, dtype=np.float64), 1e-30)
    amount = -np.einsum("kyx,kyx->k", slope, before, dtype=np.float64) / power
    left = before + amount.astype(np.float32)[:, None, None] * slope
    chi2 = float(np.einsum("kyx,kyx->", left, left, dtype=np.float64) / comparison.count)
    doubt = float(amount.std(ddof=1) / np.sqrt(len(amount))) if len(amount) > 1 else 0.0
    rms = float(np.sqrt(np.mean(np.square(amount))) * free.entries[0][1].prior)
    return Drift(rms, chi2, abs(float(amount.mean())) > _STANDS_OUT * doubt)
