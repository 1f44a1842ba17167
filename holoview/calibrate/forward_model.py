"""The bench that is being learned: tensors that a gradient reaches, through the forward model of the captures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import torch

from holoview.captures.dataset import Captures
from holoview.captures.predictor import Predictor
from holoview.effects.calibrated import Calibrated
from holoview.effects.learned_maps import LearnedMaps, MapCache, MapLayout
from holoview.model.effects.active_effects import EffectValues
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
"""How large each tensor commonly is (1 σ), in its own unit: what no capture shows stays near the nominal bench."""

_CACHE_MB = 128


class _TrainableCalibrated(Calibrated):
    """The effect `calibrated` with tensors at hand instead of a file."""

    listed: ClassVar[bool] = False

    def __init__(self) -> None:
        self.current_maps: LearnedMaps | None = None

    def maps(self, v: Values) -> LearnedMaps:
        assert self.current_maps is not None
        return self.current_maps


class CalibrationModel:
    """Predicts captures for tensors of a layout, on top of effects {id: {parameter: value}} that are known."""

    def __init__(self, captures: Captures, layout: MapLayout, known: EffectValues, *, double: bool = False) -> None:
        self.layout, self.known = layout, dict(known)
        self._effect = _TrainableCalibrated()
        self._predictor = Predictor(
            captures, extra_effects=(self._effect,), double_precision=double, cache_mb=_CACHE_MB
        )
        self._map_cache, self._version = MapCache(), 0

    def set_maps(self, tensors: Mapping[str, Tensor]) -> None:
        """Predict with these tensors from now on; call it again whenever one of them changed."""
        self._map_cache.made = {}
        self._effect.current_maps = LearnedMaps(self.layout, tensors, self._map_cache)
        self._version += 1

    def predict(self, indices: Sequence[int], *, grad: bool = False) -> Tensor:
        """Signals (capture, y, x) before the radiometric scale."""
        table = {**self.known, _TrainableCalibrated.id: {"file": f"version {self._version}"}}
        return self._predictor(indices, table, grad=grad).signal

    def predict_nominal(self, indices: Sequence[int]) -> Tensor:
        """Signals without anything learned."""
        return self._predictor(indices, self.known).signal


def prior_penalty(tensors: Mapping[str, Tensor]) -> Tensor:
    """Σ (θ/σ)², the cost of what departs from the nominal bench."""
    parts = [(tensor / PRIOR_SIGMA[name]).square().sum() for name, tensor in tensors.items() if tensor.numel()]
    return torch.stack(parts).sum()
