"""The process of a virtual bench: `python -m holoview.bench.rig.virtual.server RIG.toml`.

It reads a token from stdin, prints the port of its local socket, and serves the first client that sends the token. It
ends when stdin is closed, which happens when the process that started it ends in any way.

`VirtualBench` computes the light from patterns, lasers, stage and camera to counts, with its hidden effects.

The bench has a clock of its own, which only waiting, moving and exposing advance: measuring, which on a real bench
waits for minutes, takes as long as computing the light. Hidden effects and faults stand in a file that rig.toml names,
or in rig.toml:

    [virtual]
    bench = "hidden.toml"

    # hidden.toml
    seed = 3
    settle = 0.02                 # s, time constant of the modulators
    prnu = 0.01                   # and exposure_jitter, camera_jitter, wavelength_jitter: standard deviations
    trigger_jitter = 0.001        # s: exposures begin late by the absolute value of a normal number
    camera_drift = "0.5 um"       # and power_drift: random walks, standard deviations after an hour
    laser_log = "lasers.txt"      # a line for each switching of a laser, for tests; a file of this folder
    [effects.gap]
    gap_error = "0.1 mm"
    [faults]                      # faults of devices at random moments, as shares of the pictures
    seed = 7
    timeout = 0.02                # no picture comes
    short = 0.01                  # a picture without the lower half of its rows
    torn = 0.01                   # the lower part is that of the picture before
    repeated = 0.01               # the picture before, again: a trigger was dropped
    disconnect = 0.001            # of all messages: the connection is cut
    power_off = 0.001             # of all messages: everything goes dark at once
    [signal]                      # what becomes of patterns on their way; see `virtual.signal_faults`
    scale = 1.25                  # shown at 125 %
    range = "clipped"             # or "compressed": limited range, 16 to 235
    bits = 6                      # that arrive
    [placement]                   # how modulators and camera are turned: one of `captures.dataset: ORIENTATIONS`
    slm1 = "rotate_180"           # the picture on modulator 1 (of a chain, on the named element) arrives turned so
    camera = "flip_x"             # the picture on the bench is recorded turned so

Displacements and small rotations are effects: `camera_alignment`, `slm_alignment`, `distance`, `stage`.
"""

from __future__ import annotations

import hmac
import math
import os
import random
import re
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.dataset import ORIENTATIONS, Captures, inverse_orientation, oriented_shape, turned
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.virtual_measurement import Nuisances, jittered_effects, read_out
from holoview.bench.rig.description import RigDescription, read_rig
from holoview.bench.rig.devices import Counts, Levels
from holoview.bench.rig.virtual.client import Connection, Disconnected, Packet
from holoview.bench.rig.virtual.signal_faults import SignalFaults
from holoview.light.model.effects.on_element import AT
from holoview.light.model.effects.registry import ActiveEffects, EffectTable, EffectValues
from holoview.light.model.fields import Integer, Nested, Number, described_field, from_mapping, same_field, validate
from holoview.util.errors import UserError, suggest_matches
from holoview.util.file_writer import write_file
from holoview.util.files import read_text
from holoview.util.tables import ValueType, check_keys, parse_toml, read_table

_EXPECTED = "what a virtual bench really is, in TOML"
_SHARE, _SECONDS, _SMALL = Number(low=0.0, high=1.0), Number(low=0.0, high=100.0), Number("um", low=0.0, high=1e-3)
_HOUR_S = 3600.0
_BRIGHT_QUANTILE, _FULL_EXPOSURE_S = 0.999, 1 / 60
_MIN_SHARE, _MAX_SHARE = 1e-4, 0.95  # of an earlier pattern: below it none is left; the most that the effect takes
_STAGE_SPEED = 5e-3  # m/s
_LASER_LOG = re.compile(r"lasers[A-Za-z0-9_-]{0,40}\.txt")


class OrientationTable:
    """Field type of hidden orientations: a table {device: turn}."""

    def parse(self, value: Any, where: str) -> dict[str, str]:
        if not isinstance(value, Mapping):
            raise UserError(where, f"{value!r}", expected='a table such as [placement] camera = "flip_x"')
        for key, turn in value.items():
            if turn not in ORIENTATIONS:
                raise UserError(f"{where}.{key}", f"{turn!r}", remedy=suggest_matches(str(turn), ORIENTATIONS))
        return {key: str(turn) for key, turn in value.items()}


class LaserLogName:
    """Field type of the name of the lasers' log, which is written: a stranger's bench mustn't choose another file."""

    def parse(self, value: Any, where: str) -> str | None:
        if value is None:
            return None
        if not (isinstance(value, str) and _LASER_LOG.fullmatch(value)):
            raise UserError(where, f"{value!r}", expected='"lasers.txt", or letters and digits between these words')
        return value


_SLMS = ("slm1", "slm2")
PICTURE_FAULTS, MESSAGE_FAULTS = ("timeout", "short", "torn", "repeated"), ("disconnect", "power_off")
_FAULTS: dict[str, ValueType] = {"seed": Integer(low=0, high=2**31)}
_FAULTS |= dict.fromkeys((*PICTURE_FAULTS, *MESSAGE_FAULTS), _SHARE)


@dataclass(frozen=True)
class FaultSettings:
    """shares: how often each fault happens, of pictures or of messages; missing faults never happen."""

    seed: int = 0
    shares: Mapping[str, float] = field(default_factory=dict)


class FaultTable:
    """Field type of the table [faults]."""

    def parse(self, value: Any, where: str) -> FaultSettings:
        if isinstance(value, FaultSettings):
            return value
        if not isinstance(value, Mapping):
            raise UserError(where, f"{value!r}", expected="a table such as [faults] timeout = 0.01")
        shares = read_table(value, _FAULTS, f"{where}.")
        return FaultSettings(shares.pop("seed", 0), shares)


@dataclass(frozen=True)
class VirtualSettings:
    """The hidden truth of a virtual bench. Keys of its table are the names of these fields without `_m` and `_s`."""

    effects: EffectValues = described_field(EffectTable(), "hidden effects", default=())
    placement: Mapping[str, str] = described_field(OrientationTable(), "how devices are turned", default_factory=dict)
    seed: float = described_field(Number(low=0, high=2**31), "of all random numbers", default=0)
    settle_s: float = described_field(_SECONDS, "time constant of the modulators", default=0.0)
    readout_s: float = described_field(_SECONDS, "of a picture", default=0.02)
    finer: float = described_field(Number(low=1, high=8), "finer light than of a model of the captures", default=1)
    exposure_jitter: float = same_field(Nuisances, "exposure_jitter")
    prnu: float = same_field(Nuisances, "prnu")
    camera_jitter_m: float = same_field(Nuisances, "camera_jitter_m")
    wavelength_jitter_m: float = same_field(Nuisances, "wavelength_jitter_m")
    trigger_jitter_s: float = described_field(_SECONDS, "by which exposures begin late", default=0.0)
    camera_drift_m: float = described_field(_SMALL, "in y and in x, after an hour", default=0.0)
    power_drift: float = described_field(_SHARE, "of the power's logarithm, after an hour", default=0.0)
    laser_log: str | None = described_field(LaserLogName(), "notes each switching of a laser", default=None)
    faults: FaultSettings = described_field(FaultTable(), "of devices at random moments", default=FaultSettings())
    signal: SignalFaults = described_field(Nested(SignalFaults), "of patterns on their way", default=SignalFaults())

    def __post_init__(self) -> None:
        validate(self)
        object.__setattr__(self, "effects", {name: dict(pairs) for name, pairs in dict(self.effects).items()})

    @property
    def nuisances(self) -> Nuisances:
        """The variations from capture to capture."""
        return Nuisances(self.exposure_jitter, self.prnu, self.camera_jitter_m, self.wavelength_jitter_m)

    def slm_turns(self, names: Sequence[str]) -> tuple[str, ...]:
        """How the pattern of each of these modulators arrives on the bench."""
        return tuple(self.placement.get(name, "none") for name in names)

    @property
    def camera_turn(self) -> str:
        """How the picture on the bench is recorded."""
        return self.placement.get("camera", "none")


def read_virtual_settings(rig: RigDescription) -> VirtualSettings:
    """The settings of a rig's virtual bench. Raises UserError that names an unknown or wrong key."""
    table, where = dict(rig.virtual), f"{rig.path}: virtual"
    if "bench" in table:
        if len(table) > 1 or not isinstance(table["bench"], str):
            raise UserError(f"{where}.bench", "isn't the only key, or no text", expected="the name of a file alone")
        file = rig.path.parent / table["bench"]
        table, where = parse_toml(read_text(file, _EXPECTED), str(file), _EXPECTED), str(file)
    try:
        settings: VirtualSettings = from_mapping(VirtualSettings, table)
    except UserError as error:
        raise error.inside(f"{where}.") from error
    known = (*(rig.modulator_names if rig.bench.chain is not None else _SLMS), "camera")
    check_keys(settings.placement, known, f"{where}.placement.", noun="device")
    turns = settings.slm_turns(rig.modulator_names)
    if rig.bench.chain is not None:
        for name, shape, turn in zip(rig.modulator_names, rig.slm_shapes, turns, strict=True):
            if oriented_shape(shape, turn) != shape:
                expected = "a turn that leaves the element its shape"
                raise UserError(f"{where}.placement.{name}", turn, expected=expected)
        return settings
    if len({oriented_shape(rig.slm_shape, turn) for turn in turns}) > 1:
        expected = "turns that leave both modulators the same shape"
        raise UserError(f"{where}.placement", f"{turns[0]} and {turns[1]}", expected=expected)
    return settings


class Drift:
    """Random walks (Wiener processes): their variances grow with the time on the bench.

    camera_m: shift (y, x) of the camera. power: factor of the lasers' light.
    """

    def __init__(self, camera_m: float, power: float, rng: np.random.Generator) -> None:
        """Standard deviations after an hour: of the camera's place in y and in x, and of the power's logarithm."""
        self._of_camera_m, self._of_power, self._rng, self._time_s = camera_m, power, rng, 0.0
        self._walk = np.zeros(3)

    def advance(self, time_s: float) -> None:
        """Goes on to this time on the bench."""
        if time_s > self._time_s and (self._of_camera_m or self._of_power):
            self._walk += math.sqrt((time_s - self._time_s) / _HOUR_S) * self._rng.standard_normal(3)
        self._time_s = max(time_s, self._time_s)

    @property
    def camera_m(self) -> tuple[float, float]:
        y, x, _ = self._of_camera_m * self._walk
        return float(y), float(x)

    @property
    def power(self) -> float:
        return math.exp(self._of_power * float(self._walk[2]))


@dataclass(frozen=True)
class _Shown:
    """A modulator's pattern, the levels that it showed when the pattern was sent (fractions too), and that time."""

    levels: Levels
    before: NDArray[np.float64]
    since_s: float


class VirtualBench:
    """A bench with hidden effects. Sizes and nominal facts are those of the rig's description.

    Raises UserError for effects that the bench can't have, and for requests that no device can carry out. time_s: of
    the bench. exposure_s: of the next picture. distance_m: where the camera is. laser: wavelength (m) and power of the
    laser that is on, None if all are off. on_laser: called with "on" or "off" whenever a laser is switched.
    """

    def __init__(
        self, rig: RigDescription, settings: VirtualSettings, on_laser: Callable[[str], None] = lambda _: None
    ) -> None:
        self._rig, self._settings, self._on_laser = rig, settings, on_laser
        seed = int(settings.seed)
        self._rng, self._turns = np.random.default_rng(seed), settings.slm_turns(rig.modulator_names)
        self._drift = Drift(settings.camera_drift_m, settings.power_drift, np.random.default_rng((seed, 1)))
        self._sensitivity = 1 + settings.nuisances.prnu * self._rng.standard_normal(rig.camera_shape)
        lasers = rig.wavelengths_m
        self._brightness = dict(zip(lasers, self._rng.uniform(0.7, 1.3, len(lasers)), strict=True))
        self._scale: dict[float, float] = {}
        self._picture_shape = oriented_shape(rig.camera_shape, inverse_orientation(settings.camera_turn))
        pairs = zip(rig.slm_shapes, rig.bench.slms, strict=True)
        dark = [np.zeros(shape, _levels_type(slm.num_levels)) for shape, slm in pairs]
        self._shown = [_Shown(levels, levels.astype(np.float64), -math.inf) for levels in dark]
        self.time_s, self.exposure_s = 0.0, max(rig.limits.exposures_s[0], 1e-3)
        self.distance_m = min(max(0.0, rig.stage_m[0]), rig.stage_m[1])
        self.laser: tuple[float, float] | None = None
        ActiveEffects(settings.effects).require_possible(self._one_capture(lasers[0], 1.0).data_properties())

    def show(self, slm: int, levels: Levels) -> None:
        """Sends a pattern (y, x) to the modulator of an index."""
        if not 0 <= slm < len(self._shown):
            raise UserError("modulator", f"no modulator {slm}")
        num_levels, name = self._rig.bench.slms[slm].num_levels, self._rig.modulator_names[slm]
        if levels.shape != self._rig.slm_shapes[slm]:
            raise UserError(name, f"a pattern of shape {levels.shape}", expected=f"{self._rig.slm_shapes[slm]}")
        if int(levels.max()) >= num_levels:
            raise UserError(name, f"level {int(levels.max())}", expected=f"0 to {num_levels - 1}")
        own = self._settings.signal.arrived(levels.astype(_levels_type(num_levels)), num_levels)
        self._shown[slm] = _Shown(own, self.levels_now(slm), self.time_s)

    def levels_now(self, slm: int) -> NDArray[np.float64]:
        """The levels (y, x) that a modulator really shows while it relaxes exponentially to its pattern."""
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
        dark = Predictor(captures, finer=int(settings.finer)).without_lasers([0], settings.effects)
        light = np.zeros(self._picture_shape) if dark.ambient is None else dark.ambient[0].double().numpy()
        return self._recorded(light, dark.black_level)

    def _lit_picture(self, wavelength_m: float, power: float, begin: float) -> Counts:
        settings = self._settings
        jittered = jittered_effects(settings.effects, settings.nuisances, self._rng)
        effects = self._with_settling(self._with_drift(jittered), begin)
        prediction = Predictor(self._one_capture(wavelength_m, power), finer=int(settings.finer))([0], effects)
        signal = prediction.signal[0].double().numpy()
        light = self._scale_of(wavelength_m, signal, power, effects) * signal * self._exposure_error()
        light = light * self._drift.power
        if prediction.ambient is not None:
            light = light + prediction.ambient[0].double().numpy()
        return self._recorded(light, prediction.black_level)

    def _recorded(self, light: NDArray[np.float64], black_level: float) -> Counts:
        """Raw counts of light (y, x) that falls on the bench's picture, which the camera records turned."""
        on_pixels = turned(light, self._settings.camera_turn) * self._sensitivity
        return read_out(self._rig.bench.camera, on_pixels, black_level, self._rng)

    def _one_capture(self, wavelength_m: float, power: float, levels: NDArray[Any] | None = None) -> Captures:
        """A capture at the place of the camera with an empty picture, of the patterns shown unless others are given."""
        return self._rig.capture(
            self._on_the_bench([shown.levels for shown in self._shown]) if levels is None else levels,
            np.zeros(self._picture_shape, np.uint16),
            wavelength_m=wavelength_m,
            distance_m=self.distance_m,
            power=power,
            exposure_s=self.exposure_s,
            lasers_m=self._rig.wavelengths_m,
            levels_before=self._on_the_bench([shown.before for shown in self._shown])[None],
        )

    def _on_the_bench(self, displayed: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Patterns as they arrive on the bench (modulator, y, x)."""
        arrived = [turned(own, turn) for own, turn in zip(displayed, self._turns, strict=True)]
        return np.stack(arrived) if self._rig.bench.chain is None else self._rig.together(arrived)

    def _with_settling(self, effects: dict[str, dict[str, float]], now_s: float) -> dict[str, dict[str, float]]:
        """The effects, with the share of the patterns before that remains when an exposure begins."""
        found = {name: dict(own) for name, own in effects.items()}
        for number, (name, shown) in enumerate(zip(self._rig.modulator_names, self._shown, strict=True), start=1):
            share, is_chain = self._share_before(shown, now_s), self._rig.bench.chain is not None
            if share > _MIN_SHARE:
                own = found.setdefault(f"settling{AT}{name}" if is_chain else "settling", {})
                key = "share" if is_chain else f"share{number}"
                own[key] = min(own.get(key, 0.0) + share, _MAX_SHARE)
        return found

    def _with_drift(self, effects: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
        """The effects, with the shift of the camera that has come over time."""
        shifts = dict(zip(("shift_y", "shift_x"), self._drift.camera_m, strict=True))
        if not any(shifts.values()):
            return effects
        own = dict(effects.get("camera_alignment", {}))
        return {**effects, "camera_alignment": own | {key: own.get(key, 0.0) + m for key, m in shifts.items()}}

    def _share_before(self, shown: _Shown, now_s: float) -> float:
        """The share of a pattern's predecessor that remains, 1 when the pattern is sent."""
        τ = self._settings.settle_s
        return math.exp(-(now_s - shown.since_s) / τ) if τ > 0 else 0.0

    def _scale_of(
        self, wavelength_m: float, signal: NDArray[np.float64], power: float, effects: Mapping[str, Any]
    ) -> float:
        """Counts per unit of signal, fixed by the first light of each laser: a full picture takes a frame's time.

        Where amplitude modulators could have darkened it, by that of clear patterns.
        """
        if wavelength_m not in self._scale:
            camera = self._rig.bench.camera
            if any(not slm.opd_range_m for slm in self._rig.bench.slms):
                clear = self._one_capture(wavelength_m, power, self._rig.together(self._rig.clear_levels))
                signal = Predictor(clear, finer=int(self._settings.finer))([0], effects).signal[0].double().numpy()
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


# --- the process ------------------------------------------------------------------------------------------------------


_NO_PICTURE_S = 1.0  # of bench time, after which a camera's time-out is told


class BenchServer:
    """Answers messages {"do": …}; an answer has the key "error" if it couldn't be done.

    Where a message has "live": true, the time since the last answer has passed on the bench.
    """

    def __init__(self, bench: VirtualBench, faults: FaultInjector) -> None:
        self._bench, self._faults, self._lock = bench, faults, threading.Lock()
        self._idle_since = time.monotonic()
        self._actions: dict[str, Callable[[Packet], Packet]] = {
            "show": self._show,
            "take": lambda _: Packet({}, bench.take()),
            "expose": lambda m: Packet({"exposure": bench.expose(float(m.table["exposure"]))}),
            "laser": self._laser,
            "move": lambda m: Packet({"distance": bench.move_to(float(m.table["distance"]))}),
            "wait": self._wait,
            "time": lambda _: Packet({"time": bench.time_s}),
        }

    def answer(self, message: Packet) -> Packet:
        """The answer to one message. Messages of several connections wait for each other, but lasers go off at once."""
        action = self._actions.get(str(message.table.get("do")))
        if action is None:
            return Packet({"error": "unknown message"})
        is_off = message.table.get("do") == "laser" and message.table.get("wavelength") is None
        try:
            if is_off:
                return action(message)
            with self._lock:
                return self._act(action, message)
        except UserError as error:
            return Packet({"error": str(error)})
        except (KeyError, TypeError, ValueError, IndexError) as error:
            return Packet({"error": f"not understood: {error}"})

    def _act(self, action: Callable[[Packet], Packet], message: Packet) -> Packet:
        if message.table.get("live") is True:
            self._bench.wait(time.monotonic() - self._idle_since)
        try:
            return action(message)
        finally:
            self._idle_since = time.monotonic()

    def serve(self, connection: Connection, token: str) -> None:
        """Answers messages until the other side is gone; without the right token the connection is closed."""
        try:
            request = connection.receive()
            if not hmac.compare_digest(str(request.table.get("token", "")).encode(), token.encode()):
                return
            connection.send(_numbered(Packet({}), request))
            while True:
                request = connection.receive()
                connection.send(_numbered(self._faults.answer(request, self.answer), request))
        except Disconnected:
            pass
        finally:
            connection.close()

    def _show(self, message: Packet) -> Packet:
        if message.array is None:
            raise ValueError("no levels")
        self._bench.show(int(message.table["slm"]), message.array)
        return Packet({})

    def _laser(self, message: Packet) -> Packet:
        wavelength: Any = message.table.get("wavelength")
        if wavelength is None:
            self._bench.switch_off()
        else:
            self._bench.switch_on(float(wavelength), float(message.table["power"]))
        return Packet({})

    def _wait(self, message: Packet) -> Packet:
        self._bench.wait(float(message.table["seconds"]))
        return Packet({})


def _numbered(answer: Packet, request: Packet) -> Packet:
    """The answer with the number of its request, null if that has none."""
    return replace(answer, table={**answer.table, "number": request.table.get("number")})


class FaultInjector:
    """Answers messages as devices with faults would. power_off: ends the process at once."""

    def __init__(self, settings: FaultSettings, power_off: Callable[[], None]) -> None:
        self._settings, self._power_off = settings, power_off
        self._chance = random.Random(settings.seed)
        self._before: Counts | None = None

    def answer(self, message: Packet, answer: Callable[[Packet], Packet]) -> Packet:
        """The answer of `answer`, unless a fault happens. Raises Disconnected for one of the connection."""
        is_late = self._chance.random() < 0.5  # a fault comes before the request is carried out, or after it
        found = answer(message) if is_late else None
        if self._happens("power_off"):
            self._power_off()
        if self._happens("disconnect"):
            raise Disconnected("a fault")
        found = found or answer(message)
        if message.table.get("do") != "take" or found.array is None:
            return found
        fault = next((name for name in PICTURE_FAULTS if self._happens(name)), None)
        if fault == "timeout":
            answer(Packet({"do": "wait", "seconds": _NO_PICTURE_S}))
            return Packet({"error": f"no picture within {_NO_PICTURE_S:g} s"})
        self._before = self._spoilt(found.array, fault)
        return Packet(found.table, self._before)

    def _happens(self, fault: str) -> bool:
        share = self._settings.shares.get(fault, 0.0)
        return share > 0 and self._chance.random() < share

    def _spoilt(self, picture: Counts, fault: str | None) -> Counts:
        rows = len(picture)
        if fault == "short":
            return picture[: rows // 2]
        if self._before is None or self._before.shape != picture.shape:
            return picture
        if fault == "torn":
            tear = self._chance.randint(rows // 4, rows - max(rows // 8, 1))
            return np.concatenate([picture[:tear], self._before[tear:]])
        return self._before if fault == "repeated" else picture


class LaserLog:
    """A file with a line for each switching of a laser. path: None for no file."""

    def __init__(self, path: Path | None) -> None:
        self._path, self._lines, self._lock = path, list[str](), threading.Lock()

    def note(self, line: str) -> None:
        """Adds a line."""
        if self._path is not None:
            with self._lock:
                self._lines.append(line)
                write_file(self._path, "\n".join([*self._lines, ""]), is_durable=False)


def main() -> int:
    """Serves the rig of the first argument."""
    token = sys.stdin.readline().strip()
    torch.set_num_threads(1)
    try:
        rig = read_rig(sys.argv[1], is_registered=False)
        settings = read_virtual_settings(rig)
        log = LaserLog(None if settings.laser_log is None else rig.path.parent / settings.laser_log)
        bench = VirtualBench(rig, settings, log.note)
    except UserError as error:
        print(f"error {error}", flush=True)
        return 2
    server = BenchServer(bench, FaultInjector(settings.faults, lambda: _end(bench, log, "off: no power")))
    with socket.create_server(("127.0.0.1", 0)) as listening:
        print(f"port {listening.getsockname()[1]}", flush=True)
        threading.Thread(target=_end_with_stdin, args=(bench, log), daemon=True).start()
        while True:
            connected, _ = listening.accept()
            threading.Thread(target=server.serve, args=(Connection(connected), token), daemon=True).start()


def _end_with_stdin(bench: VirtualBench, log: LaserLog) -> None:
    """Ends with the program that started this one; a laser that is on goes off by an interlock for signs of life."""
    sys.stdin.read()
    _end(bench, log, "off: interlock")


def _end(bench: VirtualBench, log: LaserLog, line: str) -> None:
    if bench.laser is not None:
        log.note(line)
    os._exit(0)


if __name__ == "__main__":
    raise SystemExit(main())
