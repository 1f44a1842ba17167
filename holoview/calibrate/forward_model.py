"""Differentiable forward model: predicts camera images from the maps that are being learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import torch

from holoview.captures.dataset import Captures
from holoview.captures.predictor import Predictor
from holoview.effects.calibrated import Calibrated
from holoview.model.effects.active_effects import EffectValues
from holoview.model.effects.learned_maps import LearnedMaps, MapCache, MapLayout
from holoview.model.effects.parameter import Values

Tensor = torch.Tensor

PRIOR_SIGMA: Mapping[str, float] = {
    "lut_steps": 0.5,
    "fringing_px2": 0.2,
    "source_log_amplitude": 0.5,
    "source_opd_m": 200e-9,
    "warp_m": 20e-6,
    "zernike1_m": 200e-9,
    "zernike2_m": 200e-9,
    "pupil1_log_amplitude": 0.3,
    "pupil2_log_amplitude": 0.3,
}
"""Standard deviation of the Gaussian prior of each tensor's elements, in the tensor's unit.

The prior has its mean at the nominal bench, so elements that the captures don't determine stay near zero.
"""

_CACHE_MB = 128


class _TrainableCalibrated(Calibrated):
    """The effect `calibrated` with maps in memory instead of in a file, so that gradients reach their tensors."""

    listed: ClassVar[bool] = False

    def __init__(self) -> None:
        self.current_maps: LearnedMaps | None = None

    def maps(self, v: Values) -> LearnedMaps:
        assert self.current_maps is not None
        return self.current_maps


class CalibrationModel:
    """Predicts the camera images of captures for given maps.

    captures: their patterns and conditions; the images aren't used.
    layout: of the maps.
    known: {effect id: {parameter: value}} of effects that the bench has besides the maps.
    double_precision: computes in complex128 instead of complex64.
    """

    def __init__(
        self, captures: Captures, layout: MapLayout, known: EffectValues, *, double_precision: bool = False
    ) -> None:
        self.layout, self.known = layout, dict(known)
        self._effect = _TrainableCalibrated()
        self._predictor = Predictor(
            captures, extra_effects=(self._effect,), double_precision=double_precision, cache_mb=_CACHE_MB
        )
        self._map_cache, self._version = MapCache(), 0

    def set_maps(self, tensors: Mapping[str, Tensor]) -> None:
        """Sets the tensors to predict with; must be called again after a tensor was changed in place."""
        self._map_cache.of_tensors = {}
        self._effect.current_maps = LearnedMaps(self.layout, tensors, self._map_cache)
        self._version += 1

    def predict(self, indices: Sequence[int], *, grad: bool = False) -> Tensor:
        """Predicted images (capture, y, x) of captures, with the maps, up to one factor per capture.

        grad: whether the result carries gradients with respect to the tensors.
        """
        # the predictor caches by parameter values: a new version number makes it evaluate the maps again
        table = {**self.known, _TrainableCalibrated.id: {"file": f"version {self._version}"}}
        return self._predictor(indices, table, grad=grad).signal

    def predict_nominal(self, indices: Sequence[int]) -> Tensor:
        """As `predict`, without maps: the bench with its known effects only."""
        return self._predictor(indices, self.known).signal


def prior_penalty(tensors: Mapping[str, Tensor]) -> Tensor:
    """Σ (θ/σ)² over all elements θ of the tensors, with σ from PRIOR_SIGMA: −2 log(prior) up to a constant."""
    parts = [(tensor / PRIOR_SIGMA[name]).square().sum() for name, tensor in tensors.items() if tensor.numel()]
    return torch.stack(parts).sum()
