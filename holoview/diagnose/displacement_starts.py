"""Where to start when the picture as a whole has moved: tilts, shifts, decentres of whatever kind.

The pictures' displacement against the prediction is measured by cross-correlation, the displacement that each parameter
causes is computed, and the parameters that would cause the measured one follow: no effect is known by name here.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from holoview.captures.prepared_captures import Images
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.free_parameters import FittedValues
from holoview.model.effects.effect import Effect
from holoview.util.errors import UserError

StartProvider = Callable[[Effect], list[dict[str, float]]]
Vector = NDArray[np.float64]

_LEAST_PX = 0.3  # below, a local fit starts well from the identity
_LEAST_RESPONSE_PX = 0.05  # of a parameter's typical size; below, it doesn't move pictures


def displacement_starts(base: FittedValues, comparison: Comparison) -> StartProvider:
    """For an effect, starting values that move the prediction onto the captures; none where they lie on it already."""
    light = np.where(comparison.weight > 0, comparison.light, 0.0)
    nominal = np.asarray(comparison.predictor(comparison.indices, base).signal)
    wanted = measure_displacement(light, nominal)

    def of(effect: Effect) -> list[dict[str, float]]:
        if np.hypot(*wanted) < _LEAST_PX:
            return []
        movers, columns = [], []
        for p in effect.parameters:
            if p.fine or p.even or p.sharp:
                continue
            size = p.scan[2] if p.scan else p.prior
            try:
                moved = comparison.predictor(comparison.indices, {**base, effect.id: {p.name: p.identity + size}})
            except UserError:
                continue
            response = measure_displacement(np.asarray(moved.signal), nominal)
            if np.hypot(*response) > _LEAST_RESPONSE_PX:
                movers.append(p)
                columns.append(response / size)
        if not movers:
            return []
        solved = np.linalg.lstsq(np.stack(columns, axis=1), wanted, rcond=0.05)[0]
        start = {p.name: min(max(p.identity + d, p.low), p.high) for p, d in zip(movers, solved, strict=True)}
        return [start]

    return of


def measure_displacement(images: Images, reference: Images) -> Vector:
    """(y, x) in pixels by which `images` lie beyond `reference`, captures together: the peak of the correlation."""
    shape = images.shape[1:]
    total = np.zeros(shape)
    for image, other in zip(images, reference, strict=True):
        first, second = (np.fft.rfft2(_normalised(a)) for a in (image, other))
        total += np.fft.irfft2(first * second.conj(), s=shape)
    peak = np.unravel_index(int(np.argmax(total)), shape)
    return np.array([_subsample_peak(total, peak, axis) for axis in (0, 1)])


def _normalised(image: NDArray[np.floating]) -> NDArray[np.float64]:
    """Without its mean, unit power."""
    a = image - image.mean(dtype=np.float64)
    return np.asarray(a / max(float(np.linalg.norm(a)), 1e-30), dtype=np.float64)


def _subsample_peak(correlation: NDArray[np.float64], peak: tuple[np.intp, ...], axis: int) -> float:
    """The peak's position on one axis by a parabola through three samples, in −n/2 … n/2."""
    n = correlation.shape[axis]
    values = []
    for step in (-1, 0, 1):
        at = list(peak)
        at[axis] = (peak[axis] + step) % n
        values.append(correlation[tuple(at)])
    curve = values[0] - 2 * values[1] + values[2]
    offset = 0.5 * (values[0] - values[2]) / curve if curve < 0 else 0.0
    position = int(peak[axis])
    return (position - n if position > n // 2 else position) + float(offset)
