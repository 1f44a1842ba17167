"""Expected camera signals of captures for any effects: the forward model of diagnosis and calibration, fast.

The physics is that of the executors: Plan, transfer functions and modulators are theirs. What is left out is what an
iris blocks, and what hasn't changed since the last call: a camera effect costs nothing more than the camera.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.camera_sampling import PixelGrid
from holoview.captures.dataset import Captures
from holoview.captures.fourier_model import FourierBenchModel
from holoview.captures.near_field_model import IncoherentComponent, NearFieldModel
from holoview.captures.tensor_cache import InvariantCache, TensorCache
from holoview.model.effects.active_effects import EffectValues
from holoview.model.effects.effect import MODULATOR_HOOKS, Effect, ExposureSample
from holoview.model.effects.hook_contexts import CameraContext
from holoview.model.plan import Plan, make_plan
from holoview.optics.torch_effects import TorchEffects

Tensor = torch.Tensor
_MB = 1 << 20
_MAX_PLANS = 256  # plans that are kept: a few for each wavelength and plane
_IMAGE_CACHE_MB = 16  # of finished pictures: those of many fields push their own parts out of the large cache
_LIGHT_HOOKS = ("bench", *MODULATOR_HOOKS, "pupil", "exposure_samples", "camera_pose")


@dataclass(frozen=True)
class Prediction:
    """signal (capture, y, x): what the camera collects, before the radiometric scale; offset: its black level, counts.

    Expected counts of capture k are offset + a·signal[k], with one unknown a > 0 for each wavelength.
    """

    signal: Tensor
    black_level: float


class Predictor:
    """Predicts captures of a session again and again, for many values of effects.

    extra: effects that aren't in the registry. double: complex128. cache_mb: room for what is kept between calls.
    finer: samples each way for every one that the captures ask for. padding: sides of the grid in sides of the
    modulators. points: how many points each way a camera pixel averages; None: one for each sample on it.
    fields: how many fields calls have asked for so far, those that were kept included.
    """

    def __init__(
        self,
        captures: Captures,
        extra_effects: Iterable[Effect] = (),
        *,
        double_precision: bool = False,
        cache_mb: int = 256,
        finer: int = 1,
        padding: int = 2,
        points: int | None = None,
    ) -> None:
        self.captures, self.extra_effects, self.finer, self.padding = captures, tuple(extra_effects), finer, padding
        self.dtype = torch.complex128 if double_precision else torch.complex64
        self.real_dtype = torch.float64 if double_precision else torch.float32
        self.pixel_grid = PixelGrid(captures.camera.pitch_m, captures.shape, points)
        self.sensor = CameraContext(captures.camera.pitch_m, captures.shape)
        self.fields_requested = 0
        self._cache, self._image_cache = TensorCache(cache_mb * _MB), TensorCache(min(cache_mb, _IMAGE_CACHE_MB) * _MB)
        self._plans: dict[object, Plan] = {}
        self._stroke_fractions: dict[int, Tensor] = {}

    def __call__(
        self, indices: Sequence[int] | NDArray[np.integer], effects: EffectValues | None = None, *, grad: bool = False
    ) -> Prediction:
        """Signals of some captures with `effects` {id: {parameter: value}} on; in that order.

        grad: let gradients flow to tensors that `extra` effects hold; nothing is kept then.
        Raises UserError for an unknown effect or parameter, and for a bench that can't be.
        """
        applied = TorchEffects(effects or {}, self.extra_effects)
        offset = self.captures.camera.black_level + applied.black_level_offset()
        with torch.set_grad_enabled(grad):
            caches = [InvariantCache(kept) if grad else kept for kept in (self._cache, self._image_cache)]
            signals = [self._signal(int(k), applied, *caches) for k in indices]
            return Prediction(torch.stack(signals), offset)

    def _signal(self, k: int, applied: TorchEffects, cache: TensorCache, image_cache: TensorCache) -> Tensor:
        captures, plan, moments = self.captures, self._plan(k, applied), applied.exposure_samples()
        self.fields_requested += len(plan.system.wavelengths_m) * len(plan.slopes) * len(moments)
        picture = image_cache.get(
            (k, applied.cache_key(*_LIGHT_HOOKS)), lambda: self._unit_intensity(k, plan, applied, moments, cache)
        )
        light = float(applied.laser_power(captures.power[k]) * captures.exposure_s[k])
        return applied.image(picture * light, self.sensor)

    def _unit_intensity(
        self, k: int, plan: Plan, applied: TorchEffects, moments: Sequence[ExposureSample], cache: TensorCache
    ) -> Tensor:
        """Intensity on the camera for unit power and time: of all beams."""
        bench = self._forward_model(plan, applied, cache)
        total: Tensor | None = None
        for wavelength in range(len(plan.system.wavelengths_m)):
            for source in range(len(plan.slopes)):
                for weight, factor in moments:
                    beam = IncoherentComponent(wavelength, source, factor)
                    share = weight * float(plan.weights[0, wavelength])
                    part = bench.intensity(self._drive(k), beam, k)
                    total = share * part if total is None else total.add_(part, alpha=share)
        assert total is not None
        return total

    def _plan(self, k: int, applied: TorchEffects) -> Plan:
        wavelength, distance = float(self.captures.wavelength_m[k]), float(self.captures.distance_m[k])
        key = (wavelength, distance, applied.cache_key("bench"))
        if key not in self._plans:
            nominal = self.captures.nominal_system([wavelength], [distance + (self.captures.focal_length_m or 0.0)])
            if self.finer > 1 or self.padding > 2:
                nominal = nominal.edit({"upsample": self.finer * self.captures.upsample, "padding": self.padding})
            if len(self._plans) >= _MAX_PLANS:
                self._plans.pop(next(iter(self._plans)))
            self._plans[key] = make_plan(applied.bench(nominal))
        return self._plans[key]

    def _forward_model(
        self, plan: Plan, applied: TorchEffects, cache: TensorCache
    ) -> NearFieldModel | FourierBenchModel:
        c = self.captures
        if c.focal_length_m is not None:
            return FourierBenchModel(plan, applied, c.focal_length_m, c.iris2_na, self.pixel_grid, self.dtype, cache)
        return NearFieldModel(plan, applied, (c.iris1_na, c.iris2_na), self.pixel_grid, self.dtype, cache)

    def _drive(self, k: int) -> Tensor:
        if k not in self._stroke_fractions:
            self._stroke_fractions[k] = torch.from_numpy(self.captures.drive(k)).to(self.real_dtype)
        return self._stroke_fractions[k]


def predict(
    captures: Captures, indices: Sequence[int] | NDArray[np.integer], effects: EffectValues | None = None
) -> Prediction:
    """Signals of some captures, once; see `Predictor`."""
    return Predictor(captures)(indices, effects)
