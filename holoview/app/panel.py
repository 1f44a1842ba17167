"""The base class of panels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import partial
from typing import ClassVar

from holoview.app.context import AppContext
from holoview.app.draw_guard import DrawGuard


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

    @abstractmethod
    def draw(self, context: AppContext) -> None:
        """Draws the content of the window; called in every frame in which it is visible."""


class GuardedPanel(DrawGuard):
    """A panel whose errors leave the other panels working."""

    def __init__(self, panel: Panel, context: AppContext) -> None:
        super().__init__(panel.title, partial(panel.draw, context), context.session.messages)
        self.panel = panel
