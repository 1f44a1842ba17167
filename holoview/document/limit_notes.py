"""Where the model isn't true of what a session displays, found out once for each bench and focal plane."""

from __future__ import annotations

from holoview.document.editing_session import EditingSession
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.model.validity import exceeded_limits
from holoview.util.errors import UserError


class LimitNotes:
    """The limits of the model that the displayed bench exceeds at its planes and at the one that is shown."""

    def __init__(self, session: EditingSession) -> None:
        self._session = session
        self._known: tuple[System, float] | None = None
        self._notes: tuple[str, ...] = ()

    @property
    def known(self) -> tuple[str, ...]:
        """The notes that were found last, which may be of the bench before it was dragged."""
        return self._notes

    def notes(self) -> tuple[str, ...]:
        """Each limit as a sentence; for a bench that can't be computed or displayed at all, that alone."""
        try:
            document = self._session.displayed_document
        except UserError as error:  # such as of lasers all of which are muted
            return (str(error),)
        key = (document.system, document.view_settings.plane_m)
        if self._known is None or key != self._known:
            self._known, self._notes = key, _notes(*key)
        return self._notes


def _notes(system: System, plane_m: float) -> tuple[str, ...]:
    try:
        return exceeded_limits(make_plan(system, [*system.planes_m, plane_m]))
    except UserError as error:
        return (str(error),)
