"""By how much χ² would fall, to first order, if a pixel of a modulator kept to a level; for all pixels at once.

Let G = ∂χ²/∂Re t + i·∂χ²/∂Im t be the derivative by the complex transmission t of a pixel, which one adjoint pass of
the model gives for all pixels of all modulators. A pixel that shows the share s of the stroke has the transmission
exp(2πi·s·stroke/λ), so that its replacement changes χ² by Re[G*·(exp(2πi·s·stroke/λ) − t)]: to first order in the light
of one pixel, however far its phase is off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.transmission_slopes import TransmissionSlope, transmission_slopes

Floats = NDArray[np.float64]


def replacement_gains(
    context: SearchContext, base: FittedValues, comparison: Comparison, levels: Floats, *, earlier: bool = False
) -> dict[int, Floats]:
    """The fall of χ² for each level and pixel, (level, y, x), of every modulator by its number, 0 for the first.

    levels (level,): shares of the stroke. earlier: two more, for pixels that show the first pattern of the session, and
    that of the capture before.
    """
    gains: dict[int, Floats] = {}
    for found in transmission_slopes(context, base, comparison):
        shares, modulator = levels[:, None, None], found.modulator
        if earlier:
            patterns = _earlier_patterns(comparison, found.position, modulator.number)
            shares = np.concatenate([np.broadcast_to(shares, (len(levels), *modulator.shape)), patterns])
        gains[modulator.number] = gains.get(modulator.number, 0.0) + _gain_of_shares(found, shares)
    return gains


def line_gains(gains: Floats, axis: int, segments: int) -> Floats:
    """The gain of whole lines along an axis of (level, y, x), robust against parts of a line that gain alone."""
    parts = _segment_gains(gains, axis, segments)
    return np.asarray(segments * np.median(parts, axis=0))


def line_significance(gains: Floats, axis: int, segments: int, least: int) -> Floats:
    """How far lines stand out (level, line): whole ones, or parts of `least` segments and more from one edge on."""
    parts = _segment_gains(gains, axis, segments)
    spans = [parts, *(half for n in range(least, segments) for half in (parts[:n], parts[-n:]))]
    return np.asarray(np.max([significance(len(span) * np.median(span, axis=0)) for span in spans], axis=0))


def _segment_gains(gains: Floats, axis: int, segments: int) -> Floats:
    """The gain of each part of a line, (segment, level, line)."""
    return np.stack([part.sum(axis=axis) for part in np.array_split(gains, segments, axis=axis)])


def significance(gains: Floats) -> Floats:
    """How far each gain is above the median of its level (first axis), in robust standard deviations."""
    flat = gains.reshape(len(gains), -1)
    above = flat - np.median(flat, axis=1, keepdims=True)
    scale = np.maximum(1.4826 * np.median(np.abs(above), axis=1, keepdims=True), 1e-30)
    return np.asarray((above / scale).reshape(gains.shape))


def _earlier_patterns(comparison: Comparison, position: int, modulator: int) -> Floats:
    """Shares of the stroke (pattern, y, x) that were sent first of all, and before a capture of a comparison."""
    captures = comparison.data.captures
    before = captures.drive_before(int(comparison.indices[position]))
    return np.stack([captures.first_drive[modulator], before[modulator]])


def _gain_of_shares(found: TransmissionSlope, shares: Floats) -> Floats:
    """−Re[G*·(exp(2πi·s·stroke/λ) − t)] of each share s (share, y, x) and pixel; samples of a pixel are summed."""
    conjugate, of = found.slope.conj(), found.modulator
    own, towards = (found.of_pixels(a) for a in ((conjugate * found.transmission).real, conjugate))
    phasors = np.exp(2j * np.pi * of.stroke_m / of.wavelength_m * shares)
    return np.asarray(own - (towards * phasors).real, dtype=np.float64)
