"""Fast forward model of diagnosis and calibration: expected camera signals of captures for any effect parameters.

The physics is that of `engine`: plan, transfer functions, modulators and effects are the same code. Time is saved by
computing only the frequencies that an iris passes, and by caching: a call that changes only parameters of a camera
effect recomputes only the camera.

A search that meets a parameter value at which a hook raises UserError, as for an impossible bench, goes on, so that a
mistake in an effect's file would stay unnoticed. `check_known_effects` and `check_user_effects` report it before a
search.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.camera_model import (
    FourierBenchModel,
    IncoherentComponent,
    InvariantCache,
    NearFieldModel,
    PixelGrid,
    TensorCache,
)
from holoview.bench.captures.chain_model import ChainModel
from holoview.bench.captures.dataset import Captures
from holoview.light.model.effects.effect import MODULATOR_HOOKS, Effect, ExposureSample
from holoview.light.model.effects.hook_contexts import CameraContext
from holoview.light.model.effects.registry import ActiveEffects, EffectTable, EffectValues, unmet_by_data
from holoview.light.model.fields import Integer, Maybe, Truth, described_field
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import check_plan
from holoview.light.numerics.sampling import AREA
from holoview.light.optics.torch_effects import TorchEffects
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.util.units import format_rounded

Tensor = torch.Tensor
T = TypeVar("T")
_MB = 1 << 20
_SAMPLE_BYTES = 48  # of a padded sample in complex64; 20 to 40 were measured
_MAX_PLANS = 256  # and nominal benches: a few for each wavelength and plane
_IMAGE_CACHE_MB = 128
"""[MB] At least, of finished intensities, which many intermediate fields would push out of a shared cache; of large
pictures as much as all of them take, within `_CACHE_MB`."""
_DRIVE_CACHE_MB = 64  # of patterns
_CACHE_MB = 256
_LIGHT_HOOKS = (
    "actual_system",
    *MODULATOR_HOOKS,
    "pupil",
    "exposure_samples",
    "camera_distance",
    "camera_pose",
    "camera_pose_at",
    "camera_motion",
)
_REMEDY = "mend the file that defines it"
_PROBE_STEP = 0.5  # of the prior of each parameter


@dataclass(frozen=True)
class Prediction:
    """Expected camera signals before the radiometric scale.

    The expected counts of capture k are black_level + ambient[k] + a·signal[k], with one unknown factor a > 0 per
    wavelength.

    signal: (capture, y, x), light that the camera collects times power and exposure time, in arbitrary units.
    black_level: counts.
    ambient: (capture, y, x), counts of light beside the lasers'; None if there is none.
    """

    signal: Tensor
    black_level: float
    ambient: Tensor | None = None

    def counts_without_lasers(self, nominal_black_level: float) -> NDArray[np.float32]:
        """Counts beyond the nominal black level without the lasers' light, (capture, y, x) or a single number."""
        offset = np.float32(self.black_level - nominal_black_level)
        return np.asarray(offset) if self.ambient is None else offset + self.ambient.numpy().astype(np.float32)


@dataclass(frozen=True)
class SamplingConfig:
    """How finely a `Predictor` samples a bench. The ranges are those of a user's choice."""

    finer: int = described_field(Integer(1, 8), "Samples each way for each of the model's own.", default=1)
    padding: int = described_field(Integer(2, 8), "Sides of the grid over those of the modulators.", default=2)
    points: int | None = described_field(
        Maybe(Integer(1, 16, named=(("area", AREA),))),
        "Points each way that a camera pixel averages, or its area; as the captures state or show if absent.",
        default=None,
    )
    has_weighted_stops: bool = described_field(
        Truth(),
        "Frequencies at the edge of a stop pass by the share of their cell that is inside: nearer to a real stop.",
        flag="weighted-stops",
        default=False,
    )

    @property
    def samples_factor(self) -> int:
        """Samples of a simulated field for each of the model's own on the modulators."""
        return (self.finer * self.padding) ** 2

    def padded_samples(self, captures: Captures) -> int:
        """Samples of a simulated field of captures."""
        if captures.chain is not None:
            return math.prod(captures.chain.way.shape) * self.samples_factor
        return math.prod(captures.levels.shape[2:]) * captures.upsample**2 * self.samples_factor

    @property
    def without_points(self) -> SamplingConfig:
        """The same but for the camera's pixels."""
        return dataclasses.replace(self, points=None)

    @property
    def keywords(self) -> dict[str, Any]:
        """The keywords of `Predictor`."""
        return dataclasses.asdict(self)

    @property
    def description(self) -> str:
        """The settings that differ from the defaults."""
        parts = ["finer samples"] if self.finer > 1 else []
        parts += [f"a grid {self.padding} times the modulators' size"] if self.padding > 2 else []
        parts += ["stops whose edges pass in part"] if self.has_weighted_stops else []
        of_pixels = {AREA: "camera pixels that integrate", 1: "light at the middle of camera pixels"}
        parts += [] if self.points is None else [of_pixels.get(self.points, "several points of a camera pixel")]
        return " and ".join(parts)

    @property
    def cli_options(self) -> str:
        """The options of `holoview diagnose` and `calibrate` that choose this sampling."""
        points = "" if self.points is None else f" --points {self.points or 'area'}"
        stops = " --weighted-stops" if self.has_weighted_stops else ""
        return f"--finer {self.finer} --padding {self.padding}{points}{stops}"


PLAIN = SamplingConfig()


def cache_bytes(captures: Captures) -> int:
    """Default for the memory of the results that a `Predictor` keeps for later calls."""
    return (_CACHE_MB + _DRIVE_CACHE_MB) * _MB + _image_cache_bytes(captures, _CACHE_MB)


def _kept(values: dict[object, T], key: object, make: Callable[[], T]) -> T:
    """The value of a key, made where there is none yet; of more than `_MAX_PLANS` the oldest is dropped."""
    if key not in values:
        value = make()
        if len(values) >= _MAX_PLANS:
            values.pop(next(iter(values)))
        values[key] = value
    return values[key]


def _image_cache_bytes(captures: Captures, cache_mb: int) -> int:
    pictures = len(captures) * math.prod(captures.shape) * torch.float32.itemsize
    return min(cache_mb * _MB, max(_IMAGE_CACHE_MB * _MB, pictures))


def prediction_bytes(captures: Captures, sampling: SamplingConfig = PLAIN, *, double_precision: bool = False) -> int:
    """Memory that a prediction takes, without the results that a `Predictor` keeps for later predictions."""
    return _SAMPLE_BYTES * (1 + double_precision) * sampling.padded_samples(captures)


class Predictor:
    """Predicts captures for many values of effect parameters.

    extra_effects: effects beside those of the registry.
    double_precision: complex128 instead of complex64.
    cache_mb: memory for fields and intensities that later calls can reuse.
    finer: factor by which the simulation pitch is finer than that of `Captures.upsample`.
    padding: size of the padded grid over that of the modulators.
    propagation: as of `Sampling`, for a padding of 2.
    points: as of `SamplingConfig`.
    has_weighted_stops: as of `make_plan`.
    fields_requested: how many fields the calls so far have summed, including those that came from the cache.
    """

    def __init__(
        self,
        captures: Captures,
        extra_effects: Iterable[Effect] = (),
        *,
        double_precision: bool = False,
        cache_mb: int = _CACHE_MB,
        finer: int = 1,
        padding: int = 2,
        points: int | None = None,
        propagation: str = "linear",
        has_weighted_stops: bool = False,
    ) -> None:
        self.captures, self.extra_effects = captures, tuple(extra_effects)
        self._has_weighted_stops = has_weighted_stops
        self._sampling: dict[str, Any] = {"upsample": finer * captures.upsample} if finer > 1 else {}
        self._sampling |= {"padding": padding} if padding > 2 else {"propagation": propagation}
        needed = prediction_bytes(captures, SamplingConfig(finer, padding, points), double_precision=double_precision)
        require_memory("prediction of captures", needed, remedy="lower --finer or --padding, or use smaller modulators")
        self.dtype = torch.complex128 if double_precision else torch.complex64
        self.real_dtype = torch.float64 if double_precision else torch.float32
        points = AREA if points is None and captures.camera.integrates else points
        self.pixel_grid = PixelGrid(captures.camera.pitch_m, captures.shape, points, captures.axis_m)
        self._laser_number, self._properties = captures.laser_number, captures.data_properties()
        self.fields_requested = 0
        self._cache, self._image_cache = (
            TensorCache(most) for most in (cache_mb * _MB, _image_cache_bytes(captures, cache_mb))
        )
        self._nominal: dict[object, System] = {}
        self._plans: dict[object, Plan] = {}
        self._drives = TensorCache(_DRIVE_CACHE_MB * _MB)

    def __call__(
        self, indices: Sequence[int] | NDArray[np.integer], effects: EffectValues | None = None, *, grad: bool = False
    ) -> Prediction:
        """Predicts the captures of these indices, in that order, with `effects` {id: {parameter: value}}.

        grad: record gradients with respect to tensors that `extra_effects` hold; intermediate results that depend on
        effects aren't cached then. Raises UserError for an unknown effect or parameter and for an impossible bench.
        """
        active = self._active(effects or {})
        with torch.set_grad_enabled(grad):
            caches = [InvariantCache(cache) if grad else cache for cache in (self._cache, self._image_cache)]
            signals = [self._signal(int(k), active, *caches) for k in indices]
            return Prediction(torch.stack(signals), self._black_level(active), self._ambient(indices, active))

    def without_lasers(self, indices: Sequence[int] | NDArray[np.integer], effects: EffectValues) -> Prediction:
        """As a call, with all lasers off: the signal is zero."""
        active = self._active(effects)
        nothing = torch.zeros((), dtype=self.real_dtype).expand(len(indices), *self.captures.shape)
        return Prediction(nothing, self._black_level(active), self._ambient(indices, active))

    def counts_without_lasers(
        self, indices: Sequence[int] | NDArray[np.integer], effects: EffectValues
    ) -> NDArray[np.float32]:
        """`Prediction.counts_without_lasers` beyond the captures' black level; computes no light."""
        return self.without_lasers(indices, effects).counts_without_lasers(self.captures.camera.black_level)

    def _active(self, effects: EffectValues) -> TorchEffects:
        active = TorchEffects(effects, self.extra_effects)
        active.require_possible(self._properties)
        return active

    def _black_level(self, active: TorchEffects) -> float:
        return float(self.captures.camera.black_level + active.black_level_offset())

    def _signal(self, k: int, active: TorchEffects, cache: TensorCache, image_cache: TensorCache) -> Tensor:
        plan, exposure_samples = self._plan(k, active), active.exposure_samples()
        self.fields_requested += len(plan.system.wavelengths_m) * len(plan.slopes) * len(exposure_samples)
        intensity = image_cache.get(
            (k, active.cache_key(*_LIGHT_HOOKS, laser=int(self._laser_number[k]))),
            lambda: self._unit_intensity(k, plan, active, exposure_samples, cache),
        )
        energy = float(active.laser_power(self.captures.power[k]) * self.captures.exposure_s[k])
        return active.image(intensity * energy, self._camera_context(k))

    def _ambient(self, indices: Sequence[int] | NDArray[np.integer], active: TorchEffects) -> Tensor | None:
        """Counts of light beside the lasers' (capture, y, x); None if there is none."""
        rates = [active.ambient_light(self._camera_context(int(k)), self.real_dtype) for k in indices]
        exposures = [float(self.captures.exposure_s[int(k)]) for k in indices]
        counts = [rate * s for rate, s in zip(rates, exposures, strict=True) if rate is not None]
        return torch.stack(counts) if counts else None

    def _camera_context(self, k: int) -> CameraContext:
        c = self.captures
        laser = float(c.wavelength_m[k]), int(self._laser_number[k])
        return CameraContext(c.camera.pitch_m, c.shape, *laser, c.frame, c.picture_centre_m)

    def _unit_intensity(
        self, k: int, plan: Plan, active: TorchEffects, exposure_samples: Sequence[ExposureSample], cache: TensorCache
    ) -> Tensor:
        """Intensity (y, x) on the camera for unit power: the weighted sum over all incoherent components."""
        earlier = self._earlier_drives(k) if active.with_hooks("settled_share") else None
        model = self._forward_model(plan, active, cache, earlier)
        total: Tensor | None = None
        laser, part_of = int(self._laser_number[k]), (self.captures.slm_frame, self.captures.slm_centre_m)
        for wavelength in range(len(plan.system.wavelengths_m)):
            for source in range(len(plan.slopes)):
                for time_fraction, path_factor in exposure_samples:
                    component = IncoherentComponent(wavelength, source, path_factor, laser, *part_of)
                    weight = time_fraction * float(plan.weights[0, wavelength])
                    part = model.intensity(self._drive(k), component, k)
                    total = weight * part if total is None else total.add_(part, alpha=weight)
        assert total is not None
        return total

    def _plan(self, k: int, active: TorchEffects) -> Plan:
        wavelength, distance = float(self.captures.wavelength_m[k]), self._distance(k, active)

        def nominal() -> System:
            planes_m = [distance + (self.captures.focal_length_m or 0.0)]
            return self.captures.nominal_system([wavelength], planes_m).edit(self._sampling)

        def make() -> Plan:
            system = active.actual_system(_kept(self._nominal, (wavelength, distance), nominal))
            plan = make_plan(system, has_weighted_stops=self._has_weighted_stops)
            return plan if self.captures.is_fourier else check_plan(plan)

        return _kept(self._plans, (wavelength, distance, active.cache_key("actual_system")), make)

    def _distance(self, k: int, active: TorchEffects) -> float:
        """Of the camera, m. Raises UserError for one before the last modulator."""
        nominal = float(self.captures.distance_m[k])
        distance = active.camera_distance(nominal)
        if distance < 0 and not self.captures.is_fourier:
            where = ", ".join(f"effects.{effect.id}" for effect, _ in active.with_hooks("camera_distance"))
            found = f"{format_rounded(-distance, 'mm')} before the last modulator at {format_rounded(nominal, 'mm')}"
            raise UserError(where, f"the camera would be {found}", expected="a camera behind it")
        return distance

    def _forward_model(
        self, plan: Plan, active: TorchEffects, cache: TensorCache, earlier: Any
    ) -> NearFieldModel | FourierBenchModel | ChainModel:
        c = self.captures
        if c.chain is not None:
            return ChainModel(plan, active, c.chain, self.pixel_grid, self.dtype, cache, earlier)
        model = FourierBenchModel if c.is_fourier else NearFieldModel
        relays, focal_length_m = (c.relay1, c.relay2), c.focal_length_m or 0.0
        return model(plan, active, relays, self.pixel_grid, self.dtype, cache, earlier, focal_length_m)

    def _drive(self, k: int) -> Any:
        """The patterns of a capture, (modulator, y, x); of a chain by element."""
        drive = self._drives.get(k, lambda: torch.from_numpy(self.captures.drive(k)).to(self.real_dtype))
        return drive if self.captures.chain is None else self.captures.patterns(drive)

    def _earlier_drives(self, k: int) -> tuple[Any, Any]:
        """The patterns of the capture that was taken before, and of the first capture of all."""
        c = self.captures
        before, first = (torch.from_numpy(a).to(self.real_dtype) for a in (c.drive_before(k), c.first_drive))
        return (before, first) if c.chain is None else (c.patterns(before), c.patterns(first))


# --- effects that are checked before a search ------------------------------------------------------------------------


def check_known_effects(captures: Captures, known: Mapping[str, Mapping[str, Any]]) -> None:
    """Raises UserError for known effects {id: {parameter: value}} that the bench can't have, or values out of range."""
    EffectTable().parse(known, "effects")
    ActiveEffects(known).require_possible(captures.data_properties())


def check_user_effects(captures: Captures, effects: Iterable[Effect]) -> None:
    """Raises UserError that names the effect whose hooks fail on the first capture, or whose finding can't be written.

    Effects that need other data than these captures are skipped.
    """
    predictor, system = Predictor(captures, cache_mb=1), captures.nominal_system()
    for effect in effects:
        if unmet_by_data(effect, captures.data_properties()):
            continue
        _check_prediction(predictor, effect, captures.shape)
        try:
            list(effect.starting_points(system))
            effect.format_finding(system, _probe_values(effect, _PROBE_STEP))
        except Exception as error:
            found = f"its starting points or finding failed: {type(error).__name__}: {error}"
            raise UserError(f"effects.{effect.id}", found, remedy=_REMEDY) from error


def _check_prediction(predictor: Predictor, effect: Effect, shape: tuple[int, int]) -> None:
    """Predicts the first capture with all parameters raised, and with all lowered.

    UserError if an image has the wrong shape or isn't finite, or if both predictions fail. A single one may fail, where
    its parameters describe an impossible bench.
    """
    probes = [_probe_values(effect, step) for step in (_PROBE_STEP, -_PROBE_STEP)]
    probes = [values for values in probes if not effect.parameter_values(values).is_identity]
    errors = []
    for values in probes:
        try:
            signal = predictor([0], {effect.id: values}).signal[0]
        except UserError as error:
            errors.append(error)
            continue
        if tuple(signal.shape) != shape:
            found = f"leaves a picture of {tuple(signal.shape)} pixels"
            raise UserError(f"effects.{effect.id}", found, expected=f"{shape}", remedy=_REMEDY)
        if not bool(torch.isfinite(signal).all()):
            raise UserError(f"effects.{effect.id}", "leaves a picture that isn't finite", remedy=_REMEDY)
    if errors and len(errors) == len(probes):
        raise errors[0]


def _probe_values(effect: Effect, step: float) -> dict[str, float]:
    """Every parameter at its identity plus `step` priors, within its bounds."""
    return {p.name: p.nudged(step) for p in effect.parameters}
