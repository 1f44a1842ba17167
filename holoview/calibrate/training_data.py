"""What the camera saw, as tensors: light above black and how much each pixel weighs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.dataset import Camera, Captures
from holoview.captures.noise_model import add_model_error, neighbour_variance
from holoview.captures.prepared_captures import PreparedCaptures, prepare_captures
from holoview.util.errors import UserError

Tensor = torch.Tensor


@dataclass(frozen=True)
class WeightedImage:
    """One capture: light (y, x) counts above black; weight (y, x): 1/variance, 0 where a pixel can't be trusted."""

    light: Tensor
    weight: Tensor

    def best_gain(self, signal: Tensor) -> Tensor:
        """The scale of a predicted signal (y, x) that fits best; no gradient: at the best fit it makes none."""
        with torch.no_grad():
            weighted = self.weight * signal
            return (weighted * self.light).sum() / (weighted * signal).sum().clamp_min(1e-30)

    def chi2(self, signal: Tensor, gain: Tensor | float) -> Tensor:
        """χ² a trusted pixel of a signal times its gain."""
        squares = self.weight * (self.light - gain * signal).square()
        return squares.sum() / (self.weight > 0).sum()

    def reweighted(self, camera: Camera, expected: Tensor) -> WeightedImage:
        """With the camera's noise at the expected signal (y, x) for weights; trusted pixels stay the same."""
        variance = torch.from_numpy(camera.noise_variance(expected.numpy()).astype(np.float32))
        return WeightedImage(self.light, torch.where(self.weight > 0, 1 / variance, 0.0))

    def unexplained_variance(self, signal: Tensor) -> float:
        """Share of the picture's variance that the best scaled signal leaves."""
        trusted = self.weight > 0
        light, rest = self.light[trusted], (self.light - self.best_gain(signal) * signal)[trusted]
        return float(rest.square().mean() / light.var().clamp_min(1e-30))


class TrainingData:
    """All captures of a session. Weights come from the pictures themselves, so that no model earns its own."""

    def __init__(self, captures: Captures) -> None:
        self.captures = captures
        self._measured: PreparedCaptures = prepare_captures(captures)
        trusted = self._measured.usable.mean(axis=(1, 2))
        if float(trusted.min()) < 1e-3:
            worst = int(trusted.argmin())
            raise UserError(
                f"camera/images, capture {worst}",
                "hardly a pixel can be used: all are saturated or stuck",
                expected="a picture within the camera's range",
                remedy="leave it out or take it again with a shorter exposure",
            )

    def weighted_image(self, capture: int, model_error: float = 0.0) -> WeightedImage:
        """One capture, for a model that is still off by `mismatch` of the picture's mean light."""
        only: NDArray[np.intp] = np.array([capture])
        light = self._measured.light[only]
        variance = add_model_error(neighbour_variance(self._measured, only), light, model_error)
        weight = np.where(self._measured.usable[only], 1 / variance, 0.0).astype(np.float32)
        return WeightedImage(torch.from_numpy(light[0]), torch.from_numpy(weight[0]))
