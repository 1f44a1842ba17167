"""A virtual measurement session: patterns, exposures and pictures as a laboratory would take them of a bench.

    pattern ─▶ bench with its effects ─▶ camera's signal × radiometric scale × exposure ─▶ noise, 12 bits ─▶ counts

The nominal geometry that the session carries is that of the bench without effects.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Camera, Captures, SlmSpec
from holoview.captures.patterns import BLUR_SIGMAS_PX, random_levels
from holoview.captures.predictor import Predictor
from holoview.captures.validation import check_captures
from holoview.model.effects.active_effects import EffectValues
from holoview.model.effects.effect import Effect
from holoview.model.system import Relay, Source, System
from holoview.util.errors import UserError

ProgressCallback = Callable[[int, int], None]
_DEFAULT_NUM_LEVELS = 256  # levels sent to a modulator that has none of its own
_TARGET_EXPOSURE = 0.8  # of full scale, for the brightest but a thousandth of the pixels
_SHORTEST_S, _LONGEST_S = 1e-4, 10.0


@dataclass(frozen=True)
class Nuisances:
    """What varies from capture to capture in any laboratory, and is nobody's fault: standard deviations.

    exposure: relative; prnu: relative, of pixels' sensitivities, the same in all captures; camera_m: shift of the
    picture; wavelength_m: drift of the laser.
    """

    exposure_jitter: float = 0.0
    prnu: float = 0.0
    camera_jitter_m: float = 0.0
    wavelength_jitter_m: float = 0.0


@dataclass(frozen=True)
class AcquisitionSettings:
    """How to measure. each: captures of every wavelength and plane, their patterns in turn from smooth to rough.

    powers: range of the laser powers that are set. camera: its pitch None for the simulation's samples, shape None for
    the modulator's area. full_well: electrons at full scale. focal_length_m: a Fourier bench, planes then its defocus.
    finer: samples each way that make the data, for each of the model's; a camera pixel sees the mean of its own.
    """

    captures_per_condition: int = 8
    power_range: tuple[float, float] = (0.5, 1.0)
    blur_sigmas_px: tuple[float, ...] = BLUR_SIGMAS_PX
    camera_pitch_m: float | None = None
    camera_shape: tuple[int, int] | None = None
    bit_depth: int = 12
    full_well: float = 16000.0
    read_noise: float = 3.0
    black_level: float = 64.0
    focal_length_m: float | None = None
    planes_m: tuple[float, ...] | None = None
    nuisances: Nuisances = Nuisances()
    finer: int = 1
    seed: int = 0


def make_captures(
    system: System,
    effects: EffectValues | None = None,
    settings: AcquisitionSettings | None = None,
    *,
    extra_effects: Iterable[Effect] = (),
    progress: ProgressCallback | None = None,
) -> Captures:
    """Captures of a bench with `effects` {id: {parameter: value}} beside those that it has.

    One seed gives one session. Raises UserError for a bench whose nominal geometry a capture file can't hold, and for
    effects that are unknown or impossible.
    """
    settings = settings or AcquisitionSettings()
    rng = np.random.default_rng(settings.seed)
    captures = blank_captures(system, settings, rng)
    table = {**system.effect_values, **(effects or {})}
    predictor = Predictor(captures, extra_effects, finer=settings.finer)
    counts = _CameraSimulator(captures, settings, rng)
    images, exposures = captures.images.copy(), captures.exposure_s.copy()
    for k in range(len(captures)):
        prediction = predictor([k], _jittered_effects(table, settings.nuisances, rng))
        images[k], exposures[k] = counts.expose(k, prediction.signal[0].double().numpy(), prediction.black_level)
        if progress is not None:
            progress(k + 1, len(captures))
    made = dataclasses.replace(captures, images=images, exposure_s=exposures)
    check_captures(made)
    return made


def blank_captures(system: System, settings: AcquisitionSettings, rng: np.random.Generator) -> Captures:
    """What is sent and set, with pictures still black and exposures of 1 s."""
    _check_nominal(system, settings)
    panels = tuple(
        SlmSpec(m.pitch_m, _DEFAULT_NUM_LEVELS if m.levels is None else len(m.levels), m.stroke_m)
        for m in system.modulators
    )
    planes = _planes(system, settings)
    wavelengths, distances = (a.ravel() for a in np.meshgrid(system.wavelengths_m, planes, indexing="ij"))
    wavelengths, distances = (np.repeat(a, settings.captures_per_condition) for a in (wavelengths, distances))
    shape, count = system.modulators[0].shape, len(wavelengths)
    levels = np.stack(
        [
            np.stack(
                [
                    random_levels(rng, shape, p.num_levels, settings.blur_sigmas_px[k % len(settings.blur_sigmas_px)])
                    for p in panels
                ]
            )
            for k in range(count)
        ]
    )
    samples = tuple(n * system.sampling.upsample for n in shape)
    pitch_m = settings.camera_pitch_m or system.modulators[0].pitch_m / system.sampling.upsample
    full_scale = 2**settings.bit_depth - 1 - settings.black_level
    fourier = settings.focal_length_m is not None
    return Captures(
        levels=levels,
        images=np.zeros((count, *(settings.camera_shape or samples)), np.uint16),
        wavelength_m=wavelengths,
        distance_m=distances,
        power=np.round(rng.uniform(*settings.power_range, count), 2),
        exposure_s=np.ones(count),
        slms=panels,
        camera=Camera(
            pitch_m, settings.bit_depth, settings.full_well / full_scale, settings.read_noise, settings.black_level
        ),
        gap_m=system.gap_m,
        iris1_na=system.relay1.iris_na,
        iris2_na=None if fourier else system.relay2.iris_na,
        focal_length_m=settings.focal_length_m,
    )


class _CameraSimulator:
    """Turns signals into counts: scale, exposure, noise, quantisation."""

    def __init__(self, captures: Captures, settings: AcquisitionSettings, rng: np.random.Generator) -> None:
        self._captures, self._nuisances, self._rng = captures, settings.nuisances, rng
        self._sensitivity = 1 + settings.nuisances.prnu * rng.standard_normal(captures.shape)
        self._scale: dict[float, float] = {}  # counts a unit of signal and second, unknown to the laboratory

    def expose(self, k: int, signal: NDArray[np.float64], offset: float) -> tuple[NDArray[np.uint16], float]:
        """Counts of a picture whose signal is for one second, and the exposure that was set."""
        camera = self._captures.camera
        room = _TARGET_EXPOSURE * (camera.saturation - offset)
        bright = float(np.quantile(signal, 0.999))
        if not (bright > 0 and room > 0):
            raise UserError("captures", f"no light reaches the camera in capture {k}", remedy="widen irises and stops")
        λ = float(self._captures.wavelength_m[k])
        scale = self._scale.setdefault(λ, 60 * room / bright * float(self._rng.uniform(0.7, 1.3)))
        exposure = float(np.clip(float(f"{room / (scale * bright):.2g}"), _SHORTEST_S, _LONGEST_S))
        actual = exposure * (1 + self._nuisances.exposure_jitter * float(self._rng.standard_normal()))
        electrons = np.maximum(scale * actual * signal * self._sensitivity, 0) * camera.electrons_per_count
        electrons = self._rng.poisson(electrons) + camera.read_noise * self._rng.standard_normal(signal.shape)
        counts = np.rint(electrons / camera.electrons_per_count + offset)
        return np.clip(counts, 0, camera.saturation).astype(np.uint16), exposure


def _jittered_effects(table: EffectValues, nuisances: Nuisances, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """The effects of one capture: those of the bench, and what varies."""
    out = {name: dict(values) for name, values in table.items()}
    y, x, λ = rng.standard_normal(3)
    for name, key, amount in (
        ("camera_alignment", "shift_y", nuisances.camera_jitter_m * y),
        ("camera_alignment", "shift_x", nuisances.camera_jitter_m * x),
        ("wavelength_offset", "offset", nuisances.wavelength_jitter_m * λ),
    ):
        if amount:
            out.setdefault(name, {})[key] = out.get(name, {}).get(key, 0.0) + amount
    return out


def _planes(system: System, settings: AcquisitionSettings) -> NDArray[np.float64]:
    if settings.planes_m is not None:
        return np.array(settings.planes_m, dtype=np.float64)
    return np.zeros(1) if settings.focal_length_m is not None else system.planes_m


def _check_nominal(system: System, settings: AcquisitionSettings) -> None:
    """UserError unless a capture file can hold the bench's nominal geometry."""
    remedy = "use a preset without it; `--effects` can add it as what is really there"
    for name in ("relay1", "relay2"):
        relay = getattr(system, name)
        if relay != Relay(iris_na=relay.iris_na):
            raise UserError(name, "has more than an iris", expected="a nominal relay with an iris only", remedy=remedy)
    if system.source != Source():
        raise UserError("source", "isn't a single wave on the axis", expected="one plane wave", remedy=remedy)
    for modulator in system.modulators:
        if modulator.levels is not None and not np.array_equal(
            modulator.levels, np.linspace(0, 1, len(modulator.levels))
        ):
            raise UserError("levels", "aren't equal steps", expected="equal steps of the stroke", remedy=remedy)
    if settings.focal_length_m is not None and len(system.modulators) == 2:
        raise UserError("focal length", "with two modulators", expected="one modulator on a Fourier bench")
    if settings.captures_per_condition < 1 or settings.finer < 1:
        raise UserError(
            "captures",
            f"{settings.captures_per_condition} of each, {settings.finer} times finer",
            expected="at least 1",
        )
