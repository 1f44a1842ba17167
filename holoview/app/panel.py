"""What a panel is, and how one that fails leaves the others alone."""

from __future__ import annotations

import traceback
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from imgui_bundle import imgui

if TYPE_CHECKING:
    from holoview.app.app import App

DOCKS = ("Left", "Centre", "Right", "Low right", "Bottom")


class Panel(ABC):
    """A window of the app. `title` names it for people, menus and tests; `dock` is one of DOCKS, where it starts."""

    title: ClassVar[str]
    dock: ClassVar[str] = "Left"
    starts_open: ClassVar[bool] = True
    flags: ClassVar[int] = 0

    def set_up(self, app: App) -> None:  # noqa: B027 (most panels have nothing to begin)
        """Called once, when the app is complete: add commands and listeners here."""

    @abstractmethod
    def draw(self, app: App) -> None:
        """Draws the inside of the window; called every frame in which it is visible."""


class GuardedPanel:
    """Draws a panel; an exception ends its drawing, is shown in its place, and the rest of the frame goes on."""

    def __init__(self, panel: Panel, app: App) -> None:
        self.panel, self._app = panel, app
        self.failure: Exception | None = None
        self._details = ""

    def draw(self) -> None:
        """Draws the panel, or what it failed of."""
        if self.failure is not None:
            self._draw_failure(self.failure)
            return
        state = imgui.internal.ErrorRecoveryState()
        imgui.internal.error_recovery_store_state(state)
        try:
            self.panel.draw(self._app)
        except Exception as error:  # whatever a panel does, the window stays
            _close_open_widgets(state)
            self.failure = error
            self._details = "".join(traceback.format_exception(error))
            self._app.session.messages.post_error(error, f"panel {self.panel.title}")

    def _draw_failure(self, error: Exception) -> None:
        imgui.text_wrapped(f"This panel failed: {type(error).__name__}: {error}")
        imgui.text_wrapped("The others go on, and nothing of your work is lost.")
        if imgui.button("Try again"):
            self.failure = None
        imgui.same_line()
        if imgui.button("Copy details"):
            imgui.set_clipboard_text(self._details)
        imgui.separator()
        imgui.push_text_wrap_pos(0.0)
        imgui.text_disabled(self._details)
        imgui.pop_text_wrap_pos()


def _close_open_widgets(state: imgui.internal.ErrorRecoveryState) -> None:
    """Closes what the failed panel had open, without ImGui's own complaints."""
    io = imgui.get_io()
    before = io.config_error_recovery_enable_assert, io.config_error_recovery_enable_tooltip
    io.config_error_recovery_enable_assert = io.config_error_recovery_enable_tooltip = False
    imgui.internal.error_recovery_try_to_recover_state(state)
    io.config_error_recovery_enable_assert, io.config_error_recovery_enable_tooltip = before
