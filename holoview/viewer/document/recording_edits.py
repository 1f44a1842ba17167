"""Chooses kind, order and steps of the recording that a session's field is of: the image follows, from a thread."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from holoview.holograms.hologram import Hologram
from holoview.holograms.load_field import Recorded
from holoview.util.mailbox import LatestTask
from holoview.viewer.document.document import Gesture
from holoview.viewer.document.editing_session import EditingSession


class RecordingEditor:
    """Edits the choices on a session's recording; of edits that come fast, the newest is shown."""

    def __init__(self, session: EditingSession) -> None:
        self._session = session
        self._task: LatestTask[tuple[Recorded, Hologram]] = LatestTask(
            "order", session.call_on_owner, session.messages.post_error
        )
        self._wanted: Recorded | None = None
        self._gesture = Gesture()

    @property
    def chosen(self) -> Recorded | None:
        """The choices, while their field is computed too; None without a recording."""
        shown = self._session.document.recorded
        is_pending = self.is_busy and self._wanted is not None and shown is not None
        return self._wanted if is_pending else shown

    @property
    def is_busy(self) -> bool:
        """Whether a field is being computed."""
        return self._task.is_busy

    def choose(self, chosen: Recorded) -> None:
        """Shows the field of other choices; those until `end_drag` are one step of undo."""
        self._wanted = chosen
        self._task.submit(partial(_with_field, lambda: chosen), partial(self._show, self._gesture))

    def end_drag(self) -> None:
        """The next choice is a separate step of undo; a field that is still computed belongs to the last choice."""
        self._gesture = Gesture()

    def find(self, **changes: Any) -> None:
        """Shows the field of the orders that stand out of the spectra; changes: of the recording, such as its kind."""
        shown = self._session.document.recorded
        if shown is not None:
            self._wanted = None
            self._task.submit(partial(_with_field, partial(shown.found, **changes)), partial(self._show, Gesture()))

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _show(self, gesture: Gesture, found: tuple[Recorded, Hologram]) -> None:
        recorded, hologram = found
        shown = self._session.document.recorded
        if shown is None or shown.recording.pictures is not recorded.recording.pictures:
            return
        system = self._session.system
        if len(system.amplitudes) != len(hologram.system.amplitudes):  # pictures become frames, or steps of one
            system = system.edit({"amplitudes": hologram.system.amplitudes})
        self._session.edit("Recording", system=system, drive=hologram.drive, recorded=recorded, merge_key=gesture)


def _with_field(choose: Callable[[], Recorded]) -> tuple[Recorded, Hologram]:
    recorded = choose()
    return recorded, recorded.hologram()
