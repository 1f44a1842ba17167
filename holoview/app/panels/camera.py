"""The panel of a rig's camera: live pictures beside their prediction."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.panel import Panel

if TYPE_CHECKING:
    from holoview.app.rig.camera_view import CameraPanes


class CameraPanel(Panel):
    """Shows what the camera sees and what it should see. view: that, once a rig was open; None before."""

    title = "Camera"
    dock = "Centre"
    starts_open = False
    flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse

    def __init__(self) -> None:
        self.view: CameraPanes | None = None

    def draw(self, context: AppContext) -> None:
        """Draws the pictures of an open rig."""
        if context.opened_rig is None:
            imgui.text_disabled("No rig is open.")
            return
        if self.view is None:
            from holoview.app.rig.camera_view import CameraPanes  # slow start: most sessions open no rig

            self.view = CameraPanes(context)
        self.view.draw(context)
