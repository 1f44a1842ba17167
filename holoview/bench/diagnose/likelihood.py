"""Residuals of a prediction in units of the noise, with the free numbers of each capture fitted in closed form.

For capture k with counts y, counts b without the lasers (black level, ambient light), prediction m and frozen weights
w = 1/σ,

    r = w·(y − b − a·m),   a = Σ w²(y − b)m / Σ w²m²

so that the radiometric scale and jitter of exposure and laser power never count as an error of the model. With
`fit_shifts` a sub-pixel movement of the camera in each capture, beyond the movement that all captures share, is fitted
too. A shared movement is an effect (`camera_alignment`) and stays in the residual.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from holoview.bench.captures.predictor import Prediction
from holoview.bench.captures.prepared_captures import Images, PreparedCaptures
from holoview.light.numerics.subpixel_shift import image_gradient, shift_images
from holoview.util.errors import UserError

_MAX_SHIFT_PX = 0.5
"""[px] Largest movement of the camera in one capture. Evidence: the first order says nothing beyond it."""
_FIRST_ORDER_SHIFT_PX = 0.02  # [px] Movements up to here are taken out in one step, larger ones in two.
_TYPICAL_SHIFT_PX = 0.2
"""[px] Standard deviation of the Gaussian prior of a movement. Evidence: the screening study's jitter of 0.5 µm is
0.125 px of a camera with a pitch of 4 µm."""
_SHARED_SHIFT_P_VALUE = 1e-4
"""[1] A mean movement with less than this probability under jitter alone is shared, and stays in the residual.
Evidence: few captures reach 5 σ of the mean by chance."""
_MAX_PART_PIXELS = 4_000_000
"""[1] Derivatives of so many pixels, or of one capture, are held at a time. Evidence: measured: with all of eight
pictures of 1600 × 1200 pixels, two processes took 9 to 11 GB."""
_INFEASIBLE_FACTOR = 10.0
"""[1] Residuals of parameters that no bench can have are so many times those of a dark image. Evidence: they must
exceed the residuals of every possible bench."""

Values = Mapping[str, Mapping[str, float]]
Floats = NDArray[np.float64]

_CAMERA_POSE = "camera_alignment"


class PredictorProtocol(Protocol):
    """A predictor of captures that counts the fields it was asked for, as `holoview.bench.captures.predictor.Predictor`
    does."""

    @property
    def fields_requested(self) -> int: ...

    def __call__(self, indices: NDArray[np.intp], values: Values, *, grad: bool = False) -> Prediction: ...


@dataclass(frozen=True)
class GainFit:
    """A prediction scaled to the captures.

    residual (capture, y, x): whitened residuals, in σ. gain (capture,): fitted scale. expected (capture, y, x): counts
    above black, of all light. shift (capture, 2): movement of the camera, (y, x) pixels; None where it wasn't fitted.
    """

    residual: Images
    gain: Floats
    expected: Images
    shift: Floats | None = None

    @property
    def squares(self) -> Floats:
        """Σ residual² of each capture."""
        return np.einsum("kyx,kyx->k", self.residual, self.residual, dtype=np.float64)


class Comparison:
    """Some captures with frozen weights, with which any prediction is compared.

    indices: the captures. variance (capture, y, x): of the noise, counts²; pixels that aren't usable get weight zero.
    fit_shifts: fit a movement of the camera in each capture.
    """

    def __init__(
        self,
        predictor: PredictorProtocol,
        data: PreparedCaptures,
        indices: NDArray[np.intp],
        variance: Images,
        *,
        fit_shifts: bool = False,
    ) -> None:
        self.predictor, self.data, self.indices = predictor, data, indices
        self.fit_shifts = fit_shifts
        usable = data.usable[indices]
        self.light = data.light[indices]
        self.weight = np.where(usable, 1.0 / np.sqrt(variance), 0.0).astype(np.float32)
        self.pixels_per_capture = usable.sum(axis=(1, 2)).astype(np.float64)
        self._weighted_light = self.weight * self.light

    def __getstate__(self) -> dict[str, Any]:
        """The state without arrays that the captures hold, so that jobs for other processes stay small."""
        return {name: value for name, value in vars(self).items() if name not in ("light", "_weighted_light")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.light = self.data.light[self.indices]
        self._weighted_light = self.weight * self.light

    def fitting_shifts(self) -> Comparison:
        """The same comparison with the movements of the camera fitted."""
        other = copy(self)
        other.fit_shifts = True
        return other

    def with_predictor(self, predictor: PredictorProtocol) -> Comparison:
        """The same captures and weights with another predictor."""
        other = copy(self)
        other.predictor = predictor
        return other

    def parts(self) -> list[tuple[slice, Comparison]]:
        """Comparisons of some captures each, with their place in the flat residuals. One comparison where there are few
        pixels, and where movements are fitted, because their mean depends on all captures.
        """
        count, pixels = self.weight.shape[0], self.weight[0].size
        size = max(1, _MAX_PART_PIXELS // pixels)
        if self.fit_shifts or size >= count:
            return [(slice(None), self)]
        starts = range(0, count, size)
        return [(slice(k * pixels, (k + size) * pixels), self._of_captures(slice(k, k + size))) for k in starts]

    def _of_captures(self, some: slice) -> Comparison:
        """The same comparison for some of the captures; shares their arrays."""
        other = copy(self)
        for name in ("indices", "light", "weight", "pixels_per_capture", "_weighted_light"):
            setattr(other, name, getattr(self, name)[some])
        return other

    @property
    def pixel_count(self) -> float:
        """Number of pixels that are compared."""
        return float(self.pixels_per_capture.sum())

    def fit_gains(self, values: Values) -> GainFit:
        """The prediction for these effects with the best gain, and movement if fitted, of each capture.

        Raises UserError for values that no bench can have.
        """
        prediction = self.predictor(self.indices, values)
        signal = np.asarray(prediction.signal, dtype=np.float32)
        dark = prediction.counts_without_lasers(self.data.camera.black_level)
        light = self._weighted_light - dark * self.weight if dark.any() else self._weighted_light
        if self.fit_shifts:
            fitted = self._fit_with_shifts(light, self.weight * signal, signal, values)
        else:
            fitted = _fit_gain(light, self.weight, signal)
        if prediction.ambient is None:
            return fitted
        return replace(fitted, expected=fitted.expected + prediction.ambient.numpy().astype(np.float32))

    @property
    def infeasible_residual(self) -> NDArray[np.float32]:
        """Residuals, flat, for parameters that no bench can have: worse than those of a dark image."""
        return np.float32(_INFEASIBLE_FACTOR) * self._weighted_light.ravel()

    def residual(self, values: Values) -> NDArray[np.float32]:
        """Whitened residuals, flat: the vector whose sum of squares a fit minimises."""
        return self.fit_gains(values).residual.ravel()

    def chi2_per_pixel(self, values: Values) -> float:
        """Mean squared whitened residual of a pixel."""
        return float(self.fit_gains(values).squares.sum() / self.pixel_count)

    def deviance(self, values: Values) -> float:
        """−2 ln of the Gaussian likelihood of the captures, Σ (residual² + ln σ²), but for a constant of the data.

        It compares weights too: χ² alone falls with every variance that is too large.
        """
        usable = self.weight > 0
        log_variance = -2.0 * np.log(self.weight, where=usable, out=np.zeros_like(self.weight)).sum(dtype=np.float64)
        return float(self.fit_gains(values).squares.sum() + log_variance)

    def residual_counts(self, fitted: GainFit) -> Images:
        """The residuals of a fit in counts (capture, y, x); 0 where a pixel isn't usable."""
        usable = self.weight > 0
        return np.where(usable, fitted.residual / np.where(usable, self.weight, 1.0), 0.0)

    def _fit_with_shifts(self, light: Images, model: Images, signal: Images, values: Values) -> GainFit:
        """Gains and movements of each capture together; the movement that all captures share stays in the residual.

        light, model: weighted captures and prediction. Movements beyond the first order are found in two steps: first
        with shifted images, then with exact predictions for a moved camera; the better result is returned.
        """
        limit = _MAX_SHIFT_PX
        shift = self._estimate_shifts(light, model, signal)
        if np.abs(shift).max() <= _FIRST_ORDER_SHIFT_PX:
            own = shift - self._common_shift(shift)
            return replace(_fit_gain(light, self.weight, shift_images(signal, own)), shift=shift)
        nearer = shift_images(signal, shift)
        shift = np.clip(shift + self._estimate_shifts(light, self.weight * nearer, nearer), -limit, limit)
        fits = [_fit_gain(light, self.weight, shift_images(signal, shift - self._common_shift(shift)))]
        moved = self.predict_moved_camera(values, shift)
        if moved is not None:
            exact = np.clip(shift + self._estimate_shifts(light, self.weight * moved, moved), -limit, limit)
            own_moved = self.predict_moved_camera(values, exact - self._common_shift(exact))
            if own_moved is not None:
                fits.append(replace(_fit_gain(light, self.weight, own_moved), shift=exact))
        best = min(fits, key=lambda fit: float(fit.squares.sum()))
        return best if best.shift is not None else replace(best, shift=shift)

    def predict_moved_camera(self, values: Values, shift: Floats) -> Images | None:
        """Predictions with the camera moved by `shift` (capture, 2) pixels; None where no bench can have it there."""
        pitch = self.data.camera.pitch_m
        signals = []
        for index, (y, x) in zip(self.indices, shift * pitch, strict=True):
            pose = dict(values.get(_CAMERA_POSE, {}))
            pose |= {name: pose.get(name, 0.0) + float(by) for name, by in (("shift_y", y), ("shift_x", x))}
            try:
                moved = self.predictor(np.array([index]), {**values, _CAMERA_POSE: pose})
            except UserError:
                return None
            signals.append(np.asarray(moved.signal)[0])
        return np.stack(signals).astype(np.float32)

    def _estimate_shifts(self, light: Images, model: Images, signal: Images) -> Floats:
        """(y, x) pixels by which each capture is displaced from the signal, to first order, its gain fitted too."""
        slope_y, slope_x = image_gradient(signal)
        columns = np.stack([model, self.weight * slope_y, self.weight * slope_x], axis=1)
        flat = columns.reshape(len(signal), 3, -1)
        normal = (flat @ flat.transpose(0, 2, 1)).astype(np.float64)
        right = np.einsum("kcp,kp->kc", flat, light.reshape(len(signal), -1), dtype=np.float64)
        gain = np.abs(right[:, 0]) / np.maximum(normal[:, 0, 0], 1e-30)
        for axis in (1, 2):  # the prior of a movement
            normal[:, axis, axis] += 1.0 / np.maximum(gain * _TYPICAL_SHIFT_PX, 1e-12) ** 2
        normal += 1e-9 * np.eye(3) * np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-30 * np.eye(3)
        solved = np.linalg.solve(normal, right[..., None])[..., 0]
        positive_gain = np.where(solved[:, 0] > 0, solved[:, 0], np.inf)
        limit = _MAX_SHIFT_PX
        return np.asarray(np.clip(-solved[:, 1:] / positive_gain[:, None], -limit, limit))

    def _common_shift(self, shift: Floats) -> Floats:
        """The mean movement on each axis where it is significant against the scatter of the captures, else zero."""
        return np.where(mean_is_significant(shift, _SHARED_SHIFT_P_VALUE), shift.mean(axis=0), 0.0)


def _fit_gain(light: Images, weight: Images, signal: Images) -> GainFit:
    """A signal with the least-squares gain of each capture. light: weighted counts above black."""
    model = weight * signal
    power = np.maximum(np.einsum("kyx,kyx->k", model, model, dtype=np.float64), 1e-30)
    gain = np.einsum("kyx,kyx->k", light, model, dtype=np.float64) / power
    factor = gain.astype(np.float32)[:, None, None]
    return GainFit(light - factor * model, gain, factor * signal)


def mean_is_significant(samples: NDArray[np.float64], p_value: float) -> NDArray[np.bool_]:
    """Whether means over the first axis exceed the means of zero-mean jitter, but for a probability `p_value`.

    Two-sided t-test (Student), since the scatter of a few captures is itself uncertain. A single sample is significant.
    """
    if len(samples) < 2:
        return np.ones(samples.shape[1:], dtype=bool)
    standard_error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return np.abs(samples.mean(axis=0)) > student.isf(p_value / 2, len(samples) - 1) * standard_error
