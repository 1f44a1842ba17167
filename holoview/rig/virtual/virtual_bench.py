"""The light of a virtual bench: patterns, lasers, stage and camera to counts, in simulated time.

It has a clock of its own, which only waiting, moving and exposing advance, so that a session in which a real bench
would wait for minutes takes as long as its light takes to compute.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.orientations import inverse_orientation, oriented_shape, turned
from holoview.captures.predictor import Predictor
from holoview.captures.virtual_measurement import jittered_effects, read_out
from holoview.rig.description import RigDescription
from holoview.rig.devices import Counts, Levels
from holoview.rig.virtual.drift import Drift
from holoview.rig.virtual.virtual_settings import VirtualSettings
from holoview.util.errors import UserError

_BRIGHT_QUANTILE, _FULL_EXPOSURE_S = 0.999, 1 / 60
_MIN_SHARE, _MAX_SHARE = 1e-4, 0.95  # of a pattern before: below it is gone; the most that the effect takes
_STAGE_SPEED = 5e-3  # m/s


@dataclass(frozen=True)
class _Shown:
    """A modulator: its pattern, what was there when that was sent (in levels, not only whole ones), and when."""

    levels: Levels
    before: NDArray[np.float64]
    since_s: float


class VirtualBench:
    """A bench with hidden effects. Sizes and nominal facts are those of the rig's description.

    Raises UserError for what no device can be asked. time_s: of the bench. exposure_s: of the next picture.
    distance_m: where the camera is. laser: wavelength (m) and power of the one that is on, None if none is.
    on_laser: called with "on" or "off" whenever one is switched.
    """

    def __init__(
        self, rig: RigDescription, settings: VirtualSettings, on_laser: Callable[[str], None] = lambda _: None
    ) -> None:
        self._rig, self._settings, self._on_laser = rig, settings, on_laser
        self._rng = np.random.default_rng(settings.seed)
        self._drift = Drift(settings.drift, np.random.default_rng((settings.seed, 1)))
        self._sensitivity = 1 + settings.nuisances.prnu * self._rng.standard_normal(rig.camera_shape)
        lasers = rig.wavelengths_m
        self._brightness = dict(zip(lasers, self._rng.uniform(0.7, 1.3, len(lasers)), strict=True))
        self._scale: dict[float, float] = {}
        self._picture_shape = oriented_shape(rig.camera_shape, inverse_orientation(settings.camera_turn))
        dark = [np.zeros(rig.slm_shape, _levels_type(slm.num_levels)) for slm in rig.bench.slms]
        self._shown = [_Shown(levels, levels.astype(np.float64), -math.inf) for levels in dark]
        self.time_s, self.exposure_s = 0.0, max(rig.limits.exposures_s[0], 1e-3)
        self.distance_m = min(max(0.0, rig.stage_m[0]), rig.stage_m[1])
        self.laser: tuple[float, float] | None = None

    def show(self, slm: int, levels: Levels) -> None:
        """Sends a pattern (y, x) to modulator 0 or 1."""
        if not 0 <= slm < len(self._shown):
            raise UserError("modulator", f"no modulator {slm}")
        num_levels = self._rig.bench.slms[slm].num_levels
        if levels.shape != self._rig.slm_shape:
            expected = f"{self._rig.slm_shape}"
            raise UserError(f"slm{slm + 1}", f"a pattern of shape {levels.shape}", expected=expected)
        if int(levels.max()) >= num_levels:
            raise UserError(f"slm{slm + 1}", f"level {int(levels.max())}", expected=f"0 to {num_levels - 1}")
        own = levels.astype(_levels_type(num_levels))
        self._shown[slm] = _Shown(own, self.levels_now(slm), self.time_s)

    def levels_now(self, slm: int) -> NDArray[np.float64]:
        """What a modulator really shows (y, x), in levels, while it relaxes exponentially to its pattern."""
        shown = self._shown[slm]
        share = self._share_before(shown, self.time_s)
        return (1 - share) * shown.levels + share * shown.before

    def expose(self, exposure_s: float) -> float:
        """Sets the exposure time; returns it."""
        if not (math.isfinite(exposure_s) and exposure_s > 0):
            raise UserError("exposure", f"{exposure_s:g} s", expected="a finite time greater than 0")
        self.exposure_s = exposure_s
        return exposure_s

    def switch_on(self, wavelength_m: float, power: float) -> None:
        """Switches one laser on and all others off."""
        if wavelength_m not in self._brightness:
            raise UserError("lasers", f"no laser of {wavelength_m * 1e9:g} nm")
        if not (math.isfinite(power) and power >= 0):
            raise UserError("power", f"{power:g}", expected="a finite number of at least 0")
        self.laser = wavelength_m, power
        self._on_laser("on")

    def switch_off(self) -> None:
        """Switches all lasers off."""
        self.laser = None
        self._on_laser("off")

    def wait(self, seconds: float) -> None:
        """Lets time pass."""
        if not math.isfinite(seconds):
            raise UserError("time", f"{seconds:g} s", expected="a finite time")
        self.time_s += max(seconds, 0.0)

    def move_to(self, distance_m: float) -> float:
        """Moves the camera; returns the position that the stage reports."""
        low, high = self._rig.stage_m
        if not low <= distance_m <= high:
            raise UserError("stage", f"{distance_m * 1e3:g} mm is out of reach")
        self.wait(abs(distance_m - self.distance_m) / _STAGE_SPEED)
        self.distance_m = distance_m
        return distance_m

    def take(self) -> Counts:
        """Raw counts (y, x) of a picture, dark where no laser is on."""
        late_s = self._settings.trigger_jitter_s * abs(float(self._rng.standard_normal()))
        begin = self.time_s + late_s
        self._drift.advance(begin)
        self.wait(late_s + self.exposure_s + self._settings.readout_s)
        return self._dark_picture() if self.laser is None else self._lit_picture(*self.laser, begin)

    def _dark_picture(self) -> Counts:
        captures, settings = self._one_capture(self._rig.wavelengths_m[0], 0.0), self._settings
        dark = Predictor(captures, finer=settings.finer).without_lasers([0], settings.effects)
        light = np.zeros(self._picture_shape) if dark.ambient is None else dark.ambient[0].double().numpy()
        return self._recorded(light, dark.black_level)

    def _lit_picture(self, wavelength_m: float, power: float, begin: float) -> Counts:
        settings = self._settings
        jittered = jittered_effects(settings.effects, settings.nuisances, self._rng)
        effects = self._with_settling(self._with_drift(jittered), begin)
        prediction = Predictor(self._one_capture(wavelength_m, power), finer=settings.finer)([0], effects)
        signal = prediction.signal[0].double().numpy()
        light = self._scale_of(wavelength_m, signal, power) * signal * self._exposure_error() * self._drift.power
        if prediction.ambient is not None:
            light = light + prediction.ambient[0].double().numpy()
        return self._recorded(light, prediction.black_level)

    def _recorded(self, light: NDArray[np.float64], black_level: float) -> Counts:
        """Raw counts of light (y, x) that falls on the bench's picture, which the camera records turned."""
        on_pixels = turned(light, self._settings.camera_turn) * self._sensitivity
        return read_out(self._rig.bench.camera, on_pixels, black_level, self._rng)

    def _one_capture(self, wavelength_m: float, power: float) -> Captures:
        """A session of one capture: what is shown, and where the camera is."""
        return Captures(
            levels=self._on_the_bench([shown.levels for shown in self._shown]),
            images=np.zeros((1, *self._picture_shape), np.uint16),
            wavelength_m=np.array([wavelength_m]),
            distance_m=np.array([self.distance_m]),
            power=np.array([power]),
            exposure_s=np.array([self.exposure_s]),
            lasers_m=self._rig.wavelengths_m,
            levels_before=self._on_the_bench([shown.before for shown in self._shown]),
            **self._rig.bench.as_fields(),
        )

    def _on_the_bench(self, displayed: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Patterns as they arrive on the bench (1, modulator, y, x)."""
        turns = self._settings.slm_turns
        return np.stack([turned(own, turn) for own, turn in zip(displayed, turns, strict=True)])[None]

    def _with_settling(self, effects: dict[str, dict[str, float]], now_s: float) -> dict[str, dict[str, float]]:
        """The effects, with the share of the patterns before that remains when an exposure begins."""
        own = dict(effects.get("settling", {}))
        for number, shown in enumerate(self._shown, start=1):
            share = self._share_before(shown, now_s)
            if share > _MIN_SHARE:
                own[f"share{number}"] = min(own.get(f"share{number}", 0.0) + share, _MAX_SHARE)
        return {**effects, "settling": own} if own else effects

    def _with_drift(self, effects: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
        """The effects, with the shift of the camera that has come over time."""
        shifts = dict(zip(("shift_y", "shift_x"), self._drift.camera_m, strict=True))
        if not any(shifts.values()):
            return effects
        own = dict(effects.get("camera_alignment", {}))
        return {**effects, "camera_alignment": own | {key: own.get(key, 0.0) + m for key, m in shifts.items()}}

    def _share_before(self, shown: _Shown, now_s: float) -> float:
        """How much of what was there before a pattern remains, 1 when it is sent."""
        τ = self._settings.settle_s
        return math.exp(-(now_s - shown.since_s) / τ) if τ > 0 else 0.0

    def _scale_of(self, wavelength_m: float, signal: NDArray[np.float64], power: float) -> float:
        """Counts per unit of signal, fixed by the first light of each laser: a full picture takes a frame's time."""
        if wavelength_m not in self._scale:
            camera = self._rig.bench.camera
            bright = float(np.quantile(signal, _BRIGHT_QUANTILE)) / max(power * self.exposure_s, 1e-12)
            target = camera.saturation - camera.black_level
            self._scale[wavelength_m] = (
                self._brightness[wavelength_m] * target / (max(bright, 1e-30) * _FULL_EXPOSURE_S)
            )
        return self._scale[wavelength_m]

    def _exposure_error(self) -> float:
        return 1 + self._settings.nuisances.exposure_jitter * float(self._rng.standard_normal())


def _levels_type(num_levels: int) -> type[np.unsignedinteger]:
    return np.uint8 if num_levels <= 256 else np.uint16
