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

from holoview.captures.cache import Cache, NoCache
from holoview.captures.fourier import FourierBench
from holoview.captures.look import Pixels
from holoview.captures.near import Beam, NearField
from holoview.captures.session import Captures
from holoview.effects.apply import Applied
from holoview.effects.effect import MODULATOR_HOOKS, Effect, Moment
from holoview.effects.places import Sensor
from holoview.effects.switched import Table
from holoview.plan import Plan, make_plan

Tensor = torch.Tensor
_MB = 1 << 20
_PLANS = 256  # plans that are kept: a few for each wavelength and plane
_PICTURES_MB = 16  # of finished pictures: those of many fields push their own parts out of the large cache
_LIGHT_HOOKS = ("bench", *MODULATOR_HOOKS, "pupil", "moments", "aim")


@dataclass(frozen=True)
class Prediction:
    """signal (capture, y, x): what the camera collects, before the radiometric scale; offset: its black level, counts.

    Expected counts of capture k are offset + a·signal[k], with one unknown a > 0 for each wavelength.
    """

    signal: Tensor
    offset: float


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
        extra: Iterable[Effect] = (),
        *,
        double: bool = False,
        cache_mb: int = 256,
        finer: int = 1,
        padding: int = 2,
        points: int | None = None,
    ) -> None:
        self.captures, self.extra, self.finer, self.padding = captures, tuple(extra), finer, padding
        self.dtype = torch.complex128 if double else torch.complex64
        self.real = torch.float64 if double else torch.float32
        self.pixels = Pixels(captures.camera.pitch_m, captures.shape, points)
        self.sensor = Sensor(captures.camera.pitch_m, captures.shape)
        self.fields = 0
        self._cache, self._pictures = Cache(cache_mb * _MB), Cache(min(cache_mb, _PICTURES_MB) * _MB)
        self._plans: dict[object, Plan] = {}
        self._shares: dict[int, Tensor] = {}

    def __call__(
        self, indices: Sequence[int] | NDArray[np.integer], effects: Table | None = None, *, grad: bool = False
    ) -> Prediction:
        """Signals of some captures with `effects` {id: {parameter: value}} on; in that order.

        grad: let gradients flow to tensors that `extra` effects hold; nothing is kept then.
        Raises UserError for an unknown effect or parameter, and for a bench that can't be.
        """
        applied = Applied(effects or {}, self.extra)
        offset = self.captures.camera.black_level + applied.offset()
        with torch.set_grad_enabled(grad):
            caches = [NoCache(kept) if grad else kept for kept in (self._cache, self._pictures)]
            signals = [self._signal(int(k), applied, *caches) for k in indices]
            return Prediction(torch.stack(signals), offset)

    def _signal(self, k: int, applied: Applied, cache: Cache, pictures: Cache) -> Tensor:
        captures, plan, moments = self.captures, self._plan(k, applied), applied.moments()
        self.fields += len(plan.system.wavelengths_m) * len(plan.slopes) * len(moments)
        picture = pictures.get((k, applied.key(*_LIGHT_HOOKS)), lambda: self._picture(k, plan, applied, moments, cache))
        light = float(applied.power(captures.power[k]) * captures.exposure_s[k])
        return applied.image(picture * light, self.sensor)

    def _picture(self, k: int, plan: Plan, applied: Applied, moments: Sequence[Moment], cache: Cache) -> Tensor:
        """Intensity on the camera for unit power and time: of all beams."""
        bench = self._bench(plan, applied, cache)
        total: Tensor | None = None
        for wavelength in range(len(plan.system.wavelengths_m)):
            for source in range(len(plan.slopes)):
                for weight, factor in moments:
                    beam = Beam(wavelength, source, factor)
                    share = weight * float(plan.weights[0, wavelength])
                    part = bench.intensity(self._drive(k), beam, k)
                    total = share * part if total is None else total.add_(part, alpha=share)
        assert total is not None
        return total

    def _plan(self, k: int, applied: Applied) -> Plan:
        wavelength, distance = float(self.captures.wavelength_m[k]), float(self.captures.distance_m[k])
        key = (wavelength, distance, applied.key("bench"))
        if key not in self._plans:
            nominal = self.captures.system([wavelength], [distance + (self.captures.focal_length_m or 0.0)])
            if self.finer > 1 or self.padding > 2:
                nominal = nominal.edit({"upsample": self.finer * self.captures.upsample, "padding": self.padding})
            if len(self._plans) >= _PLANS:
                self._plans.pop(next(iter(self._plans)))
            self._plans[key] = make_plan(applied.bench(nominal))
        return self._plans[key]

    def _bench(self, plan: Plan, applied: Applied, cache: Cache) -> NearField | FourierBench:
        c = self.captures
        if c.focal_length_m is not None:
            return FourierBench(plan, applied, c.focal_length_m, c.iris2_na, self.pixels, self.dtype, cache)
        return NearField(plan, applied, (c.iris1_na, c.iris2_na), self.pixels, self.dtype, cache)

    def _drive(self, k: int) -> Tensor:
        if k not in self._shares:
            self._shares[k] = torch.from_numpy(self.captures.drive(k)).to(self.real)
        return self._shares[k]


def predict(
    captures: Captures, indices: Sequence[int] | NDArray[np.integer], effects: Table | None = None
) -> Prediction:
    """Signals of some captures, once; see `Predictor`."""
    return Predictor(captures)(indices, effects)
