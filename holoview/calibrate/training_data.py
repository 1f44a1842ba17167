"""Camera images above the black level with inverse-variance weights, as tensors to train on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.dataset import Camera, Captures
from holoview.captures.predictor import Predictor
from holoview.captures.prepared_captures import PreparedCaptures, add_model_error, neighbour_variance, prepare_captures
from holoview.model.effects.active_effects import EffectValues
from holoview.util.errors import UserError

Tensor = torch.Tensor

_MIN_USABLE_SHARE = 1e-3


@dataclass(frozen=True)
class WeightedImage:
    """The image of one capture.

    light: (y, x), counts of the lasers' light.
    weight: (y, x), 1/variance in counts⁻²; 0 for a pixel that isn't used (saturated, stuck, or at the border).
    """

    light: Tensor
    weight: Tensor

    def best_gain(self, signal: Tensor) -> Tensor:
        """The factor g on a predicted signal s (y, x) that minimises Σ w·(light − g·s)²: Σ w·s·light / Σ w·s².

        It carries no gradient, because at the minimum the derivative of χ² with respect to g is zero.
        """
        with torch.no_grad():
            weighted = self.weight * signal
            return (weighted * self.light).sum() / (weighted * signal).sum().clamp_min(1e-30)

    def chi2(self, signal: Tensor, gain: Tensor | float) -> Tensor:
        """χ² per used pixel of gain · signal, Σ w·(light − g·s)² / n."""
        squares = self.weight * (self.light - gain * signal).square()
        return squares.sum() / (self.weight > 0).sum()

    def reweighted(self, camera: Camera, expected: Tensor) -> WeightedImage:
        """The same image with weights from the camera's noise at an expected signal (y, x); the used pixels stay."""
        variance = torch.from_numpy(camera.noise_variance(expected.numpy()).astype(np.float32))
        return WeightedImage(self.light, torch.where(self.weight > 0, 1 / variance, 0.0))

    def unexplained_variance(self, signal: Tensor) -> float:
        """Mean square of the residual light − g·s over the variance of the light, with the best gain g."""
        used = self.weight > 0
        light, residual = self.light[used], (self.light - self.best_gain(signal) * signal)[used]
        return float(residual.square().mean() / light.var().clamp_min(1e-30))


class TrainingData:
    """The images of all captures, to train on and to score with.

    Weights follow from the images alone (see `neighbour_variance`), so that a model can't lower its χ² by predicting
    light that widens the error bars. Raises UserError for a capture that has hardly a usable pixel.

    known: effects of the bench, {effect id: {parameter: value}}: black level and ambient light are subtracted.
    """

    def __init__(self, captures: Captures, known: EffectValues | None = None) -> None:
        self.captures = captures
        self._dark_counts = Predictor(captures).counts_without_lasers(range(len(captures)), known or {})
        self._prepared: PreparedCaptures = prepare_captures(captures)
        usable_share = self._prepared.usable.mean(axis=(1, 2))
        if float(usable_share.min()) < _MIN_USABLE_SHARE:
            worst = int(usable_share.argmin())
            raise UserError(
                f"camera/images, capture {worst}",
                "hardly a pixel can be used: all are saturated or stuck",
                expected="a picture within the camera's range",
                remedy="leave it out or take it again with a shorter exposure",
            )

    def weighted_image(self, capture: int, model_error: float = 0.0) -> WeightedImage:
        """The image of a capture of this index.

        model_error: standard deviation of the model's own error as a share of the image's mean light. Adding it to the
        camera's noise makes the weights more uniform, so that dim pixels with little noise don't dominate the fit of a
        model that is still far off.
        """
        indices: NDArray[np.intp] = np.array([capture])
        light = self._prepared.light[indices]
        variance = add_model_error(neighbour_variance(self._prepared, indices), light, model_error)
        weight = np.where(self._prepared.usable[indices], 1 / variance, 0.0).astype(np.float32)
        lasers = light[0] - np.broadcast_to(self._dark_counts, self._prepared.light.shape)[capture]
        return WeightedImage(torch.from_numpy(lasers), torch.from_numpy(weight[0]))
