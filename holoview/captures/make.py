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

from holoview.captures.check import check_captures
from holoview.captures.patterns import SMOOTHNESS, random_levels
from holoview.captures.predict import Predictor
from holoview.captures.session import Camera, Captures, Panel
from holoview.effects.effect import Effect
from holoview.effects.switched import Table
from holoview.errors import UserError
from holoview.system import Relay, Source, System

Progress = Callable[[int, int], None]
_CONTINUOUS = 256  # levels sent to a modulator that has none of its own
_WELL_EXPOSED = 0.8  # of full scale, for the brightest but a thousandth of the pixels
_SHORTEST_S, _LONGEST_S = 1e-4, 10.0


@dataclass(frozen=True)
class Nuisances:
    """What varies from capture to capture in any laboratory, and is nobody's fault: standard deviations.

    exposure: relative; prnu: relative, of pixels' sensitivities, the same in all captures; camera_m: shift of the
    picture; wavelength_m: drift of the laser.
    """

    exposure: float = 0.0
    prnu: float = 0.0
    camera_m: float = 0.0
    wavelength_m: float = 0.0


@dataclass(frozen=True)
class Session:
    """How to measure. each: captures of every wavelength and plane, their patterns in turn from smooth to rough.

    powers: range of the laser powers that are set. camera: its pitch None for the simulation's samples, shape None for
    the modulator's area. full_well: electrons at full scale. focal_length_m: a Fourier bench, planes then its defocus.
    finer: samples each way that make the data, for each of the model's; a camera pixel sees the mean of its own.
    """

    each: int = 8
    powers: tuple[float, float] = (0.5, 1.0)
    smoothness: tuple[float, ...] = SMOOTHNESS
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
    effects: Table | None = None,
    session: Session | None = None,
    *,
    extra: Iterable[Effect] = (),
    progress: Progress | None = None,
) -> Captures:
    """Captures of a bench with `effects` {id: {parameter: value}} beside those that it has.

    One seed gives one session. Raises UserError for a bench whose nominal geometry a capture file can't hold, and for
    effects that are unknown or impossible.
    """
    session = session or Session()
    rng = np.random.default_rng(session.seed)
    captures = nominal_session(system, session, rng)
    table = {**system.effect_values, **(effects or {})}
    predictor = Predictor(captures, extra, finer=session.finer)
    counts = _Counts(captures, session, rng)
    images, exposures = captures.images.copy(), captures.exposure_s.copy()
    for k in range(len(captures)):
        prediction = predictor([k], _jittered(table, session.nuisances, rng))
        images[k], exposures[k] = counts.take(k, prediction.signal[0].double().numpy(), prediction.offset)
        if progress is not None:
            progress(k + 1, len(captures))
    made = dataclasses.replace(captures, images=images, exposure_s=exposures)
    check_captures(made)
    return made


def nominal_session(system: System, session: Session, rng: np.random.Generator) -> Captures:
    """What is sent and set, with pictures still black and exposures of 1 s."""
    _check_nominal(system, session)
    panels = tuple(
        Panel(m.pitch_m, _CONTINUOUS if m.levels is None else len(m.levels), m.stroke_m) for m in system.modulators
    )
    planes = _planes(system, session)
    wavelengths, distances = (a.ravel() for a in np.meshgrid(system.wavelengths_m, planes, indexing="ij"))
    wavelengths, distances = (np.repeat(a, session.each) for a in (wavelengths, distances))
    shape, count = system.modulators[0].shape, len(wavelengths)
    levels = np.stack(
        [
            np.stack(
                [
                    random_levels(rng, shape, p.num_levels, session.smoothness[k % len(session.smoothness)])
                    for p in panels
                ]
            )
            for k in range(count)
        ]
    )
    samples = tuple(n * system.sampling.upsample for n in shape)
    pitch_m = session.camera_pitch_m or system.modulators[0].pitch_m / system.sampling.upsample
    full_scale = 2**session.bit_depth - 1 - session.black_level
    fourier = session.focal_length_m is not None
    return Captures(
        levels=levels,
        images=np.zeros((count, *(session.camera_shape or samples)), np.uint16),
        wavelength_m=wavelengths,
        distance_m=distances,
        power=np.round(rng.uniform(*session.powers, count), 2),
        exposure_s=np.ones(count),
        panels=panels,
        camera=Camera(
            pitch_m, session.bit_depth, session.full_well / full_scale, session.read_noise, session.black_level
        ),
        gap_m=system.gap_m,
        iris1_na=system.relay1.iris_na,
        iris2_na=None if fourier else system.relay2.iris_na,
        focal_length_m=session.focal_length_m,
    )


class _Counts:
    """Turns signals into counts: scale, exposure, noise, quantisation."""

    def __init__(self, captures: Captures, session: Session, rng: np.random.Generator) -> None:
        self._captures, self._nuisances, self._rng = captures, session.nuisances, rng
        self._sensitivity = 1 + session.nuisances.prnu * rng.standard_normal(captures.shape)
        self._scale: dict[float, float] = {}  # counts a unit of signal and second, unknown to the laboratory

    def take(self, k: int, signal: NDArray[np.float64], offset: float) -> tuple[NDArray[np.uint16], float]:
        """Counts of a picture whose signal is for one second, and the exposure that was set."""
        camera = self._captures.camera
        room = _WELL_EXPOSED * (camera.saturation - offset)
        bright = float(np.quantile(signal, 0.999))
        if not (bright > 0 and room > 0):
            raise UserError("captures", f"no light reaches the camera in capture {k}", remedy="widen irises and stops")
        λ = float(self._captures.wavelength_m[k])
        scale = self._scale.setdefault(λ, 60 * room / bright * float(self._rng.uniform(0.7, 1.3)))
        exposure = float(np.clip(float(f"{room / (scale * bright):.2g}"), _SHORTEST_S, _LONGEST_S))
        actual = exposure * (1 + self._nuisances.exposure * float(self._rng.standard_normal()))
        electrons = np.maximum(scale * actual * signal * self._sensitivity, 0) * camera.electrons_per_count
        electrons = self._rng.poisson(electrons) + camera.read_noise * self._rng.standard_normal(signal.shape)
        counts = np.rint(electrons / camera.electrons_per_count + offset)
        return np.clip(counts, 0, camera.saturation).astype(np.uint16), exposure


def _jittered(table: Table, nuisances: Nuisances, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """The effects of one capture: those of the bench, and what varies."""
    out = {name: dict(values) for name, values in table.items()}
    y, x, λ = rng.standard_normal(3)
    for name, key, amount in (
        ("camera_alignment", "shift_y", nuisances.camera_m * y),
        ("camera_alignment", "shift_x", nuisances.camera_m * x),
        ("wavelength_offset", "offset", nuisances.wavelength_m * λ),
    ):
        if amount:
            out.setdefault(name, {})[key] = out.get(name, {}).get(key, 0.0) + amount
    return out


def _planes(system: System, session: Session) -> NDArray[np.float64]:
    if session.planes_m is not None:
        return np.array(session.planes_m, dtype=np.float64)
    return np.zeros(1) if session.focal_length_m is not None else system.planes_m


def _check_nominal(system: System, session: Session) -> None:
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
    if session.focal_length_m is not None and len(system.modulators) == 2:
        raise UserError("focal length", "with two modulators", expected="one modulator on a Fourier bench")
    if session.each < 1 or session.finer < 1:
        raise UserError("captures", f"{session.each} of each, {session.finer} times finer", expected="at least 1")
