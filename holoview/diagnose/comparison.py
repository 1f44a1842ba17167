"""Captures beside their prediction: whitened residuals with the nuisances of each capture taken out.

For capture k with counts y, black b, prediction m and frozen weights w = 1/σ,

    r = w·(y − b − a·m),   a = Σ w²(y − b)m / Σ w²m²

so the radiometric scale, jitter of exposure and of laser power never count as an error of the model. With `shifts` a
sub-pixel movement of the camera in this capture, beyond what all captures share, is taken out too. A shared movement is
an effect (`camera_alignment`) and stays in.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.captures.prepared_captures import Images, PreparedCaptures
from holoview.diagnose.significance import mean_is_significant
from holoview.numerics.subpixel_shift import image_gradient, shift_images
from holoview.util.errors import UserError

Values = Mapping[str, Mapping[str, float]]
Floats = NDArray[np.float64]

_MOST_SHIFT = 0.5  # pixels; beyond, the first order says nothing
_AIM = "camera_alignment"
_FIRST_ORDER = 0.02  # pixels; beyond, the movement is found in two steps
_CHANCE = 1e-4  # that the movements of a shaking camera have such a mean
_TYPICAL_SHIFT = 0.2  # pixels, prior of the shift's size


class Prediction(Protocol):
    """signal (capture, y, x) before the radiometric scale; offset: the camera's black level in counts."""

    @property
    def signal(self) -> Any: ...

    @property
    def black_level(self) -> float: ...


class PredictorProtocol(Protocol):
    """What `holoview.captures.predictor.Predictor` does."""

    def __call__(self, indices: NDArray[np.intp], values: Values, *, grad: bool = False) -> Prediction: ...


@dataclass(frozen=True)
class GainFit:
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
        self,
        predictor: PredictorProtocol,
        data: PreparedCaptures,
        indices: NDArray[np.intp],
        variance: Images,
        fit_shifts: bool = False,
    ) -> None:
        self.predictor, self.measured, self.indices, self.fit_shifts = predictor, data, indices, fit_shifts
        usable = data.usable[indices]
        self.light = data.light[indices]
        self.weight = np.where(usable, 1.0 / np.sqrt(variance), 0.0).astype(np.float32)
        self.pixels_per_capture = usable.sum(axis=(1, 2)).astype(np.float64)
        self._weighted = self.weight * self.light

    def fitting_shifts(self) -> Comparison:
        """The same, with the movements of the camera in each capture taken out."""
        shaking = copy(self)
        shaking.fit_shifts = True
        return shaking

    def with_predictor(self, predictor: PredictorProtocol) -> Comparison:
        """The same captures and weights with another predictor."""
        other = copy(self)
        other.predictor = predictor
        return other

    @property
    def pixel_count(self) -> float:
        """Number of pixels that are compared."""
        return float(self.pixels_per_capture.sum())

    def fit_gains(self, values: Values) -> GainFit:
        """The prediction for these effects, with gains (and shifts) that suit the captures best."""
        prediction = self.predictor(self.indices, values)
        signal = np.asarray(prediction.signal, dtype=np.float32)
        extra = np.float32(prediction.black_level - self.measured.camera.black_level)
        data = self._weighted - extra * self.weight if extra else self._weighted
        if not self.fit_shifts:
            return _fit_gain(data, self.weight, signal)
        return self._fit_with_shifts(data, self.weight * signal, signal, values)

    @property
    def infeasible_residual(self) -> NDArray[np.float32]:
        """Residuals far worse than those of any bench: ten times what a dark picture would leave."""
        return np.float32(10.0) * self._weighted.ravel()

    def residual(self, values: Values) -> NDArray[np.float32]:
        """Whitened residuals, flat: what a fit makes small."""
        return self.fit_gains(values).residual.ravel()

    def chi2_per_pixel(self, values: Values) -> float:
        """Mean squared whitened residual of a pixel."""
        return float(self.fit_gains(values).squares.sum() / self.pixel_count)

    def per_capture(self, values: Values) -> Floats:
        """Mean squared whitened residual of each capture."""
        return self.fit_gains(values).squares / np.maximum(self.pixels_per_capture, 1.0)

    def _fit_with_shifts(self, data: Images, model: Images, signal: Images, values: Values) -> GainFit:
        """Gains and movements of each capture together; what all captures share of the movements stays in."""
        shift = self._estimate_shifts(data, model, signal)
        if np.abs(shift).max() <= _FIRST_ORDER:
            own = shift - _common_shift(shift)
            return replace(_fit_gain(data, self.weight, shift_images(signal, own)), shift=shift)
        nearer = shift_images(signal, shift)
        shift = np.clip(shift + self._estimate_shifts(data, self.weight * nearer, nearer), -_MOST_SHIFT, _MOST_SHIFT)
        fits = [_fit_gain(data, self.weight, shift_images(signal, shift - _common_shift(shift)))]
        aimed = self._predict_moved_camera(values, shift)
        if aimed is not None:
            exact = np.clip(shift + self._estimate_shifts(data, self.weight * aimed, aimed), -_MOST_SHIFT, _MOST_SHIFT)
            again = self._predict_moved_camera(values, exact - _common_shift(exact))
            fits += [] if again is None else [replace(_fit_gain(data, self.weight, again), shift=exact)]
        best = min(fits, key=lambda fit: float(fit.squares.sum()))
        return best if best.shift is not None else replace(best, shift=shift)

    def _predict_moved_camera(self, values: Values, shift: Floats) -> Images | None:
        """Predictions with the camera moved: not exact where pictures hold detail beyond their pixels."""
        pitch = self.measured.camera.pitch_m
        signals = []
        for index, (y, x) in zip(self.indices, shift * pitch, strict=True):
            own = dict(values.get(_AIM, {}))
            own |= {name: own.get(name, 0.0) + float(by) for name, by in (("shift_y", y), ("shift_x", x))}
            try:
                signals.append(np.asarray(self.predictor(np.array([index]), {**values, _AIM: own}).signal)[0])
            except UserError:
                return None
        return np.stack(signals).astype(np.float32)

    def _estimate_shifts(self, data: Images, model: Images, signal: Images) -> Floats:
        """(y, x) pixels by which each capture lies beyond the signal, to first order, its gain fitted too."""
        slope_y, slope_x = image_gradient(signal)
        columns = np.stack([model, self.weight * slope_y, self.weight * slope_x], axis=1)
        flat = columns.reshape(len(signal), 3, -1)
        normal = (flat @ flat.transpose(0, 2, 1)).astype(np.float64)
        right = np.einsum("kcp,kp->kc", flat, data.reshape(len(signal), -1), dtype=np.float64)
        gain = np.abs(right[:, 0]) / np.maximum(normal[:, 0, 0], 1e-30)
        for axis in (1, 2):
            normal[:, axis, axis] += 1.0 / np.maximum(gain * _TYPICAL_SHIFT, 1e-12) ** 2
        normal += 1e-9 * np.eye(3) * np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-30 * np.eye(3)
        solved = np.linalg.solve(normal, right[..., None])[..., 0]
        safe = np.where(solved[:, 0] > 0, solved[:, 0], np.inf)
        return np.asarray(np.clip(-solved[:, 1:] / safe[:, None], -_MOST_SHIFT, _MOST_SHIFT))


def _fit_gain(data: Images, weight: Images, signal: Images) -> GainFit:
    """A signal with the gains that suit the weighted data best."""
    model = weight * signal
    power = np.maximum(np.einsum("kyx,kyx->k", model, model, dtype=np.float64), 1e-30)
    gain = np.einsum("kyx,kyx->k", data, model, dtype=np.float64) / power
    return GainFit(data - _per_capture_factor(gain) * model, gain, _per_capture_factor(gain) * signal)


def _common_shift(shift: Floats) -> Floats:
    """The movement that all captures share: their mean, where it stands out from their scatter, else none."""
    return np.where(mean_is_significant(shift, _CHANCE), shift.mean(axis=0), 0.0)


def _per_capture_factor(values: Floats) -> NDArray[np.float32]:
    """One number a capture, to multiply images."""
    return values.astype(np.float32)[:, None, None]
