"""Notifications: messages that appear for a while in the corner of the window."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app import theme
from holoview.document.editing_session import Message, MessageLog

DURATIONS_S = {"info": 4.0, "warning": 8.0, "error": 12.0}
_WIDTH, _GAP, _MOST = 380.0, 10.0, 4
_COLOURS = {"info": theme.ACCENT, "warning": theme.WARNING, "error": theme.ERROR}


class Toasts:
    """Draws the newest messages of a session until they expire or the user closes them."""

    def __init__(self, messages: MessageLog) -> None:
        self._messages = messages
        self._closed: set[float] = set()
        self._drawn: list[float] = []

    def visible(self) -> list[Message]:
        """The messages to show, newest first."""
        messages = [
            message
            for kind, seconds in DURATIONS_S.items()
            for message in self._messages.recent(seconds)
            if message.kind == kind and message.when not in self._closed
        ]
        return sorted(messages, key=lambda message: -message.when)[:_MOST]

    def has_changed(self) -> bool:
        """Whether other messages are to be shown than were drawn last."""
        return [message.when for message in self.visible()] != self._drawn

    def draw(self) -> None:
        """Draws the messages above everything else."""
        viewport = imgui.get_main_viewport()
        right = viewport.work_pos.x + viewport.work_size.x - _GAP
        bottom = viewport.work_pos.y + viewport.work_size.y - _GAP - imgui.get_frame_height()
        messages = self.visible()
        self._drawn = [message.when for message in messages]
        for number, message in enumerate(messages):
            bottom = self._draw_one(number, message, right, bottom) - _GAP

    def _draw_one(self, number: int, message: Message, right: float, bottom: float) -> float:
        imgui.set_next_window_pos(imgui.ImVec2(right, bottom), imgui.Cond_.always, imgui.ImVec2(1.0, 1.0))
        imgui.set_next_window_size(imgui.ImVec2(_WIDTH, 0.0))
        flags = (
            imgui.WindowFlags_.no_decoration
            | imgui.WindowFlags_.no_docking
            | imgui.WindowFlags_.no_move
            | imgui.WindowFlags_.no_saved_settings
            | imgui.WindowFlags_.no_focus_on_appearing
            | imgui.WindowFlags_.no_nav
        )
        imgui.begin(f"##toast{number}", None, flags)
        imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())
        imgui.push_style_color(imgui.Col_.text, _COLOURS[message.kind])
        imgui.text({"info": "Note", "warning": "Warning", "error": "Not done"}[message.kind])
        imgui.pop_style_color()
        imgui.push_text_wrap_pos(0.0)
        imgui.text_unformatted(message.text)
        imgui.pop_text_wrap_pos()
        if imgui.small_button("Close"):
            self._closed.add(message.when)
        if message.details:
            imgui.same_line()
            if imgui.small_button("Copy details"):
                imgui.set_clipboard_text(message.details)
        top = imgui.get_window_pos().y
        imgui.end()
        return top
