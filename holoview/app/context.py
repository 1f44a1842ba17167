"""The application context: what panels, overlays, menus and commands of the viewer share.

It holds the editing session, the GPU device, the renderers, the commands and the drawing services, and imports no
panel: panels import it, and `App` owns both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from imgui_bundle import hello_imgui, imgui
from numpy.typing import NDArray

from holoview.app import theme
from holoview.app.command_palette import CommandRegistry, HelpOverlay
from holoview.app.window import Window
from holoview.document.editing_session import EditingSession
from holoview.document.files import FileLoader
from holoview.document.focus import PupilMotion
from holoview.document.measure import LimitNotes, LiveMeasurement, LiveScore
from holoview.document.received_fields import ReceivedFields
from holoview.document.session_store import SessionStore
from holoview.document.speckle_jobs import RetinalCurves
from holoview.gpu.device import Device
from holoview.render.page_images import PageImages
from holoview.render.planes import PlanePreviews
from holoview.render.progressive_renderer import ProgressiveRenderer
from holoview.render.side_renderers import SideRenderers

if TYPE_CHECKING:
    from holoview.experiment.rig_session import RigSession

Rect = tuple[float, float, float, float]
"""Left, top, right, bottom in logical pixels of the window."""


class Overlay(Protocol):
    """Something that is drawn above all panels while it is open: a dialog, or help."""

    title: str

    def draw(self) -> None:
        """Draws it, if it is open."""


class AppContext:
    """The objects that panels, overlays, menus and commands share.

    Edits go through `attempt`, `change` and `edit_view`, which report errors to the user. store: the user's preferences
    and saved sessions; None where nothing is stored.

    renderer: that of the displayed document, if it has been started already. is_read_only: whether the user can't open,
    save or export files nor end the viewer; commands and buttons for these aren't there.
    drag_tool: what a drag on the image draws, "region" or "line"; "" pans. wants_measurement: set by a panel in each
    frame in which it shows measurements of the image. item_rects: where items were drawn in the last frame, by name.
    displayed_pixels: returns what the image panel shows, 8-bit sRGB (y, x, 3), or None before anything is shown.
    """

    def __init__(
        self,
        session: EditingSession,
        device: Device,
        window: Window,
        store: SessionStore | None,
        renderer: ProgressiveRenderer | None = None,
        *,
        is_read_only: bool = False,
    ) -> None:
        self.session, self.device, self.window, self.store = session, device, window, store
        self.is_read_only = is_read_only
        self.commands, self.item_rects = CommandRegistry(), dict[str, Rect]()
        self.drag_tool, self.wants_measurement = "", False
        self.side_renderers = SideRenderers(device, session, renderer)
        self.plane_previews = PlanePreviews(device)
        self.page_images = PageImages(device, session.call_on_owner, session.messages.post_error)
        self.live_measurement = LiveMeasurement(session, window.wake)
        self.live_psnr = LiveScore("psnr", session, window.wake)
        self.live_score = LiveScore("score", session, window.wake)
        self.limit_notes = LimitNotes(session)
        self.pupil_motion = PupilMotion(session)
        self._rig: RigSession | None = None
        self.retinal_curves = RetinalCurves(session)
        remember = store.preferences.add_recent_file if store is not None else lambda path: None
        self.loader = FileLoader(session, remember=remember)
        self.received_fields = ReceivedFields(session, lambda: not self.side_renderers.is_busy)
        stored_theme = store.preferences.get("theme", "") if store is not None else ""
        self.theme = stored_theme if stored_theme in theme.THEMES else theme.THEMES[0]
        self.help_overlay = HelpOverlay(self.commands, self._run_command)
        self.overlays: list[Overlay] = [self.help_overlay]
        self.displayed_pixels: Callable[[], NDArray[np.uint8] | None] = lambda: None

    @property
    def is_busy(self) -> bool:
        """Whether an image, a target or measurements are still being computed."""
        return (
            self.side_renderers.is_busy
            or self.plane_previews.is_busy
            or self.page_images.is_busy
            or self.session.target_builder.is_building
            or self.live_measurement.is_busy
            or self.live_psnr.is_busy
            or self.live_score.is_busy
        )

    @property
    def rig(self) -> RigSession:
        """The rig of the session, which may not have been opened; `opened_rig` tells whether it has."""
        if self._rig is None:
            from holoview.experiment.rig_session import RigSession  # slow start: most sessions open no rig

            self._rig = RigSession(self.session)
        return self._rig

    @property
    def opened_rig(self) -> RigSession | None:
        """The rig that was opened; None while there is none."""
        return None if self._rig is None or self._rig.rig is None else self._rig

    def attempt(self, edit: Callable[..., Any], *arguments: Any, **keywords: Any) -> None:
        """Calls `edit`; an error becomes a message to the user, and the document stays as it was."""
        with self.session.report_errors():
            edit(*arguments, **keywords)

    def change(self, label: str, key: str, value: Any, *, is_held: bool = False) -> None:
        """Changes a key of the system, as `System.edit` does. Edits while `is_held` merge into one step of undo."""
        self.attempt(self.session.change, label, {key: value}, merge_key=key)
        if not is_held:
            self.session.end_gesture()

    def edit_view(self, label: str, **fields: Any) -> None:
        """Changes fields of the view settings; successive edits of the same fields are one step of undo."""
        self.attempt(self.session.edit_view, label, merge_key=tuple(sorted(fields)), **fields)

    def show_panel(self, title: str) -> None:
        """Opens a panel's window and brings it to the front."""
        window = hello_imgui.get_runner_params().docking_params.dockable_window_of_name(title)
        if window is not None:
            window.is_visible = window.focus_window_at_next_frame = True
        self.window.wake()

    def record_item_rect(self, name: str) -> None:
        """Stores the rectangle of the item that ImGui drew last, for scripts and tests."""
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.item_rects[name] = (low.x, low.y, high.x, high.y)

    def set_theme(self, name: str) -> None:
        """Applies a theme of `theme.THEMES` and stores the choice."""
        self.theme = name
        theme.apply(name)
        if self.store is not None:
            self.attempt(self.store.preferences.set, "theme", name)

    @property
    def has_rig(self) -> bool:
        """Whether there may be devices to close."""
        return self._rig is not None

    def close_rig(self) -> str:
        """Switches the lasers off and closes the devices; returns why lasers may be on, or ""."""
        return "" if self._rig is None else self._rig.close()

    def close(self) -> None:
        """Ends the threads of the renderers, the loader, the listener and the measurement."""
        self.received_fields.close()
        self.loader.close()
        self.live_measurement.close()
        self.live_psnr.close()
        self.live_score.close()
        self.side_renderers.close()
        self.page_images.close()

    def _run_command(self, name: str) -> None:
        self.attempt(self.commands.run, name)
