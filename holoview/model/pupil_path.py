"""The path of a pupil through the eyebox: where it is, how wide it is, and where its eye is focused, against time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from holoview.model.eye import PUPIL, PUPIL_PLACE, VERGENCE
from holoview.model.focus import focus_shift
from holoview.model.system import System
from holoview.util.errors import UserError

Floats = NDArray[np.float64]
Column = tuple[float, ...]

MAX_POINTS = 20_000
"""Most points of a path: five minutes at 60 a second."""
_KINDS = {"y_m": PUPIL_PLACE, "x_m": PUPIL_PLACE, "pupil_m": PUPIL, "accommodation_dpt": VERGENCE}
COLUMNS = {"y_m": "y", "x_m": "x", "pupil_m": "pupil", "accommodation_dpt": "accommodation"}
"""Names for people of the quantities that a path states at each of its times, by field."""


@dataclass(frozen=True)
class PupilState:
    """A pupil at one time. Place (y, x) and diameter in m; the last two are None where the path doesn't tell."""

    y_m: float
    x_m: float
    pupil_m: float | None = None
    accommodation_dpt: float | None = None


@dataclass(frozen=True)
class PupilPath:
    """A path as columns of equal length; between its points it is straight, and its speed is constant.

    times_s: (point,) rising from 0. y_m, x_m: (point,) place of the pupil's centre in the eyebox, as those of `Eye`.
    pupil_m: (point,) diameters; None: that of the eye that takes the path. accommodation_dpt: (point,) dioptres at
    which the eye is focused at its reference wavelength; None: where it is focused already.

    Raises UserError for columns of other lengths, times that don't rise from 0, and values out of range.
    """

    times_s: Column
    y_m: Column
    x_m: Column
    pupil_m: Column | None = None
    accommodation_dpt: Column | None = None

    def __post_init__(self) -> None:
        count = len(self.times_s)
        if not 1 <= count <= MAX_POINTS:
            raise UserError("pupil path", f"{count} points", expected=f"1 to {MAX_POINTS}")
        for field, name in COLUMNS.items():
            column = getattr(self, field)
            if column is None:
                continue
            if len(column) != count:
                raise UserError("pupil path", f"{len(column)} values of {name}, {count} times", expected="as many")
            for number, value in enumerate(column, start=1):
                _KINDS[field].parse(value, f"pupil path, point {number}: {name}")
        self._check_times()

    def _check_times(self) -> None:
        if not math.isfinite(self.times_s[-1]) or self.times_s[0] != 0:
            found = f"from {self.times_s[0]:g} to {self.times_s[-1]:g} s"
            raise UserError("pupil path", found, expected="times from 0 s")
        for number, (before, after) in enumerate(zip(self.times_s, self.times_s[1:], strict=False), start=2):
            if not after > before:
                found = f"{after:g} s follows {before:g} s"
                raise UserError(f"pupil path, point {number}: time", found, expected="times that rise")

    @property
    def duration_s(self) -> float:
        """The time of the last point."""
        return self.times_s[-1]

    def at(self, time_s: float) -> PupilState:
        """The pupil at a time; before and after the path, at its ends."""
        times_s = self._arrays["times_s"]
        told = {field: self._arrays[field] for field in COLUMNS if field in self._arrays}
        return PupilState(**{field: float(np.interp(time_s, times_s, column)) for field, column in told.items()})

    def states(self, count: int) -> list[tuple[float, PupilState]]:
        """The times and states of `count` steps of equal length from the path's beginning to its end.

        Raises UserError for less than one.
        """
        if count < 1:
            raise UserError("pupil path", f"{count} pictures", expected="1 or more")
        return [(time_s, self.at(time_s)) for time_s in np.linspace(0.0, self.duration_s, count).tolist()]

    @cached_property
    def _arrays(self) -> dict[str, Floats]:
        columns = {field: getattr(self, field) for field in ("times_s", *COLUMNS)}
        return {field: np.array(column) for field, column in columns.items() if column is not None}


def system_at(system: System, state: PupilState) -> System:
    """The system with the pupil of its eye in a state. Raises UserError without an eye, and as `Eye` does."""
    if system.eye is None:
        raise UserError("pupil path", "there is no eye", expected="a bench with an eye", remedy="--set eye={}")
    pupil_m = system.eye.pupil_m if state.pupil_m is None else state.pupil_m
    return system.with_(eye=replace(system.eye, pupil_m=pupil_m, pupil_y_m=state.y_m, pupil_x_m=state.x_m))


def plane_at(system: System, state: PupilState, otherwise_m: float) -> float:
    """The plane (m) on which the eye of a system is focused in a state; `otherwise_m` where the state doesn't tell."""
    if state.accommodation_dpt is None or system.eye is None:
        return otherwise_m
    return float(system.eye.plane_m(state.accommodation_dpt, system.planes_m))


def views_along(
    system: System, path: PupilPath, count: int, plane_m: float
) -> tuple[list[float], list[tuple[System, float]]]:
    """Times (s) of `count` equal steps along a path, and the system and the plane (m) that are seen at each.

    plane_m: the plane where the path doesn't tell. Raises UserError as `system_at` does, and for an accommodation whose
    plane lies before the last modulator at any wavelength.
    """
    times_s, views = [], []
    for time_s, state in path.states(count):
        times_s.append(time_s)
        views.append((system_at(system, state), plane_at(system, state, plane_m)))
    focus_shift(system, np.array([plane_m for _, plane_m in views]), system.wavelengths_m)
    return times_s, views
