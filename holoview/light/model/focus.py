"""Where the eye of a system is focused: its planes at its reference wavelength, and their shift at the others.

`PupilPath` is the path of a pupil through the eyebox: where it is, how wide it is, and where its eye is focused,
against time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.eye import PUPIL, PUPIL_PLACE, VERGENCE, Eye
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError


def focused_planes(system: System) -> NDArray[np.float64]:
    """Distances (plane,) of the focal planes, or of those on which the system's eye is focused.

    Raises UserError for an accommodation out of the range of planes.
    """
    eye = system.eye
    if eye is None or eye.accommodation_dpt is None:
        return system.planes_m
    planes_m = eye.plane_m(eye.accommodation_dpt, system.planes_m)
    _check_focus(system, planes_m, np.zeros(1), system.wavelengths_m[:1])
    return planes_m


def eyes_at(system: System, planes: int, places_m: Sequence[tuple[float, float]]) -> tuple[Eye, ...]:
    """The eye that sees each plane from each of some places (y, x), (place · plane,); from its own place without any.

    Empty without an eye. Raises UserError for places without an eye.
    """
    if system.eye is None and not places_m:
        return ()
    eye = required_eye(system, "pupil places")
    eyes = [eye.moved_to(place) for place in places_m] or [eye]
    return tuple(eye for eye in eyes for _ in range(planes))


def required_eye(system: System, where: str) -> Eye:
    """The eye of a system for what needs one. Raises UserError, at `where`, if there is none."""
    if system.eye is None:
        raise UserError(where, "without an eye", expected="a bench with an eye", remedy="switch it on: --set eye={}")
    return system.eye


def with_pupil_at(system: System, place_m: tuple[float, float]) -> System:
    """A system whose eye has its pupil at a place (y, x) of the eyebox. Raises UserError without an eye."""
    return system.with_(eye=required_eye(system, "pupil places").moved_to(place_m))


def plane_label(system: System, plane_m: float, digits: int | None = None) -> str:
    """A plane in words: "10 mm", with an eye "10 mm (0.625 D)".

    digits: significant digits of the millimetres; None for all.
    """
    text = units.format_exact(plane_m, "mm") if digits is None else units.format_rounded(plane_m, "mm", digits)
    if system.eye is None:
        return text
    return f"{text} ({float(system.eye.dioptres(plane_m, system.planes_m)) + 0.0:.3g} D)"


def parse_plane(system: System, text: str, where: str) -> float:
    """The distance (m) of a plane from text: "10 mm", or with an eye "0.5 D".

    Raises UserError for text of another kind, for dioptres without an eye, for a plane before the last modulator, and
    for one too far from a field.
    """
    if not text.rstrip().endswith("D"):
        plane_m = units.parse(text, where)
    elif system.eye is None:
        raise UserError(
            where, f"{text} without an eye", expected='a distance such as "10 mm"', remedy="switch it on: --set eye={}"
        )
    else:
        plane_m = float(system.eye.plane_m(units.parse(text, where, "vergence"), system.planes_m))
    if system.is_field:
        system.plane_type.parse([plane_m], where)
    elif plane_m < 0:
        raise UserError(
            where, f"{text} lies before the last modulator", expected="0 mm or more behind it, where its light goes"
        )
    return plane_m


def parse_planes(system: System, planes: Sequence[float | str] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances of a system's planes in metres, from numbers or text.

    Raises UserError for an empty list or a wrong distance.
    """
    read = system.plane_type.parse(planes, "planes")
    if read is None or len(read) == 0:
        raise UserError("planes", "an empty list", expected="at least one distance")
    return read


def focus_shift(
    system: System, planes_m: NDArray[np.float64], wavelengths_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How much further the eye of a system is focused at each wavelength, m; 0 without an eye."""
    if system.eye is None:
        return np.zeros(len(wavelengths_m))
    shift_m = system.eye.focus_shift_m(wavelengths_m)
    _check_focus(system, planes_m, shift_m, wavelengths_m)
    return shift_m


def _check_focus(
    system: System, planes_m: NDArray[np.float64], shift_m: NDArray[np.float64], wavelengths_m: NDArray[np.float64]
) -> None:
    """Raises UserError if an eye is focused before the last modulator or too far behind it at any wavelength."""
    assert system.eye is not None
    distances_m = planes_m[:, None] + shift_m[None, :]
    low, high = system.plane_type.item.low, system.plane_type.item.high
    outside = np.argwhere((distances_m < low) | (distances_m > high))
    if len(outside) == 0:
        return
    plane, wavelength = outside[0]
    ends = system.eye.dioptres(np.array([low - min(shift_m.min(), 0), high - max(shift_m.max(), 0)]), system.planes_m)
    ends = np.clip(ends, VERGENCE.low, VERGENCE.high)
    raise UserError(
        "eye",
        f"focused at {float(system.eye.dioptres(planes_m[plane], system.planes_m)):.3g} D it sees the plane at "
        f"{units.format_rounded(float(distances_m[plane, wavelength]), 'mm')} at "
        f"{units.format_rounded(float(wavelengths_m[wavelength]), 'nm')}",
        expected=f"planes from the last modulator to {units.format_rounded(high, 'm')} behind it: "
        f"accommodations from {ends[0]:.3g} D to {ends[1]:.3g} D",
        remedy="change eye.accommodation, eye.infinity or eye.eyepiece",
    )


# --- the path of a pupil ----------------------------------------------------------------------------------------------


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
