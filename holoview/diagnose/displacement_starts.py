"""Starting values where the image as a whole has moved: tilts, shifts and decentres of any kind.

The displacement of the captures from their prediction is measured by cross-correlation, the displacement that each
parameter causes is predicted, and least squares gives the parameters that cause the measured one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from holoview.captures.prepared_captures import Images
from holoview.diagnose.comparison import Comparison
from holoview.diagnose.config import StartConfig
from holoview.diagnose.free_parameters import FittedValues
from holoview.model.effects.effect import Effect, StartKind
from holoview.util.errors import UserError

StartingValues = list[dict[str, float]]
StartProvider = Callable[[Effect], StartingValues]
Vector = NDArray[np.float64]


class DisplacementStarts:
    """For an effect, starting values that move the prediction onto the captures; none where they coincide already."""

    def __init__(self, base: FittedValues, comparison: Comparison, config: StartConfig) -> None:
        self._base, self._comparison, self._config = base, comparison, config
        light = np.where(comparison.weight > 0, comparison.light, 0.0)
        self._predicted = np.asarray(comparison.predictor(comparison.indices, base).signal)
        self._displacement = measure_displacement(light, self._predicted)

    def __call__(self, effect: Effect) -> StartingValues:
        if (
            StartKind.DISPLACEMENT not in effect.start_kinds
            or np.hypot(*self._displacement) < self._config.min_displacement_px
        ):
            return []
        movers, responses = [], []
        for p in effect.parameters:
            if p.fine or p.even or p.sharp or not p.free_entries(p.identity):
                continue
            size = p.scan[2] if p.scan else p.prior
            response = self._response(effect, {p.name: p.identity + size})
            if response is not None and np.hypot(*response) > self._config.min_response_px:
                movers.append(p)
                responses.append(response / size)
        if not movers:
            return []
        rcond = self._config.displacement_rcond
        solved = np.linalg.lstsq(np.stack(responses, axis=1), self._displacement, rcond=rcond)[0]
        return [{p.name: min(max(p.identity + d, p.low), p.high) for p, d in zip(movers, solved, strict=True)}]

    def _response(self, effect: Effect, values: dict[str, float]) -> Vector | None:
        """(y, x) pixels by which these values move the prediction; None for values that no bench can have."""
        try:
            moved = self._comparison.predictor(self._comparison.indices, {**self._base, effect.id: values})
        except UserError:
            return None
        return measure_displacement(np.asarray(moved.signal), self._predicted)


def measure_displacement(images: Images, reference: Images) -> Vector:
    """(y, x) pixels by which `images` are displaced from `reference`: the peak of the captures' summed correlation."""
    shape = images.shape[1:]
    total = np.zeros(shape)
    for image, other in zip(images, reference, strict=True):
        first, second = (np.fft.rfft2(_normalised(a)) for a in (image, other))
        total += np.fft.irfft2(first * second.conj(), s=shape)
    peak = np.unravel_index(int(np.argmax(total)), shape)
    return np.array([_subsample_peak(total, peak, axis) for axis in (0, 1)])


def _normalised(image: NDArray[np.floating]) -> NDArray[np.float64]:
    """The image without its mean, of unit power."""
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
    curvature = values[0] - 2 * values[1] + values[2]
    offset = 0.5 * (values[0] - values[2]) / curvature if curvature < 0 else 0.0
    position = int(peak[axis])
    return (position - n if position > n // 2 else position) + float(offset)
