"""Records how somebody moves the pupil of a session's eye, and moves it along the recorded path again."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal

from holoview.document.editing_session import EditingSession
from holoview.document.eye_edits import dioptres_of, eye_of, pupil_diameter_m
from holoview.document.focal_plane import focus_range_m
from holoview.model.pupil_path import COLUMNS, MAX_POINTS, PupilPath, PupilState, plane_at, system_at
from holoview.util.errors import UserError

_RESTED_S = 0.1  # without a frame: the pupil rested, since each movement draws one
_STEP_S = 0.03  # in which it then moved to its next place
_CLOCK_DIGITS = 3


class PupilMotion:
    """Call `record` or `play`, then `advance` in each frame of the viewer until `stop`.

    clock: returns seconds. state: what is being done. The path is a field of the view settings.
    """

    def __init__(self, session: EditingSession, clock: Callable[[], float] = time.perf_counter) -> None:
        self._session, self._clock = session, clock
        self.state: Literal["", "recording", "playing"] = ""
        self._since = 0.0
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
        self.state, self._since = "playing", self._clock()

    def stop(self) -> None:
        """Ends what is being done; a path that was recorded becomes that of the view settings."""
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

        shows_last_edit: whether the viewer shows the last place already; it is waited for, so that each is seen.
        Raises UserError, and stops, where the eye can't follow the path.
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
        session.edit("Play the path", system=system, view_settings=view.with_(plane_m=plane_m), merge_key="pupil path")
        if time_s >= path.duration_s:
            self.stop()
