"""The panel of the undo history: a click on an edit goes back or forward to it."""

from __future__ import annotations

import time

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.panel import Panel
from holoview.app.parameter_widgets import tooltip


class HistoryPanel(Panel):
    """Lists all edits, oldest first."""

    title = "History"
    dock = "Left"

    def __init__(self) -> None:
        self._scrolled_to = -1

    def draw(self, context: AppContext) -> None:
        """Draws buttons for undo and redo, and all steps; those that were undone are grey."""
        session = context.session
        width = (imgui.get_content_region_avail().x - imgui.get_style().item_spacing.x) / 2
        for name, act, is_possible in (
            ("Undo", session.undo, session.can_undo),
            ("Redo", session.redo, session.can_redo),
        ):
            imgui.begin_disabled(not is_possible)
            if imgui.button(name, imgui.ImVec2(width, 0)):
                context.attempt(act)
            imgui.end_disabled()
            if name == "Undo":
                imgui.same_line()
        imgui.begin_child("steps")
        for index, step in enumerate(session.history):
            self._draw_step(context, index, step.label, step.when)
        imgui.end_child()

    def _draw_step(self, context: AppContext, index: int, label: str, when: float) -> None:
        position = context.session.history_position
        is_undone = index > position
        if is_undone:
            imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
        clicked, _ = imgui.selectable(f"{label}##{index}", index == position)
        if is_undone:
            imgui.pop_style_color()
        tooltip(f"{time.strftime('%H:%M:%S', time.localtime(when))}; click to go here")
        if clicked:
            context.attempt(context.session.go_to_step, index)
        if index == position != self._scrolled_to:
            imgui.set_scroll_here_y()
            self._scrolled_to = position
