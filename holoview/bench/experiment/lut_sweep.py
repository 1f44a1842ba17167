"""Sweeps of a modulator's grey level on a rig: levels × periods × orders × wavelengths, read by its camera.

A phase modulator shows gratings, whose orders tell the phase. An amplitude modulator shows one level everywhere, which
multiplies all the light. The other modulators let the light through.

SweepPlan       the sweeps that are to be taken
SweepReadings   their readings, on the disk as a table that `calibrate.sweep` reads
LutMeasurement  takes the missing ones; after any interruption the same call goes on

`grating_orders` says which gratings, and what their orders tell.

Every reading is divided by the light that unpatterned modulators send, measured again every few levels: a laser that
drifts drops out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.bench.calibrate.sweep import LabelledSweep, format_readings, parse_sweeps
from holoview.bench.captures.dataset import Camera
from holoview.bench.experiment.grating_orders import GratingOrders, UnseenGrating, best_distance_m, find_orders
from holoview.bench.rig.camera_pictures import CheckedCamera, range_share, take_dark_frame, take_exposed
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Counts, Devices, Levels
from holoview.bench.rig.rays import way_to_camera
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import read_text
from holoview.util.number_text import read_csv
from holoview.util.progress import ProgressCallback, TextCallback
from holoview.util.units import format_rounded

Floats = NDArray[np.float64]

_PROBES = 9  # levels at which exposure and orders are looked for
_BLOCK = 8  # levels between two pictures of unpatterned modulators
_DARK_PICTURES = 8
_FIRST_EXPOSURE_S = 1e-2
_TOO_BRIGHT = 0.98  # of the camera's range
_SHORTER, _EXPOSURE_TRIES = 0.5, 6
_AFTER_WHITE = 2  # times the settling time: the per cent of white that is left after one shows behind black
_APART = 0.5  # of the distance between orders, that the modulator's own image may be wide where they are spots


@dataclass(frozen=True)
class SweepPlan:
    """The sweeps of one modulator.

    modulator: its number. wavelengths_m: of the lasers. periods_px: of the gratings, even; 0 for one level everywhere.
    levels: (n,) that are shown, ascending from 0; told as 0, 1, 2, … where `is_through` (steps of a phase through a
    table). axis: along which the bars follow each other, 0 for rows.
    """

    modulator: int
    wavelengths_m: tuple[float, ...]
    periods_px: tuple[int, ...]
    levels: NDArray[np.int64]
    axis: int = 1
    is_through: bool = False

    @property
    def told_levels(self) -> NDArray[np.int64]:
        """The levels in the table of readings, (n,)."""
        return np.arange(len(self.levels)) if self.is_through else self.levels

    @property
    def captures(self) -> int:
        """Pictures of gratings in all."""
        return len(self.wavelengths_m) * len(self.periods_px) * len(self.levels)

    def pattern(self, rig: RigDescription, period_px: int, level: int) -> Levels:
        """The grating (y, x): bars at level 0, and bars at `level`; with a period of 0 the level everywhere."""
        place = np.indices(rig.slm_shapes[self.modulator])[self.axis]
        varied = place % period_px >= period_px // 2 if period_px else np.ones_like(place)
        return np.where(varied, level, 0).astype(rig.levels_type)


@dataclass(eq=False)
class SweepReadings:
    """The readings of sweeps, on the disk after each block. path: of the table.

    powers: {(wavelength in m, period, order): {level: power}}.
    """

    path: Path
    powers: dict[tuple[float, int, str], dict[int, float]] = field(default_factory=dict)

    @classmethod
    def at(cls, path: Path, plan: SweepPlan) -> SweepReadings:
        """What is there already. Raises UserError for a table of another plan."""
        readings = cls(path)
        if not path.exists():
            return readings
        rows, _ = read_csv(read_text(path, "a table of sweeps"), str(path))
        try:
            for row in rows:
                key = float(row["wavelength_nm"] or "") * 1e-9, int(row["period_px"] or ""), row["order"] or ""
                readings.powers.setdefault(key, {})[int(row["level"] or "")] = float(row["power"] or "")
        except (KeyError, ValueError) as error:
            raise UserError(str(path), "isn't a table of readings", remedy="choose another -o") from error
        known = set(plan.told_levels.tolist())
        for (wavelength_m, period, _), powers in readings.powers.items():
            is_planned = any(abs(wavelength_m - own) < 1e-12 for own in plan.wavelengths_m)
            if not (is_planned and period in plan.periods_px and set(powers) <= known):
                found = "holds readings of other levels, periods or wavelengths"
                raise UserError(str(path), found, remedy="choose another -o, or remove it to measure anew")
        return readings

    def missing(self, wavelength_m: float, period_px: int, levels: Sequence[int]) -> list[int]:
        """Levels of a sweep that weren't read."""
        own = [
            powers for (λ, period, _), powers in self.powers.items() if _same(λ, wavelength_m) and period == period_px
        ]
        return [level for level in levels if not own or any(level not in powers for powers in own)]

    def add(self, wavelength_m: float, period_px: int, found: dict[str, dict[int, float]]) -> None:
        """Adds readings {order: {level: power}} and writes the table."""
        for order, powers in found.items():
            key = next((k for k in self.powers if _same(k[0], wavelength_m) and k[1:] == (period_px, order)), None)
            self.powers.setdefault(key or (wavelength_m, period_px, order), {}).update(powers)
        write_file(self.path, self.table())

    def mean_over_lasers(self, order: str) -> dict[int, float]:
        """The readings of an order by level, each the mean over all lasers."""
        own = [powers for (_, _, name), powers in self.powers.items() if name == order]
        return {level: float(np.mean([powers[level] for powers in own])) for level in own[0]}

    @property
    def count(self) -> int:
        """Pictures of gratings whose readings are there."""
        counts: dict[tuple[float, int], int] = {}
        for (wavelength_m, period, _), powers in self.powers.items():
            counts[wavelength_m, period] = max(counts.get((wavelength_m, period), 0), len(powers))
        return sum(counts.values())

    def table(self) -> str:
        """The table as text."""
        return format_readings(
            [
                (wavelength_m, period, order, level, powers[level])
                for (wavelength_m, period, order), powers in self.powers.items()
                for level in sorted(powers)
            ]
        )

    def sweeps(self) -> list[LabelledSweep]:
        """As sweeps for a fit: shortest wavelength, coarsest grating and first order first."""
        found = parse_sweeps(self.table(), self.path.name)
        return sorted(found, key=lambda s: (s.wavelength_m or 0, -(s.period_px or 0), s.order != "1"))


def _same(one_m: float, other_m: float) -> bool:
    return abs(one_m - other_m) < 1e-12


TRANSMITTED, DEVIATION = "transmission", "deviation"


@dataclass(frozen=True)
class UniformLight:
    """The readings of a modulator that shows one level everywhere: a picture's light, and its standard deviation."""

    camera: Camera
    orders: tuple[str, ...] = (TRANSMITTED, DEVIATION)

    def read(self, light: Floats) -> dict[str, float]:
        """The reading of each order."""
        variance = self.camera.noise_variance(light) + self.camera.dark_noise**2 / _DARK_PICTURES
        return {TRANSMITTED: float(light.sum()), DEVIATION: float(variance.sum()) ** 0.5}

    def reference(self, light: Floats) -> float:
        """The light by which readings are divided."""
        return float(light.sum())


class LutMeasurement:
    """Takes sweeps. devices: open devices, which the caller closes. tell: called with news for a user."""

    def __init__(self, rig: RigDescription, devices: Devices, tell: TextCallback) -> None:
        self._rig, self._devices, self._tell = rig, devices, tell
        self._camera = CheckedCamera(devices.camera, rig.bench.camera, tell)
        self._settle_s, self._power = devices.settle_s, min(rig.limits.power, 1.0)

    def run(
        self,
        plan: SweepPlan,
        readings: SweepReadings,
        progress: ProgressCallback,
    ) -> None:
        """Takes the missing readings. A grating that the camera can't see is told.

        Raises UserError where it sees none of them.
        """
        refused: list[str] = []
        for number, (wavelength_m, period) in enumerate((λ, p) for λ in plan.wavelengths_m for p in plan.periods_px):
            missing = readings.missing(wavelength_m, period, plan.told_levels.tolist())
            done, name = number * len(plan.levels), format_rounded(wavelength_m, "nm")
            name += f", period {period}" if period else ""
            if not missing:
                continue
            self._devices.lasers.switch_on(wavelength_m, self._power)
            try:
                for read in self._sweep(plan, wavelength_m, period, missing, readings):
                    progress(done + len(plan.levels) - len(missing) + read, plan.captures, name)
            except UnseenGrating as error:
                refused.append(f"{name}: {error}")
                self._tell(f"{refused[-1]}; left out")
        self._devices.lasers.switch_off()
        if not readings.powers:
            raise UserError("camera", refused[0], expected="orders of a grating", remedy="state other --period")
        progress(plan.captures, plan.captures, "")

    def _sweep(
        self,
        plan: SweepPlan,
        wavelength_m: float,
        period: int,
        missing: list[int],
        readings: SweepReadings,
    ) -> Iterator[int]:
        """Takes the missing levels of a sweep in blocks; yields how many are read after each picture."""
        exposure_s, orders = self._begin(plan, wavelength_m, period)
        shown = dict(zip(plan.told_levels.tolist(), plan.levels.tolist(), strict=True))
        dark = self._dark(plan, wavelength_m, exposure_s)
        for begin in range(0, len(missing), _BLOCK):
            block = missing[begin : begin + _BLOCK]
            for _ in range(_EXPOSURE_TRIES):
                found: dict[str, list[float]] = {order: [] for order in orders.orders}
                lights = [self._reference(plan, orders, dark)]
                for done, level in enumerate(block):
                    picture = self._picture(plan, period, shown[level])
                    if range_share(picture, self._rig.bench.camera, self._brightest) > _TOO_BRIGHT:
                        break
                    for order, power in orders.read(picture - dark).items():
                        found[order].append(power)
                    yield begin + done + 1
                else:
                    break
                exposure_s = self._camera.set_exposure(max(_SHORTER * exposure_s, self._camera.exposures_s[0]))
                dark = self._dark(plan, wavelength_m, exposure_s)
            else:
                raise UserError("camera", "too bright at its shortest exposure", remedy="lower power in [limits]")
            lights.append(self._reference(plan, orders, dark))
            light = np.interp(np.arange(len(block)), [-1, len(block)], lights)
            powers = {order: dict(zip(block, (own / light).tolist(), strict=True)) for order, own in found.items()}
            readings.add(wavelength_m, period, powers)

    def _begin(self, plan: SweepPlan, wavelength_m: float, period: int) -> tuple[float, GratingOrders]:
        """An exposure at which no probed level is too bright, and where the orders are."""
        bench, exposures_s, lights = self._rig.bench, [_FIRST_EXPOSURE_S], list[Floats]()
        length_m = period * bench.slms[plan.modulator].pitch_m
        way = way_to_camera(self._rig, plan.modulator, wavelength_m)
        place_m = way.stage_m(best_distance_m(length_m, wavelength_m), self._rig.limits.stage_m)
        self._devices.stage.move_to(place_m)
        for level in plan.levels[np.linspace(0, len(plan.levels) - 1, _PROBES).round().astype(int)].tolist():
            self._show(plan, period, level)
            picture, exposure_s = take_exposed(self._camera, bench.camera, exposures_s[-1], self._brightest)
            exposures_s.append(exposure_s)
            lights.append((picture.astype(np.float64) - bench.camera.black_level) / exposure_s)
        exposure_s = self._camera.set_exposure(min(exposures_s[1:]))
        if not period:
            return exposure_s, UniformLight(bench.camera)
        a, b = way.matrix(place_m)
        width_m = max(self._rig.slm_shapes[plan.modulator]) * bench.slms[plan.modulator].pitch_m
        apart_m = abs(b) * wavelength_m / length_m  # of neighbouring orders
        if abs(a) * width_m < _APART * apart_m:  # in a Fourier plane, or near to it
            return exposure_s, find_orders(lights, None, apart_m / bench.camera.pitch_m)
        return exposure_s, find_orders(lights, bench.camera.pitch_m / (abs(a) * length_m), None)

    @property
    def _brightest(self) -> float:
        """The quantile that counts as the brightest of a picture: two pixels may be hot."""
        return 1 - 2 / float(np.prod(self._camera.shape))

    def _show(self, plan: SweepPlan, period: int, level: int) -> None:
        levels = self._rig.clear_levels
        levels[plan.modulator] = plan.pattern(self._rig, period, level)
        self._devices.show(levels)
        self._devices.clock.wait(self._settle_s if period else _AFTER_WHITE * self._settle_s)

    def _picture(self, plan: SweepPlan, period: int, level: int) -> Counts:
        self._show(plan, period, level)
        return self._camera.take()

    def _reference(self, plan: SweepPlan, orders: GratingOrders, dark: Floats) -> float:
        """The light of unpatterned modulators, and of those of amplitude at their last level."""
        period = plan.periods_px[0]
        level = 0 if period else self._rig.bench.slms[plan.modulator].num_levels - 1
        return orders.reference(self._picture(plan, period, level) - dark)

    def _dark(self, plan: SweepPlan, wavelength_m: float, exposure_s: float) -> Floats:
        """Counts without the lasers."""
        self._devices.lasers.switch_off()
        mean = take_dark_frame(self._camera, exposure_s, _DARK_PICTURES).mean
        self._devices.lasers.switch_on(wavelength_m, self._power)
        return mean.astype(np.float64)
