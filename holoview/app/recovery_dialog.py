"""The offer to take up a session again that a crash has left."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from imgui_bundle import imgui

from holoview.app.file_dialog import MODAL, centre_next_window
from holoview.app.panel import Panel
from holoview.session.autosave import SavedSession

if TYPE_CHECKING:
    from holoview.app.app import App

_RECOVER = "Recover your work"


class RecoveryDialog(Panel):
    """At the start after a crash: sessions that were left, to be taken up again or thrown away."""

    title = "Recovery"

    def __init__(self, saved: Sequence[SavedSession]) -> None:
        self.saved = list(saved)
        self._is_new = bool(self.saved)

    @property
    def is_open(self) -> bool:
        """Whether something is still offered."""
        return bool(self.saved)

    def draw(self, app: App) -> None:
        """Draws it while something is offered."""
        if not self.saved:
            return
        if self._is_new:
            imgui.open_popup(_RECOVER)
            self._is_new = False
        centre_next_window(min(560.0, imgui.get_main_viewport().work_size.x - 20))
        is_shown, is_open = imgui.begin_popup_modal(_RECOVER, True, MODAL)
        if is_shown:
            imgui.text_wrapped("The viewer ended without closing. Your work up to then was saved:")
            for saved in list(self.saved):
                self._draw_one(app, saved)
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

    def recover(self, app: App, saved: SavedSession) -> None:
        """Makes the open session the saved one, which is then no longer offered."""
        store, session = app.store, app.session
        assert store is not None
        with session.report_errors("recovery"):
            saved.restore_into(session)
            session.messages.post(f"recovered, with {len(session.history) - 1} edits to undo")
            store.discard(saved)
        self.saved = []

    def discard(self, app: App, saved: SavedSession) -> None:
        """Throws one away."""
        store = app.store
        assert store is not None
        store.discard(saved)
        self.saved = [other for other in self.saved if other != saved]

    def _draw_one(self, app: App, saved: SavedSession) -> None:
        imgui.push_id(str(saved.folder))
        imgui.separator()
        imgui.text_wrapped(saved.title)
        when = time.strftime("%d %B, %H:%M", time.localtime(saved.when))
        imgui.text_disabled(f"{when}, {saved.steps - 1} edits")
        if imgui.button("Recover", imgui.ImVec2(120, 0)):
            self.recover(app, saved)
        imgui.same_line()
        if imgui.button("Discard", imgui.ImVec2(120, 0)):
            self.discard(app, saved)
        imgui.pop_id()
