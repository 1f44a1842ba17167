"""The base class of panels, and drawing that may fail: an exception ends one panel and leaves the others working."""

from __future__ import annotations

import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from imgui_bundle import imgui

from holoview.viewer.app.context import AppContext
from holoview.viewer.document.editing_session import MessageLog

_BARE = (  # a tab has a cross of its own, and in a small window all tabs are to be seen
    imgui.internal.DockNodeFlagsPrivate_.no_close_button.value
    | imgui.internal.DockNodeFlagsPrivate_.no_window_menu_button.value
)


class Panel(ABC):
    """A dockable window of the viewer.

    title: its name for people, menus and tests. dock: where it is at first, "Left", "Centre", "Right", "Low right" or
    "Bottom". starts_open: whether it is visible then. flags: of ImGui's window.
    """

    title: ClassVar[str]
    dock: ClassVar[str] = "Left"
    starts_open: ClassVar[bool] = True
    flags: ClassVar[int] = 0

    def set_up(self, context: AppContext) -> None:  # noqa: B027 (most panels have nothing to set up)
        """Called once, before the first frame: adds commands and overlays."""

    def has_changed(self, context: AppContext) -> bool:
        """Whether it has to be drawn again though nothing has happened, as for a time that it shows."""
        return False

    def wants_to_open(self, context: AppContext) -> bool:
        """Whether its window is to be opened now, as for something new that it shows; asked before each frame."""
        return False

    @abstractmethod
    def draw(self, context: AppContext) -> None:
        """Draws the content of the window; called in every frame in which it is visible."""


class DrawGuard:
    """Calls a drawing function; after an exception, shows the error in its place until the user tries again.

    title: names what is drawn in the message to the user. failure: the exception, None while drawing works.
    """

    def __init__(self, title: str, draw: Callable[[], None], messages: MessageLog) -> None:
        self._title, self._draw, self._messages = title, draw, messages
        self.failure: Exception | None = None
        self._details = ""

    def draw(self) -> None:
        """Draws, or shows the error of an earlier frame."""
        if self.failure is not None:
            self._draw_failure(self.failure)
            return
        state = imgui.internal.ErrorRecoveryState()
        imgui.internal.error_recovery_store_state(state)
        try:
            self._draw()
        except Exception as error:  # a defect in one panel must not close the window
            _close_open_widgets(state)
            self.failure = error
            self._details = "".join(traceback.format_exception(error))
            self._messages.post_error(error, f"panel {self._title}")

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
    """Closes the widgets that were open when drawing failed, without ImGui's assertions and tooltips about them."""
    io = imgui.get_io()
    before = io.config_error_recovery_enable_assert, io.config_error_recovery_enable_tooltip
    io.config_error_recovery_enable_assert = io.config_error_recovery_enable_tooltip = False
    imgui.internal.error_recovery_try_to_recover_state(state)
    io.config_error_recovery_enable_assert, io.config_error_recovery_enable_tooltip = before


class GuardedPanel(DrawGuard):
    """A panel whose errors leave the other panels working."""

    def __init__(self, panel: Panel, context: AppContext) -> None:
        super().__init__(panel.title, self._draw_panel, context.session.messages)
        self.panel, self._context = panel, context
        self._tab_px = 0.0  # the width of its tab in the last frame

    def draw(self) -> None:
        """Draws the panel, in a dock that leaves all the width to its tabs."""
        window = imgui.internal.get_current_window()
        node = window.dock_node
        if node is not None and node.local_flags & _BARE != _BARE:
            node.set_local_flags(node.local_flags | _BARE)
        tabs = None if node is None else node.tab_bar
        if tabs is not None:
            tab = imgui.internal.tab_bar_find_tab_by_id(tabs, window.tab_id)
            if tab is not None and tab.width != self._tab_px:  # ImGui scrolls to a new tab, before its cross widens it
                self._tab_px, tabs.next_scroll_to_tab_id = tab.width, window.tab_id
                self._context.window.wake()
            if tabs.scrolling_anim != tabs.scrolling_target:
                self._context.window.wake()  # until the tabs that scroll have come to rest
        super().draw()

    def _draw_panel(self) -> None:
        self.panel.draw(self._context)
