"""Simulates captures: a bench with effects, exposure control, camera noise and digitisation.

    pattern ─▶ bench with effects ─▶ signal × radiometric scale × exposure ─▶ shot and read noise ─▶ counts

Captures state the nominal geometry, that of the bench without effects.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Camera, Captures
from holoview.bench.captures.nominal_bench import check_nominal, slm_of
from holoview.bench.captures.patterns import BLUR_SIGMAS_PX, random_levels
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.validation import check_captures
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.effect import Effect
from holoview.light.model.effects.registry import EffectValues
from holoview.light.model.elements import Pixels
from holoview.light.model.fields import (
    Integer,
    Maybe,
    Nested,
    Number,
    Several,
    Shape,
    described_field,
    with_field_docs,
)
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.util.progress import StepCallback

_BRIGHT_QUANTILE, _TARGET_EXPOSURE = 0.999, 0.8  # this quantile of the pixels is exposed to this fraction of full scale
_MIN_EXPOSURE_S, _MAX_EXPOSURE_S = 1e-5, 10.0
_LEVEL_BYTES, _IMAGE_BYTES = 6, 5  # of a pixel of a pattern and of a picture: themselves, and while they are checked
_FRAME_RATE_HZ = 60  # the first exposure of a wavelength is one frame time, within about 30 %


@with_field_docs
@dataclass(frozen=True)
class Nuisances:
    """Random variations that occur in any laboratory and aren't faults of the bench, as standard deviations.

    Fields:
    """

    exposure_jitter: float = described_field(
        Number(low=0, high=1), "Relative error of each exposure time.", default=0.0
    )
    prnu: float = described_field(
        Number(low=0, high=1),
        "Relative differences of the pixels' sensitivities, the same in all captures.",
        default=0.0,
    )
    camera_jitter_m: float = described_field(
        Number("um", low=0.0, high=1e-3),
        "Shift of the camera, independent in y and x and in each capture.",
        default=0.0,
    )
    wavelength_jitter_m: float = described_field(
        Number("nm", low=0.0, high=1e-7), "Deviation of the laser's wavelength in each capture.", default=0.0
    )


@with_field_docs
@dataclass(frozen=True)
class AcquisitionSettings:
    """How captures are taken. The ranges are those of a user's choice.

    Fields:
    """

    captures_per_condition: int = described_field(
        Integer(1, 100_000), "Captures at each combination of wavelength and plane.", flag="each", default=8
    )
    power_range: tuple[float, float] = described_field(
        Several(Number(low=0), 2), "Laser powers are uniformly random in this range, relative.", default=(0.5, 1.0)
    )
    blur_sigmas_px: tuple[float, ...] = described_field(
        Several(Number(low=0)),
        "Blurs of the random patterns, in modulator pixels; captures cycle through them.",
        default=BLUR_SIGMAS_PX,
    )
    camera_pitch_m: float | None = described_field(
        Maybe(Number("um", low=0)),
        "Of the camera's pixels, referred to the modulators; that of the simulation if absent.",
        default=None,
    )
    camera_shape: tuple[int, int] | None = described_field(
        Maybe(Shape(65536)), "Rows and columns of the camera; the area of the modulator if absent.", default=None
    )
    bit_depth: int = described_field(Integer(1, 16), "Of the camera.", default=12)
    full_well: float = described_field(Number(low=0), "Electrons at full scale.", default=16000.0)
    read_noise: float = described_field(Number(low=0), "Of the camera, electrons r.m.s.", default=3.0)
    black_level: float = described_field(Number(low=0), "Counts without light.", default=64.0)
    focal_length_m: float | None = described_field(
        Maybe(Number("mm")), "Of the lens of a Fourier bench; near field if absent.", default=None
    )
    planes_m: tuple[float, ...] | None = described_field(
        Maybe(Several(Number("mm"))),
        "Distances from the last modulator, or defocus on a Fourier bench; the system's planes, or 0, if absent.",
        default=None,
    )
    nuisances: Nuisances = described_field(Nested(Nuisances), "What varies by itself.", default=Nuisances())
    finer: int = described_field(
        Integer(1, 64),
        "Times finer sampling than that of `Captures.upsample`; a camera pixel then averages several samples.",
        default=1,
    )
    seed: int = described_field(Integer(0, 2**63 - 1), "Of patterns, powers and noise.", default=0)


def make_captures(
    system: System,
    effects: EffectValues | None = None,
    settings: AcquisitionSettings | None = None,
    *,
    extra_effects: Iterable[Effect] = (),
    progress: StepCallback | None = None,
) -> Captures:
    """Simulates captures of a bench with `effects` {id: {parameter: value}} in addition to its own, without its eye.

    Equal arguments give equal captures. extra_effects: effects beside those of the registry. progress: called with
    (captures made, captures in all). Raises UserError for a bench whose nominal geometry a capture file can't hold,
    and for effects that are unknown or impossible.
    """
    settings, system = settings or AcquisitionSettings(), system.with_(eye=None)  # a camera takes them
    rng = np.random.default_rng(settings.seed)
    captures = blank_captures(system, settings, rng)
    table = {**system.effect_values, **(effects or {})}
    predictor = Predictor(captures, extra_effects, finer=settings.finer)
    camera = _CameraSimulator(captures, settings, rng)
    images, exposures = captures.images.copy(), captures.exposure_s.copy()
    for k in range(len(captures)):
        prediction = predictor([k], jittered_effects(table, settings.nuisances, rng))
        ambient = 0.0 if prediction.ambient is None else prediction.ambient[0].double().numpy()
        signal = prediction.signal[0].double().numpy()
        images[k], exposures[k] = camera.expose(k, signal, ambient, prediction.black_level)
        if progress is not None:
            progress(k + 1, len(captures))
    measured = dataclasses.replace(captures, images=images, exposure_s=exposures)
    check_captures(measured)
    return measured


def blank_captures(system: System, settings: AcquisitionSettings, rng: np.random.Generator) -> Captures:
    """Captures before they are taken: patterns and settings, with images of zeros and exposures of 1 s."""
    _check_nominal(system, settings)
    shown = [e for e in system.elements if isinstance(e, Pixels) and e.is_driven]
    slms = tuple(slm_of(element) for element in shown)
    planes = _planes(system, settings)
    wavelengths, distances = (a.ravel() for a in np.meshgrid(system.wavelengths_m, planes, indexing="ij"))
    wavelengths, distances = (np.repeat(a, settings.captures_per_condition) for a in (wavelengths, distances))
    shapes, count = [element.shape for element in shown], len(wavelengths)
    shape = (max(rows for rows, _ in shapes), max(columns for _, columns in shapes))
    sample_m = system.way.sample_m
    image_shape = settings.camera_shape or system.way.shape
    needed = count * (_LEVEL_BYTES * len(slms) * math.prod(shape) + _IMAGE_BYTES * math.prod(image_shape))
    require_memory("captures", needed, remedy="make fewer captures, or smaller ones")
    sigmas_px = [settings.blur_sigmas_px[k % len(settings.blur_sigmas_px)] for k in range(count)]
    sent = list(zip(shapes, slms, strict=True))
    levels = np.array(
        [[_within(shape, random_levels(rng, own, slm.num_levels, σ)) for own, slm in sent] for σ in sigmas_px]
    )
    for number, element in enumerate(shown):
        if getattr(element, "shared", False):
            levels[:, number] = levels[0, number]
    pitch_m = settings.camera_pitch_m or sample_m
    full_scale = 2**settings.bit_depth - 1 - settings.black_level
    return Captures(
        levels=levels,
        images=np.zeros((count, *image_shape), np.uint16),
        wavelength_m=wavelengths,
        distance_m=distances,
        power=np.round(rng.uniform(*settings.power_range, count), 2),
        exposure_s=np.ones(count),
        slms=slms,
        camera=Camera(
            pitch_m,
            settings.bit_depth,
            settings.full_well / full_scale,
            settings.read_noise,
            settings.black_level,
            integrates=None if settings.focal_length_m is None else False,
        ),
        gap_m=system.gap_m,
        relay1=system.relay1,
        relay2=system.relay2 if settings.focal_length_m is None else Relay(),
        focal_length_m=settings.focal_length_m,
        chain=system.edit({"effects": {}, "planes": planes}) if system.is_chain else None,
    )


def _within(shape: tuple[int, int], levels: NDArray[np.unsignedinteger]) -> NDArray[np.unsignedinteger]:
    """Levels (rows, columns) in the first rows and columns of a larger array of zeros."""
    return np.pad(levels, [(0, n - own) for n, own in zip(shape, levels.shape, strict=True)])


class _CameraSimulator:
    """Exposure control and the camera: expected signals become counts."""

    def __init__(self, captures: Captures, settings: AcquisitionSettings, rng: np.random.Generator) -> None:
        self._captures, self._nuisances, self._rng = captures, settings.nuisances, rng
        self._sensitivity = 1 + settings.nuisances.prnu * rng.standard_normal(captures.shape)
        self._scale: dict[float, float] = {}  # counts per unit of signal and second; a fit has to find it

    def expose(
        self, k: int, signal: NDArray[np.float64], ambient: NDArray[np.float64] | float, black_level: float
    ) -> tuple[NDArray[np.uint16], float]:
        """Image (y, x) in counts, and the exposure time (s) that was set for it.

        signal: of the lasers, (y, x), per second. ambient: counts per second of other light, (y, x) or a single one.
        """
        camera = self._captures.camera
        target = _TARGET_EXPOSURE * (camera.saturation - black_level)
        bright = float(np.quantile(signal, _BRIGHT_QUANTILE))
        if not (bright > 0 and target > 0):
            raise UserError("captures", f"no light reaches the camera in capture {k}", remedy="widen irises and stops")
        λ = float(self._captures.wavelength_m[k])
        scale = self._scale.setdefault(λ, _FRAME_RATE_HZ * target / bright * float(self._rng.uniform(0.7, 1.3)))
        brightest = scale * bright + float(np.max(ambient))
        exposure_s = float(np.clip(float(f"{target / brightest:.2g}"), _MIN_EXPOSURE_S, _MAX_EXPOSURE_S))
        actual_s = exposure_s * (1 + self._nuisances.exposure_jitter * float(self._rng.standard_normal()))
        light = (scale * signal + ambient) * actual_s * self._sensitivity
        return read_out(camera, light, black_level, self._rng), exposure_s


def read_out(
    camera: Camera, light: NDArray[np.float64], black_level: float, rng: np.random.Generator
) -> NDArray[np.uint16]:
    """Raw counts (y, x) of a picture: shot noise, read noise and digitisation. light: expected counts above black."""
    electrons = np.maximum(light, 0) * camera.electrons_per_count
    electrons = rng.poisson(electrons) + camera.read_noise * rng.standard_normal(light.shape)
    counts = np.rint(electrons / camera.electrons_per_count + black_level)
    return np.clip(counts, 0, camera.saturation).astype(np.uint16)


def jittered_effects(table: EffectValues, nuisances: Nuisances, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """The effects of one capture: those of the bench, with random shifts of camera and wavelength added."""
    jittered = {name: dict(values) for name, values in table.items()}
    y, x, λ = rng.standard_normal(3)
    for name, key, amount in (
        ("camera_alignment", "shift_y", nuisances.camera_jitter_m * y),
        ("camera_alignment", "shift_x", nuisances.camera_jitter_m * x),
        ("wavelength_offset", "offset", nuisances.wavelength_jitter_m * λ),
    ):
        if amount:
            jittered.setdefault(name, {})[key] = jittered.get(name, {}).get(key, 0.0) + amount
    return jittered


def _planes(system: System, settings: AcquisitionSettings) -> NDArray[np.float64]:
    if settings.planes_m is not None:
        return np.array(settings.planes_m, dtype=np.float64)
    return np.zeros(1) if settings.focal_length_m is not None else system.planes_m


def _check_nominal(system: System, settings: AcquisitionSettings) -> None:
    """Raises UserError unless a capture file can hold the bench's nominal geometry."""
    check_nominal(system)
    if settings.focal_length_m is not None and system.is_chain:
        found = "with a chain of elements"
        raise UserError("focal length", found, expected="one modulator", remedy="a chain has elements of kind fourier")
    if settings.focal_length_m is not None and len(system.modulators) == 2:
        raise UserError("focal length", "with two modulators", expected="one modulator on a Fourier bench")
    if settings.captures_per_condition < 1 or settings.finer < 1:
        raise UserError(
            "captures",
            f"{settings.captures_per_condition} of each, {settings.finer} times finer",
            expected="at least 1",
        )
