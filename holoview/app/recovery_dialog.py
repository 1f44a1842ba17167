"""The dialog that offers the sessions that a crash left."""

from __future__ import annotations

import time

from imgui_bundle import imgui

from holoview.app import theme
from holoview.app.file_dialog import centre_next_window
from holoview.document.editing_session import EditingSession
from holoview.document.session_store import SavedSession, SessionStore
from holoview.util.errors import UserError
from holoview.util.text import printable

_RECOVER = "Recover your work"


class RecoveryDialog:
    """Offers sessions that a crash left: each can be recovered into the open session, or deleted.

    saved: the sessions that are still offered.
    """

    title = "Recovery"

    def __init__(self, session: EditingSession, store: SessionStore | None) -> None:
        self._session, self._store = session, store
        self.saved = [] if store is None else store.crashed_sessions()
        self._is_new = bool(self.saved)

    @property
    def is_open(self) -> bool:
        """Whether a session is still offered."""
        return bool(self.saved)

    def draw(self) -> None:
        """Draws the dialog while a session is offered."""
        if not self.saved:
            return
        if self._is_new:
            imgui.open_popup(_RECOVER)
            self._is_new = False
        centre_next_window(min(560.0, imgui.get_main_viewport().work_size.x - 20))
        is_shown, is_open = imgui.begin_popup_modal(_RECOVER, True, theme.DIALOG)
        if is_shown:
            imgui.text_wrapped("The viewer ended without closing. Your work up to then was saved:")
            for saved in list(self.saved):
                self._draw_one(saved)
            imgui.separator()
            if imgui.button("Later", imgui.ImVec2(120, 0)):
                self.saved = []
            imgui.same_line()
            imgui.text_disabled("they are offered again at the next start")
            if not self.saved:
                imgui.close_current_popup()
            imgui.end_popup()
        if not is_open:
            self.saved = []

    def recover(self, saved: SavedSession) -> None:
        """Restores a saved session into the open one and closes the dialog."""
        session = self._session
        assert self._store is not None
        try:
            saved.restore_into(session)
            session.messages.post(f"recovered, with {len(session.history) - 1} edits to undo")
            self._store.discard(saved)
        except UserError as error:
            session.messages.post_error(error, "recovery")
            session.messages.post(self._store.set_aside(saved.folder), "warning")
        self.saved = []

    def discard(self, saved: SavedSession) -> None:
        """Deletes a saved session."""
        assert self._store is not None
        self._store.discard(saved)
        self.saved = [other for other in self.saved if other != saved]

    def _draw_one(self, saved: SavedSession) -> None:
        imgui.push_id(str(saved.folder))
        imgui.separator()
        imgui.text_wrapped(printable(saved.title))
        when = time.strftime("%d %B, %H:%M", time.localtime(saved.when))
        imgui.text_disabled(f"{when}, {saved.steps - 1} edits")
        if imgui.button("Recover", imgui.ImVec2(120, 0)):
            self.recover(saved)
        imgui.same_line()
        if imgui.button("Discard", imgui.ImVec2(120, 0)):
            self.discard(saved)
        imgui.pop_id()
