"""Moves the order of a recording that a session's field is cut out of: the image follows, from a worker thread."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from holoview.document.document import Gesture
from holoview.document.editing_session import EditingSession
from holoview.io.hologram import Hologram
from holoview.io.load_field import RecordedOrders
from holoview.util.processes import LatestTask


class OrderEditor:
    """Edits the orders of a session's recording; of edits that come fast, the newest is shown."""

    def __init__(self, session: EditingSession) -> None:
        self._session = session
        self._task: LatestTask[tuple[RecordedOrders, Hologram]] = LatestTask(
            "order", session.call_on_owner, session.messages.post_error
        )
        self._wanted: RecordedOrders | None = None
        self._gesture = Gesture()

    @property
    def chosen(self) -> RecordedOrders | None:
        """The orders that are chosen, while their field is computed too; None without a recording."""
        shown = self._session.document.recorded
        is_pending = self.is_busy and self._wanted is not None and shown is not None
        return self._wanted if is_pending else shown

    @property
    def is_busy(self) -> bool:
        """Whether a field is being computed."""
        return self._task.is_busy

    def choose(self, chosen: RecordedOrders) -> None:
        """Shows the field of other orders; the choices until `end_drag` are one step of undo."""
        self._wanted = chosen
        self._task.submit(partial(_with_field, lambda: chosen), partial(self._show, self._gesture))

    def end_drag(self) -> None:
        """The next choice is a separate step of undo; a field that is still computed belongs to the last choice."""
        self._gesture = Gesture()

    def find(self) -> None:
        """Shows the field of the orders that stand out of the spectra."""
        shown = self._session.document.recorded
        if shown is not None:
            self._wanted = None
            self._task.submit(partial(_with_field, shown.found), partial(self._show, Gesture()))

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _show(self, gesture: Gesture, found: tuple[RecordedOrders, Hologram]) -> None:
        recorded, hologram = found
        shown = self._session.document.recorded
        if shown is not None and shown.recording is recorded.recording:
            self._session.edit("Order", drive=hologram.drive, recorded=recorded, merge_key=gesture)


def _with_field(choose: Callable[[], RecordedOrders]) -> tuple[RecordedOrders, Hologram]:
    recorded = choose()
    return recorded, recorded.hologram()
