"""Captures beside their prediction: whitened residuals with the nuisances of each capture taken out.

For capture k with counts y, black b, prediction m and frozen weights w = 1/σ,

    r = w·(y − b − a·m),   a = Σ w²(y − b)m / Σ w²m²

so the radiometric scale, jitter of exposure and of laser power never count as an error of the model. With `shifts` a
sub-pixel movement of the camera in this capture, beyond what all captures share, is taken out too: to first order
r − s·(w·a·∇m), s by least squares. A shared movement is an effect (`camera_alignment`) and stays in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.measured import Images, Measured

Values = Mapping[str, Mapping[str, float]]
Floats = NDArray[np.float64]

_MOST_SHIFT = 0.5  # pixels; beyond, the first order says nothing
_STANDS_OUT = 5.0  # σ of the mean
_TYPICAL_SHIFT = 0.2  # pixels, prior of the shift's size


class Prediction(Protocol):
    """signal (capture, y, x) before the radiometric scale; offset: the camera's black level in counts."""

    @property
    def signal(self) -> object: ...

    @property
    def offset(self) -> float: ...


class Predicts(Protocol):
    """What `holoview.captures.predict.Predictor` does."""

    def __call__(self, indices: NDArray[np.intp], values: Values) -> Prediction: ...


@dataclass(frozen=True)
class Fitted:
    """A prediction brought to the captures: residual and expected signal (capture, y, x), gain of each capture."""

    residual: Images
    gain: Floats
    expected: Images
    shift: Floats | None = None

    @property
    def squares(self) -> Floats:
        """Σ residual² of each capture."""
        return np.einsum("kyx,kyx->k", self.residual, self.residual, dtype=np.float64)


class Comparison:
    """Some captures with frozen weights; compares any prediction with them.

    variance (capture, y, x) in counts²; pixels that aren't usable get weight zero.
    """

    def __init__(
        self, predictor: Predicts, measured: Measured, indices: NDArray[np.intp], variance: Images, shifts: bool = False
    ) -> None:
        self.predictor, self.measured, self.indices, self.shifts = predictor, measured, indices, shifts
        usable = measured.usable[indices]
        self.light = measured.light[indices]
        self.weight = np.where(usable, 1.0 / np.sqrt(variance), 0.0).astype(np.float32)
        self.pixels = usable.sum(axis=(1, 2)).astype(np.float64)
        self._weighted = self.weight * self.light

    @property
    def count(self) -> float:
        """Number of pixels that are compared."""
        return float(self.pixels.sum())

    def fit(self, values: Values) -> Fitted:
        """The prediction for these effects, with gains (and shifts) that suit the captures best."""
        prediction = self.predictor(self.indices, values)
        signal = np.asarray(prediction.signal, dtype=np.float32)
        extra = np.float32(prediction.offset - self.measured.camera.black_level)
        data = self._weighted - extra * self.weight if extra else self._weighted
        model = self.weight * signal
        power = np.maximum(np.einsum("kyx,kyx->k", model, model, dtype=np.float64), 1e-30)
        gain = np.einsum("kyx,kyx->k", data, model, dtype=np.float64) / power
        if not self.shifts:
            return Fitted(data - _each(gain) * model, gain, _each(gain) * signal)
        return self._shifted(data, model, signal, gain)

    def residual(self, values: Values) -> NDArray[np.float32]:
        """Whitened residuals, flat: what a fit makes small."""
        return self.fit(values).residual.ravel()

    def chi2(self, values: Values) -> float:
        """Mean squared whitened residual of a pixel."""
        return float(self.fit(values).squares.sum() / self.count)

    def per_capture(self, values: Values) -> Floats:
        """Mean squared whitened residual of each capture."""
        return self.fit(values).squares / np.maximum(self.pixels, 1.0)

    def _shifted(self, data: Images, model: Images, signal: Images, gain: Floats) -> Fitted:
        """Gains and movements of each capture together, then the movements' mean put back."""
        slope_y, slope_x = gradient(signal)
        columns = np.stack([model, self.weight * slope_y, self.weight * slope_x], axis=1)
        flat = columns.reshape(len(gain), 3, -1)
        normal = (flat @ flat.transpose(0, 2, 1)).astype(np.float64)
        right = np.einsum("kcp,kp->kc", flat, data.reshape(len(gain), -1), dtype=np.float64)
        for axis in (1, 2):
            normal[:, axis, axis] += 1.0 / (np.maximum(gain, 1e-12) * _TYPICAL_SHIFT) ** 2
        solved = np.linalg.solve(normal + 1e-12 * np.eye(3) * np.trace(normal, axis1=1, axis2=2)[:, None, None], right[..., None])[..., 0]
        safe = np.where(np.abs(gain) > 0, gain, 1.0)
        shift = np.clip(-solved[:, 1:] / safe[:, None], -_MOST_SHIFT, _MOST_SHIFT)
        shift = shift - _shared(shift)
        moved = -_each(gain * shift[:, 0]) * slope_y - _each(gain * shift[:, 1]) * slope_x
        weighted = self.weight * moved
        left = data - weighted
        power = np.maximum(np.einsum("kyx,kyx->k", model, model, dtype=np.float64), 1e-30)
        gain = np.einsum("kyx,kyx->k", left, model, dtype=np.float64) / power
        return Fitted(left - _each(gain) * model, gain, _each(gain) * signal + moved, shift)


def _shared(shift: Floats) -> Floats:
    """The movement that all captures share: their mean, where it stands out from their scatter, else none."""
    mean = shift.mean(axis=0)
    doubt = shift.std(axis=0, ddof=1) / np.sqrt(len(shift)) if len(shift) > 1 else np.zeros(2)
    return np.where(np.abs(mean) > _STANDS_OUT * doubt, mean, 0.0)


def gradient(images: Images) -> tuple[Images, Images]:
    """∂/∂y and ∂/∂x (per pixel) by a five-point stencil of fourth order; the outermost two pixels are zero."""
    result = []
    for axis in (1, 2):
        slope = np.zeros_like(images)
        n = images.shape[axis]
        if n >= 5:
            at = [_along(axis, slice(k, n - 4 + k)) for k in range(5)]
            slope[at[2]] = (8 * (images[at[3]] - images[at[1]]) - (images[at[4]] - images[at[0]])) / np.float32(12)
        result.append(slope)
    return result[0], result[1]


def _along(axis: int, part: slice) -> tuple[slice, ...]:
    return tuple(part if a == axis else slice(None) for a in range(3))


def _each(values: Floats) -> NDArray[np.float32]:
    """One number a capture, to multiply images."""
    return values.astype(np.float32)[:, None, None]
