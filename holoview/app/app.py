"""The viewer's frame loop: panels over one editing session, and rendering in short slices between frames."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar

from imgui_bundle import imgui

from holoview.app import theme
from holoview.app.context import AppContext
from holoview.app.menus import add_general_commands, draw_menus, draw_status
from holoview.app.panel import DrawGuard, GuardedPanel, Panel
from holoview.app.panels import ALL
from holoview.app.readout import add_score_commands
from holoview.app.toasts import Toasts
from holoview.app.tour import Tour
from holoview.app.window import Window
from holoview.app.window_layout import LayoutCallbacks, runner_params
from holoview.document.editing_session import Change, EditingSession
from holoview.document.session_store import SessionStore
from holoview.gpu.device import Device
from holoview.render.progressive_renderer import ProgressiveRenderer
from holoview.render.view_settings import NOW
from holoview.util.errors import UserError

P = TypeVar("P", bound=Panel)


class App:
    """Owns the window, the panels and the context that these share; draws a frame when something has changed.

    store: the user's preferences and saved sessions; None where nothing is stored. frame_s: see Window. panels: their
    classes. register_tests: called by ImGui's test engine, which then runs. tunes: whether the fastest strategy of
    the transforms for this device is searched for in the background. renderer: of the session's document, if it has
    been started already. is_read_only: whether the user can't open, save or export files nor end the viewer.

    awaits_frame: whether a new image hasn't been drawn yet. has_shown_image: whether one was ever drawn. danger: why
    lasers of a rig may be on after `close`, or "".
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
        renderer: ProgressiveRenderer | None = None,
        is_read_only: bool = False,
    ) -> None:
        self.session, self._tunes = session, tunes
        self.window = Window(canvas, device, frame_s=frame_s)
        self.context = AppContext(session, device, self.window, store, renderer, is_read_only=is_read_only)
        self.toasts = Toasts(session.messages)
        self.panels = [GuardedPanel(panel(), self.context) for panel in panels]
        self.tour = Tour(self.context)
        add_general_commands(self.context)
        for guarded in self.panels:
            guarded.panel.set_up(self.context)
        add_score_commands(self.context)
        self._overlays = [DrawGuard(overlay.title, overlay.draw, session.messages) for overlay in self.context.overlays]
        self._is_stale = True
        self.awaits_frame = self.has_shown_image = False
        self.danger = ""
        self._measured: tuple[object, ...] = ()
        params = runner_params(self.panels, self._callbacks(), None if store is None else store.folder)
        if register_tests is not None:
            params.use_imgui_test_engine, params.callbacks.register_tests = True, register_tests
        self.window.open(params)
        self._stop_listening = session.add_listener(self._on_change)

    def _callbacks(self) -> LayoutCallbacks:
        context, messages = self.context, self.session.messages
        return LayoutCallbacks(
            apply_theme=lambda: theme.apply(context.theme),
            draw_menus=DrawGuard("menus", partial(draw_menus, context), messages).draw,
            draw_status=DrawGuard("status", partial(draw_status, context), messages).draw,
            before_frame=self.before_frame,
            after_frame=self.after_frame,
        )

    # --- panels -----------------------------------------------------------------------------------------------------

    def panel(self, kind: type[P]) -> P:
        """The panel of a class."""
        return next(guarded.panel for guarded in self.panels if isinstance(guarded.panel, kind))

    # --- frames -----------------------------------------------------------------------------------------------------

    def before_frame(self) -> None:
        """Called before panels are drawn: takes results of worker threads, runs commands whose keys were pressed."""
        commands = self.context.commands
        self.session.poll()
        self.context.wants_measurement = False
        is_typing = imgui.get_io().want_text_input
        for command in list(commands.pressed(is_typing=is_typing)):
            self.context.attempt(command.action)
        if commands.is_repeating() and not is_typing:
            self.window.wake()
        self._move_pupil()
        self._update_requests()

    def after_frame(self) -> None:
        """Called after panels were drawn: draws what lies above them, and has the image measured if a panel asked."""
        for overlay in self._overlays:
            overlay.draw()
        self.toasts.draw()
        with suppress(UserError):  # while nothing can be displayed, there is nothing to measure
            self._measure()
        self.awaits_frame = False
        self.has_shown_image |= self.context.side_renderers.picture(NOW) is not None

    def compute_slice(self) -> bool:
        """Computes a slice of the images that are out of date; returns whether more can be computed at once."""
        renderers, previews = self.context.side_renderers, self.context.plane_previews
        self._update_requests()
        with self.session.report_errors():
            changed = renderers.compute_slice() if renderers.is_busy else previews.compute_slice()
            if changed:
                self.awaits_frame = True
                self.window.wake()
        if self._tunes and not self.is_busy:
            renderers.now.poll_strategy()
        return renderers.wait_s == 0 if renderers.is_busy else previews.is_busy

    def redraw_if_due(self) -> None:
        """Requests a frame for what changes with time: tooltips, the text cursor, expiring messages. Call it often."""
        has_changed = any(guarded.panel.has_changed(self.context) for guarded in self.panels)
        if self.window.needs_redraw() or self.toasts.has_changed() or has_changed:
            self.window.wake()

    @property
    def is_busy(self) -> bool:
        """Whether an image, a target or measurements are still being computed."""
        return self.context.is_busy

    def compute_until_idle(self, timeout_s: float = 120.0) -> None:
        """Computes until everything is up to date, for scripts and tests. Raises UserError after the timeout."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            self.session.poll()
            if not self.compute_slice() and not self.is_busy:
                self.session.poll()
                self._update_requests()
                if not self.is_busy:
                    return
            time.sleep(min(self.context.side_renderers.wait_s, 0.005))
        raise UserError("viewer", f"the image wasn't ready in {timeout_s:g} s", remedy="choose a smaller bench")

    def close(self) -> None:
        """Switches the lasers of a rig off, ends the session's jobs and threads, closes the window; twice is once."""
        if self.window.closed:
            return
        self._stop_listening()
        self.danger = self.context.close_rig()
        self.context.close()
        self.session.close()
        self.window.close()

    def _move_pupil(self) -> None:
        """Records where the pupil is, or moves it along its path, if either is being done."""
        motion = self.context.pupil_motion
        if motion.state:
            self.context.attempt(motion.advance, self.context.side_renderers.now.follows)
        if motion.state == "playing":
            self.window.wake()

    def _measure(self) -> None:
        """Requests measurements of the newest full image, if a panel showed measurements in this frame."""
        renderers = self.context.side_renderers
        xyz = renderers.xyz(NOW) if self.context.wants_measurement else None
        if xyz is None:
            return
        document, target = self.session.displayed_document, self.session.target_at()
        key = (id(xyz), document.measured_region, document.view_settings.profile, id(target))
        if key != self._measured:
            self._measured = key
            self.context.live_measurement.request(document, xyz, target, renderers.now.intensities())

    def _update_requests(self) -> None:
        """Asks the renderers for what the session shows now, if it has changed."""
        if self._is_stale:
            self._is_stale = False
            with self.session.report_errors():
                self.context.side_renderers.request()
                self.context.plane_previews.request(self.session.displayed_document.scene)

    def _on_change(self, change: Change) -> None:
        self._is_stale = True
        self.window.wake()
