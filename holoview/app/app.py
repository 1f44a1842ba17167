"""The app: panels over one session, drawn when something happened, with computing in between in small slices."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from imgui_bundle import hello_imgui, imgui
from numpy.typing import NDArray

from holoview.app import theme
from holoview.app import window_layout as layout
from holoview.app.command_registry import CommandRegistry
from holoview.app.derived_images import DerivedImages
from holoview.app.general_commands import add_general_commands
from holoview.app.help_overlay import HelpOverlay
from holoview.app.panel import GuardedPanel, Panel
from holoview.app.panels import ALL
from holoview.app.panels.image import ImagePanel
from holoview.app.plane_previews import PlanePreviews
from holoview.app.side_renderers import SideRenderers
from holoview.app.textures import TextureCache
from holoview.app.toasts import Toasts
from holoview.app.window import Window
from holoview.gpu.device import Device
from holoview.session.autosave import SessionStore
from holoview.session.changes import Change
from holoview.session.editing_session import EditingSession
from holoview.session.file_loader import FileLoader
from holoview.session.live_measurement import LiveMeasurement
from holoview.session.view_settings import NOW
from holoview.util.errors import UserError

Rect = tuple[float, float, float, float]
P = TypeVar("P", bound=Panel)


class App:
    """What panels are given. `session` is the document; edits go through it by `attempt`, `change` and `look`.

    store: the user's preferences and saved sessions, None where nothing is kept. frame_s: see Window. panels: their
    classes. tests: called by ImGui's test engine, which then runs. tunes: whether the fastest strategy for the
    device is looked for in the background.
    """

    def __init__(
        self,
        session: EditingSession,
        device: Device,
        canvas: Any,
        *,
        store: SessionStore | None = None,
        frame_s: float | None = None,
        panels: Sequence[type[Panel]] = ALL,
        register_tests: Callable[[], None] | None = None,
        tunes: bool = False,
    ) -> None:
        self.session, self.device, self.store = session, device, store
        self.commands, self.drag_tool, self.wants_measurement = CommandRegistry(), "", False
        self.item_rects: dict[str, Rect] = {}
        self.side_renderers, self.plane_previews, self.derived_images = (
            SideRenderers(device, session),
            PlanePreviews(device, session),
            DerivedImages(device, session),
        )
        self.live_measurement = LiveMeasurement(session, self._wake)
        remember = store.preferences.add_recent_file if store is not None else lambda path: None
        self.loader = FileLoader(session, remember=remember)
        self.theme = str(store.preferences.get("theme", theme.THEMES[0])) if store else theme.THEMES[0]
        self.toasts, self._textures = Toasts(session.messages), TextureCache(device)
        self.help_overlay = HelpOverlay(self)
        self.overlays: list[Panel] = [self.help_overlay]
        self.panels = [GuardedPanel(panel(), self) for panel in panels]
        self._tunes, self._is_stale = tunes, True
        self._measured: tuple[object, ...] = ()
        add_general_commands(self)
        for guarded in self.panels:
            guarded.panel.set_up(self)
        self._above = [GuardedPanel(panel, self) for panel in self.overlays]
        params = layout.runner_params(self, store)
        if register_tests is not None:
            params.use_imgui_test_engine, params.callbacks.register_tests = True, register_tests
        self.window = Window(canvas, device, params, frame_s=frame_s)
        self._textures.window = self.window
        self._stop_listening = session.add_listener(self._on_change)

    # --- for panels -------------------------------------------------------------------------------------------------

    def attempt(self, edit: Callable[..., Any], *arguments: Any, **keywords: Any) -> None:
        """Calls an edit of the session; where that is impossible, the user is told why and all stays as it was."""
        with self.session.report_errors():
            edit(*arguments, **keywords)

    def change(self, label: str, key: str, value: Any, *, is_held: bool = False) -> None:
        """Changes a key of the bench, as `System.edit` does; edits of one drag are one step of undo."""
        self.attempt(self.session.change, label, {key: value}, merge_key=key)
        if not is_held:
            self.session.end_gesture()

    def edit_view(self, label: str, **fields: Any) -> None:
        """Changes fields of the look; edits of the same fields in a row are one step of undo."""
        self.attempt(self.session.edit_view, label, merge_key=tuple(sorted(fields)), **fields)

    def record_item_rect(self, name: str) -> None:
        """Notes where the last item is, for tests and hints."""
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.item_rects[name] = (low.x, low.y, high.x, high.y)

    def panel(self, kind: type[P]) -> P:
        """The panel of a class."""
        return next(guarded.panel for guarded in self.panels if isinstance(guarded.panel, kind))

    def show_panel(self, title: str) -> None:
        """Opens a panel's window and brings it to the front."""
        window = hello_imgui.get_runner_params().docking_params.dockable_window_of_name(title)
        if window is not None:
            window.is_visible = window.focus_window_at_next_frame = True
        self.window.wake()

    def texture(self, key: str, pixels: NDArray[np.uint8]) -> imgui.ImTextureRef:
        """A texture of 8-bit pixels (y, x, 3 or 4) for `imgui.image`; another array under the same key replaces it."""
        return self._textures.get(key, pixels)

    def displayed_pixels(self) -> NDArray[np.uint8] | None:
        """What the image panel shows, 8-bit sRGB (y, x, 3); None before anything is shown."""
        return self.panel(ImagePanel).displayed_pixels()

    def quit(self) -> None:
        """Closes the window after this frame."""
        self.window.params.app_shall_exit = True

    def set_theme(self, name: str) -> None:
        """Makes a theme of `theme.THEMES` the present one."""
        self.theme = name
        theme.apply(name)
        if self.store is not None:
            self.attempt(self.store.preferences.set, "theme", name)

    # --- frames -----------------------------------------------------------------------------------------------------

    def before_frame(self) -> None:
        """What is done before panels are drawn: what workers delivered, and keys."""
        self.session.poll()
        self.wants_measurement = False
        if not imgui.get_io().want_text_input:
            for command in list(self.commands.pressed()):
                self.attempt(command.action)
            if self.commands.is_repeating():
                self.window.wake()
        self._refresh()

    def after_frame(self) -> None:
        """What lies above all panels."""
        for guarded in self._above:
            guarded.draw()
        self.toasts.draw()
        self._measure()

    def compute_slice(self) -> bool:
        """Computes a slice of what is stale; whether there may be more to do at once."""
        self._refresh()
        with self.session.report_errors():
            changed = (
                self.side_renderers.compute_slice()
                if self.side_renderers.is_busy
                else self.plane_previews.compute_slice()
            )
            if changed:
                self.window.wake()
        if self._tunes and not self.is_busy:
            self.side_renderers.now.poll_strategy()
        return self.side_renderers.wait_s == 0 if self.side_renderers.is_busy else self.plane_previews.is_busy

    def redraw_if_due(self) -> None:
        """Draws what changes by itself with time: tooltips, a text's cursor, messages that go. Call it now and then."""
        if self.window.needs_redraw() or self.toasts.has_changed():
            self.window.wake()

    @property
    def is_busy(self) -> bool:
        """Whether an image, a target or figures are still on their way."""
        return (
            self.side_renderers.is_busy
            or self.plane_previews.is_busy
            or self.derived_images.is_busy
            or self.session.target_builder.is_building
            or self.live_measurement.is_busy
        )

    def compute_until_idle(self, timeout_s: float = 120.0) -> None:
        """Computes until nothing is stale: for scripts and tests. Raises UserError when that takes too long."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            self.session.poll()
            if not self.compute_slice() and not self.is_busy:
                self.session.poll()
                self._refresh()
                if not self.is_busy:
                    return
            time.sleep(min(self.side_renderers.wait_s, 0.005))
        raise UserError("viewer", f"the image wasn't ready in {timeout_s:g} s", remedy="choose a smaller bench")

    def close(self) -> None:
        """Ends the session's work and closes the window."""
        self._stop_listening()
        self.loader.close()
        self.live_measurement.close()
        self.side_renderers.close()
        self.derived_images.close()
        self.session.close()
        self.window.close()

    def _measure(self) -> None:
        """Has the newest full image measured, where a panel asked for figures in this frame."""
        xyz = self.side_renderers.xyz(NOW) if self.wants_measurement else None
        if xyz is None:
            return
        shown, target = self.session.displayed_document, self.session.target_at()
        asked = (id(xyz), shown.measured_region, shown.view_settings.profile, id(target))
        if asked != self._measured:
            self._measured = asked
            self.live_measurement.request(shown, xyz, target, self.side_renderers.now.intensities())

    def _refresh(self) -> None:
        if self._is_stale:
            self._is_stale = False
            with self.session.report_errors():
                self.side_renderers.request()
                self.plane_previews.request()

    def _on_change(self, change: Change) -> None:
        self._is_stale = True
        self._wake()

    def _wake(self) -> None:
        self.window.wake()
