"""Edits of the focal plane and of the eye of a session: plane, pupil, and the recorded path of the pupil."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.eye import Eye
from holoview.light.model.focus import COLUMNS, MAX_POINTS, PupilPath, PupilState, plane_at, system_at
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.viewer.document.document import Gesture
from holoview.viewer.document.editing_session import EditingSession

SAME_PLANE_M = 1e-9
"""Planes that are closer to each other than this are the same."""
_STEP_FRACTION = 0.02  # of the range, for one step


def focus_range_m(system: System) -> tuple[float, float]:
    """The distances in metres that can be focused at: the system's planes with a margin of half their range.

    An eye sees other wavelengths in other planes, none of which lies before the modulator. A field is looked at up to
    half its distance to either side; one whose image lies in its plane, as far as its finest detail walks off by its
    size.
    """
    low, high = float(system.planes_m.min()), float(system.planes_m.max())
    margin = 0.5 * (high - low) or (_margin_of_field_m(system) if system.is_field else 0.2 * high)
    nearest, farthest = system.plane_type.item.low, system.plane_type.item.high
    shift = 0.0 if system.eye is None else float(min(system.eye.focus_shift_m(system.wavelengths_m).min(), 0.0))
    return max(low - margin, nearest - shift), high + margin if not system.is_field else min(high + margin, farthest)


def _margin_of_field_m(system: System) -> float:
    """How far to either side of its one plane a field is looked at."""
    pitch_m, shape = system.modulators[0].pitch_m, system.modulators[0].shape
    return 0.5 * abs(float(system.planes_m[0])) or min(shape) * pitch_m**2 / float(system.wavelengths_m.max())


def look_on_other_side(session: EditingSession) -> None:
    """Mirrors the planes of a field about it: the image lies there if its phase or distance has the other sign."""
    plane_m = -session.view_settings.plane_m + 0.0
    system = session.system.edit({"planes": -session.system.planes_m[::-1] + 0.0})
    session.edit("Other side", system=system, view_settings=session.view_settings.with_(plane_m=plane_m))


def focus_at(session: EditingSession, plane_m: float, merge_key: Hashable = ("plane_m",)) -> None:
    """Moves the focal plane to a distance, clipped to `focus_range_m`; successive moves are one step of undo."""
    low, high = focus_range_m(session.system)
    plane_m = float(f"{min(max(plane_m, low), high):.7g}")
    session.edit_view("Focal plane", merge_key=merge_key, plane_m=plane_m)


def focus_on(session: EditingSession, row: int, column: int) -> None:
    """Moves the focal plane to the depth of the target at a sample of the image.

    Raises UserError without a target, and for a focal stack, whose pictures don't tell depths.
    """
    if session.target_spec is None:
        raise UserError("focus", "there is no target", expected="a picture with a depth map", remedy="open one")
    focus_at(session, session.target_spec.depth_at(session.system, row, column))


def step_focus(session: EditingSession, steps: float) -> None:
    """Moves the focal plane by steps of 2 % of the range; positive is nearer to the viewer, at larger z."""
    low, high = focus_range_m(session.system)
    focus_at(session, session.view_settings.plane_m + steps * _STEP_FRACTION * (high - low))


def focus_at_next_plane(session: EditingSession, direction: int) -> None:
    """Moves to the next of the system's planes: nearer to the viewer for a positive direction, else farther."""
    planes, here = np.sort(session.system.planes_m), session.view_settings.plane_m
    ahead = planes[planes > here + SAME_PLANE_M] if direction > 0 else planes[planes < here - SAME_PLANE_M][::-1]
    if len(ahead):
        focus_at(session, float(ahead[0]))


# --- Edits of the eye of a session, and values that the panel of the eye draws. Lengths are metres, places (y, x) ---


Place = tuple[float, float]

PUPIL_RANGE_M = (0.5e-3, 8e-3)
"""Diameters that the wheel reaches."""


def toggle_eye(session: EditingSession) -> None:
    """Puts an eye behind an eyepiece, or takes it away."""
    session.change("Eye", {"eye": {} if session.system.eye is None else None})


def toggle_chromatic(session: EditingSession) -> None:
    """Switches the chromatic aberration of the eye; with none, an eye is put in place. Raises UserError as edits do."""
    eye = session.system.eye
    session.change("Chromatic aberration", {"eye.chromatic": eye is None or not eye.chromatic})


def move_pupil(session: EditingSession, place_m: Place) -> None:
    """Moves the pupil to a place in the eyebox or near it; successive moves are one step of undo."""
    half = 1.5 * eyebox_half_m(session.system)
    y, x = (float(f"{min(max(p, -half), half):.4g}") for p in place_m)
    session.change("Pupil", {"eye.pupil_y": y, "eye.pupil_x": x}, merge_key="pupil")


def resize_pupil(session: EditingSession, factor: float) -> None:
    """Multiplies the diameter of the pupil, which stays within `PUPIL_RANGE_M`."""
    low, high = PUPIL_RANGE_M
    diameter = min(max(pupil_diameter_m(session.system) * factor, low), high)
    session.change("Pupil", {"eye.pupil": float(f"{diameter:.3g}")}, merge_key="pupil size")


def eye_of(system: System) -> Eye:
    """The eye of a system. Raises UserError where there is none."""
    if system.eye is None:
        raise UserError("eye", "there is none", remedy="switch it on in the panel Eye")
    return system.eye


def pupil_diameter_m(system: System) -> float:
    """Diameter of the pupil of a system's eye."""
    return eye_of(system).pupil_diameter_m(system.field_m)


def eyebox_half_m(system: System, wavelength_m: float | None = None) -> float:
    """Half the side of the eyebox of the first order in the plane of the pupil, at a wavelength or the longest one."""
    λ = float(system.wavelengths_m.max()) if wavelength_m is None else wavelength_m
    return eye_of(system).eyepiece_m * λ / (2 * system.way.finest_m)


def seen_planes_m(system: System, plane_m: float, wavelengths_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The plane on which an eye is focused at each wavelength, (wavelength,), that is at `plane_m` at its reference."""
    return plane_m + eye_of(system).focus_shift_m(wavelengths_m)


def dioptres_of(system: System, plane_m: float) -> float:
    """The vergence at which a plane appears to the eye of a system."""
    return float(eye_of(system).dioptres(plane_m, system.planes_m))


def dioptres_text(system: System, plane_m: float) -> str:
    """The vergence of a plane with its unit; planes that differ by rounding alone read alike."""
    return f"{round(round(dioptres_of(system, plane_m), 9), 2) + 0.0:.2f} D"


def plane_of(system: System, dioptres: float) -> float:
    """The plane that appears at a vergence."""
    return float(eye_of(system).plane_m(dioptres, system.planes_m))


# --- Records how somebody moves the pupil of a session's eye, and moves it along the recorded path again ---


_RESTED_S = 0.1  # without a frame: the pupil rested, since each movement draws one
_STEP_S = 0.03  # in which it then moved to its next place
_CLOCK_DIGITS = 3


class PupilMotion:
    """Call `record` or `play`, then `advance` in each frame of the viewer until `stop`.

    clock: returns seconds. state: the present activity. The path is a field of the view settings.
    """

    def __init__(self, session: EditingSession, clock: Callable[[], float] = time.perf_counter) -> None:
        self._session, self._clock = session, clock
        self.state: Literal["", "recording", "playing"] = ""
        self._since, self._played = 0.0, Gesture()
        self._times_s: list[float] = []
        self._states: list[PupilState] = []

    @property
    def places_m(self) -> list[tuple[float, float]]:
        """The places (y, x) of the path that is being recorded, else of that of the view settings."""
        if self.state == "recording":
            return [(state.y_m, state.x_m) for state in self._states]
        path = self._session.view_settings.pupil_path
        return [] if path is None else list(zip(path.y_m, path.x_m, strict=True))

    @property
    def elapsed_s(self) -> float:
        """The time since recording or playing began; 0 if neither is being done."""
        return self._clock() - self._since if self.state else 0.0

    def record(self) -> None:
        """Begins to record. Raises UserError without an eye."""
        eye_of(self._session.system)
        self.stop()
        self.state, self._since = "recording", self._clock()
        self._times_s, self._states = [0.0], [self._present()]

    def play(self) -> None:
        """Begins to move the pupil along the path. Raises UserError without an eye or a path."""
        eye_of(self._session.system)
        self.stop()
        if self._session.view_settings.pupil_path is None:
            raise UserError("pupil path", "there is none", expected="a path to play", remedy="record one, or open one")
        self.state, self._since, self._played = "playing", self._clock(), Gesture()

    def stop(self) -> None:
        """Ends the present activity; a path that was recorded becomes that of the view settings."""
        was, self.state = self.state, ""
        self._session.end_gesture()
        if was != "recording":
            return
        end_s = round(self._clock() - self._since, _CLOCK_DIGITS)
        if end_s > self._times_s[-1]:
            self._append(end_s, self._states[-1])
        columns = {field: tuple(getattr(state, field) for state in self._states) for field in COLUMNS}
        self._session.edit_view("Record the pupil", pupil_path=PupilPath(tuple(self._times_s), **columns))

    def advance(self, shows_last_edit: bool = True) -> None:
        """Notes where the pupil is, or moves it on.

        shows_last_edit: whether the viewer shows the last place already; until then the pupil rests, so that each place
        is seen. Raises UserError, and stops, where the eye can't follow the path.
        """
        if self.state and self._session.system.eye is None:
            self.stop()
        elif self.state == "recording":
            self._note(round(self._clock() - self._since, _CLOCK_DIGITS))
        elif self.state == "playing" and shows_last_edit:
            try:
                self._move(self._clock() - self._since)
            except UserError:  # a place that this eyepiece doesn't reach: it would be the same in each frame
                self.stop()
                raise

    def _note(self, time_s: float) -> None:
        state = self._present()
        if state == self._states[-1] or time_s <= self._times_s[-1]:
            return
        if time_s - self._times_s[-1] > _RESTED_S:
            self._append(round(time_s - _STEP_S, _CLOCK_DIGITS), self._states[-1])
        self._append(time_s, state)
        if len(self._times_s) >= MAX_POINTS - 2:
            self.stop()
            self._session.messages.post(f"the path has {MAX_POINTS} points, the most there can be: recording ended")

    def _append(self, time_s: float, state: PupilState) -> None:
        self._times_s.append(time_s)
        self._states.append(state)

    def _present(self) -> PupilState:
        system = self._session.system
        eye, accommodation_dpt = eye_of(system), dioptres_of(system, self._session.view_settings.plane_m)
        diameter_m = float(f"{pupil_diameter_m(system):.6g}")  # of "auto", digits beyond are of no use in a file
        return PupilState(eye.pupil_y_m, eye.pupil_x_m, diameter_m, round(accommodation_dpt, 6))

    def _move(self, time_s: float) -> None:
        session, path = self._session, self._session.view_settings.pupil_path
        if path is None:
            self.stop()
            return
        state, (low, high) = path.at(time_s), focus_range_m(session.system)
        system, view = system_at(session.system, state), session.view_settings
        plane_m = min(max(plane_at(system, state, view.plane_m), low), high)
        view = view.with_(plane_m=plane_m)
        session.edit("Play the path", system=system, view_settings=view, merge_key=self._played)
        if time_s >= path.duration_s:
            self.stop()
