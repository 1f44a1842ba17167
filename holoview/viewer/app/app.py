"""The viewer's frame loop: panels over one editing session, and rendering in short slices between frames."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any, TypeVar

from imgui_bundle import hello_imgui, imgui

from holoview.holograms.view import random_drive
from holoview.light.colour import fitting_stops
from holoview.light.gpu.device import Device
from holoview.light.model import preset
from holoview.util.errors import UserError
from holoview.util.mailbox import are_same
from holoview.util.processes import PREFIX
from holoview.util.text import printable
from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext, Command, Rect
from holoview.viewer.app.keyboard_focus import OF_WIDGETS, KeyboardFocus
from holoview.viewer.app.panel import DrawGuard, GuardedPanel, Panel
from holoview.viewer.app.panels import ALL
from holoview.viewer.app.readout import add_score_commands
from holoview.viewer.app.theme import THEMES
from holoview.viewer.app.tour import Tour
from holoview.viewer.app.widgets import label_of, tooltip
from holoview.viewer.app.window import Window
from holoview.viewer.document.editing_session import Change, EditingSession, Message, MessageLog
from holoview.viewer.document.example import show_example
from holoview.viewer.document.jobs import format_job
from holoview.viewer.document.measurements import SeenPicture
from holoview.viewer.document.optimisation_job import load_optimiser
from holoview.viewer.document.session_store import SessionStore
from holoview.viewer.render.progressive_renderer import ProgressiveRenderer
from holoview.viewer.render.view_settings import NOW, SPECKLE_EXPOSURE_STOPS

P = TypeVar("P", bound=Panel)
_PREPARES_AFTER_S = 0.5  # without an event, and with nothing to compute
_MOST_PREPARED = 2**24  # samples of a target in all planes: 200 MB


class App:
    """Owns the window, the panels and the context that these share; draws a frame when something has changed.

    store: the user's preferences and saved sessions; None where nothing is stored. frame_s: see Window. panels: their
    classes. register_tests: called by ImGui's test engine, which then runs. tunes: whether the fastest strategy of
    the transforms for this device is searched for in the background, and the optimiser prepared there. renderer: of the
    session's document, if it has been started already. is_read_only: whether the user can't open, save or export files
    nor end the viewer.

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
        self.toasts = Toasts(session.messages, lambda: self.context.picture_place)
        self.panels = [GuardedPanel(panel(), self.context) for panel in panels]
        self.tour = Tour(self.context)
        add_general_commands(self.context)
        self.keyboard_focus = KeyboardFocus(
            self.context.show_panel, lambda: [guarded.panel.title for guarded in self.panels], self.window.wake
        )
        for name, step, keys in (("Next panel", 1, "F6"), ("Panel before", -1, "Shift+F6")):
            help = "Gives the keys to its widgets: Tab and arrows move, Space or Enter change, Escape ends."
            go, has_no_menu = partial(self.keyboard_focus.go, step), lambda: not is_menu_open()
            self.context.commands.add("Window", name, go, keys, help, is_enabled=has_no_menu, is_urgent=True)
        for guarded in self.panels:
            guarded.panel.set_up(self.context)
        add_score_commands(self.context)
        _add_menu_commands(self.context, [guarded.panel.title for guarded in self.panels])
        self._overlays = [DrawGuard(overlay.title, overlay.draw, session.messages) for overlay in self.context.overlays]
        self._is_stale, self._is_prepared, self._busy_at = True, False, time.perf_counter()
        self.awaits_frame = self.has_shown_image = False
        self.danger = ""
        self._measured: tuple[object, ...] = ()
        self._counted = "", 1  # the title, and which of the windows of this title this is
        self._named: tuple[str, ...] = ()  # whose signs have been looked for in the fonts
        params = runner_params(self.panels, self._callbacks(), None if store is None else store.folder)
        if register_tests is not None:
            params.use_imgui_test_engine, params.callbacks.register_tests = True, register_tests
        self.window.open(params)
        self._stop_listening = session.add_listener(self._on_change)

    def _callbacks(self) -> LayoutCallbacks:
        context, messages = self.context, self.session.messages
        return LayoutCallbacks(
            apply_theme=lambda: theme.apply(context.theme, context.text_size),
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
        self.session.hold(self._is_held())
        self.session.poll()
        self.context.received_fields.poll()
        self.context.side_renderers.leave_processor(bool(self.session.jobs.active))
        self.context.wants_measurement, self.context.picture_place = False, None
        self._show_title()
        self._take_keys()
        for guarded in self.panels:
            if guarded.panel.wants_to_open(self.context):
                self.context.show_panel(guarded.panel.title)
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
        renderers, previews, kept = self.context.side_renderers, self.context.plane_previews, self.context.kept_pictures
        self._update_requests()
        with self.session.report_errors():
            first = renderers if renderers.is_busy else previews if previews.is_busy else kept
            if first.compute_slice():
                self._fit_exposure()
                self.awaits_frame = True
                self.window.wake()
        if self._tunes and not self.is_busy:
            renderers.now.poll_strategy()
        return renderers.wait_s == 0 if renderers.is_busy else previews.is_busy or kept.is_busy

    def _fit_exposure(self) -> None:
        """Fits the exposure to the first picture of a field that has just been opened; this is no step of undo."""
        xyz = self.context.side_renderers.now.shown_xyz() if self.session.fits_exposure else None
        if xyz is not None:
            self.session.fits_exposure = False
            self.session.edit_view("Exposure", exposure_stops=round(fitting_stops(xyz), 2), undoable=False)

    def redraw_if_due(self) -> None:
        """Requests a frame for what changes with time: tooltips, the text cursor, expiring messages. Call it often.

        Once the window rests, what an optimisation needs is prepared, so that its first iteration comes sooner.
        """
        has_changed = any(guarded.panel.has_changed(self.context) for guarded in self.panels)
        if self.window.needs_redraw() or self.toasts.has_changed() or has_changed:
            self.window.wake()
        if self._tunes and not self._is_prepared:
            now = time.perf_counter()
            self._busy_at = now if self.is_busy or not self.has_shown_image else self._busy_at
            if min(now - self._busy_at, self.window.rested_s) > _PREPARES_AFTER_S:
                self._prepare_optimisation()

    def _prepare_optimisation(self) -> None:
        """Loads the optimiser and builds the target on threads, since an optimisation is likely to come."""
        document = self.session.document
        if document.target_spec is None:
            return
        self._is_prepared = True
        Thread(target=load_optimiser, name=f"{PREFIX}optimiser", daemon=True).start()
        if math.prod(document.image_shape) * len(document.system.planes_m) <= _MOST_PREPARED:
            self.session.target_at()

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
        """Switches the lasers of a rig off, closes the window, ends the session's jobs and threads; twice is once."""
        if self.window.closed:
            return
        self._stop_listening()
        self.danger = self.context.close_rig()
        self.window.close()  # first: it stores the layout, and a program that is in a hurry doesn't wait for the rest
        self.context.close()
        self.session.close()

    def _is_held(self) -> bool:
        """Whether a button is held, or let go in this frame, or a key repeats: edits may belong together."""
        buttons = range(imgui.MouseButton_.count)
        is_down = any(imgui.is_mouse_down(button) or imgui.is_mouse_released(button) for button in buttons)
        return is_down or self.context.commands.is_repeating()

    def _take_keys(self) -> None:
        """Runs the commands whose keys were pressed.

        An open menu, dialog or help has the keys: only urgent commands pass it, and those of help its own. Escape
        closes the innermost menu; dialogs and help close themselves.
        """
        commands, help_page = self.context.commands, self.context.help_overlay.page
        is_open = is_menu_open()
        is_typing = imgui.get_io().want_text_input
        is_covered = is_open or bool(help_page)
        has_left = not is_covered and self.keyboard_focus.begin_frame(is_typing=is_typing)
        taken = OF_WIDGETS if has_left or self.keyboard_focus.is_on_widget else frozenset()
        for command in list(commands.pressed(is_typing=is_typing or is_open, taken=taken)):
            if not help_page or command.group == "Help" or command.is_urgent:
                self.context.attempt(command.action)
        if is_open and not is_typing and imgui.is_key_pressed(imgui.Key.escape, repeat=False):
            _close_innermost_menu()
        if commands.is_repeating() and not is_typing:
            self.window.wake()

    def _show_title(self) -> None:
        """Names the file in the window's title; of several windows on it each further one has a number."""
        title, store = self.session.document.title, self.context.store
        if title != self._counted[0]:
            self._counted = title, 1 + (0 if store is None else store.windows_before(title))
        self.window.set_title(window_title(self.session, self._counted[1]))
        names = (title, *self.session.snapshots)
        if names != self._named:
            self._named = names
            self._tell_of_fonts(theme.font_advice(names))

    def _tell_of_fonts(self, advice: str) -> None:
        """Posts what to do about names that can't be drawn, once."""
        if advice and not any(message.text == advice for message in self.session.messages.all):
            self.session.messages.post(advice, "warning")

    def _move_pupil(self) -> None:
        """Records where the pupil is, or moves it along its path, if either is being done."""
        motion = self.context.pupil_motion
        if motion.state:
            self.context.attempt(motion.advance, self.context.side_renderers.now.follows)
        if motion.state == "playing":
            self.window.wake()

    def _measure(self) -> None:
        """Requests measurements of the newest full image, if a panel showed measurements in this frame."""
        images = self.context.shown_images() if self.context.wants_measurement else []
        if not images:
            return
        document, (now, *others) = self.session.displayed_document, images
        marks = (document.measured_region, document.measured_regions, document.view_settings.profile)
        inputs = (*marks, *(part for image in images for part in (image.name, image.xyz, image.target)))
        if not are_same(inputs, self._measured):
            self._measured = inputs
            luminances = self.context.side_renderers.now.luminances()
            self.context.live_measurement.request(document, now.xyz, now.target, luminances, others, now.other_targets)

    def _update_requests(self) -> None:
        """Asks the renderers for what the session shows now, if it has changed; at first that of the files to open."""
        is_waiting = self.context.loader.is_opening and not self.has_shown_image
        if self._is_stale and not is_waiting:
            self._is_stale = False
            with self.session.report_errors():
                self.context.side_renderers.request()
                self.context.plane_previews.request(self.session.displayed_document.scene)

    def _on_change(self, change: Change) -> None:
        self._is_stale = True
        self.window.wake()


def _close_innermost_menu() -> None:
    """Closes the menu, list or pop-up that was opened last, unless it is a dialog."""
    stack = imgui.get_current_context().open_popup_stack
    window = stack[len(stack) - 1].window
    if window is None or not window.flags & imgui.WindowFlags_.modal.value:
        imgui.internal.close_popup_to_level(len(stack) - 1, True)


# --- the arrangement of windows, and what HelloImGui calls ---


_SPLITS = (
    ("MainDockSpace", "Left", imgui.Dir.left, 0.285),
    ("MainDockSpace", "Right", imgui.Dir.right, 0.35),
    ("Right", "Low right", imgui.Dir.down, 0.50),
    ("MainDockSpace", "Bottom", imgui.Dir.down, 0.20),
)
"""Docks: the one that is split, the new one, where it lies, and its share of the space."""
_DOCK_NAMES = {"Centre": "MainDockSpace"}


@dataclass(frozen=True)
class LayoutCallbacks:
    """Functions for HelloImGui: called once for the theme, then each frame for menus, status bar, and around panels."""

    apply_theme: Callable[[], None]
    draw_menus: Callable[[], None]
    draw_status: Callable[[], None]
    before_frame: Callable[[], None]
    after_frame: Callable[[], None]


def runner_params(
    panels: Iterable[GuardedPanel], callbacks: LayoutCallbacks, folder: Path | None
) -> hello_imgui.RunnerParams:
    """The settings of HelloImGui: a full-screen dock space, menus, status bar, a dockable window for each panel.

    folder: where the layout is stored as layout.ini; None, or one that can't be written to, stores nothing.
    """
    params = hello_imgui.RunnerParams()
    params.app_window_params.window_title = "holoview"
    window = params.imgui_window_params
    window.default_imgui_window_type = hello_imgui.DefaultImGuiWindowType.provide_full_screen_dock_space
    window.show_menu_bar = window.show_status_bar = True
    window.show_menu_app = window.show_menu_view = window.show_status_fps = False
    window.remember_status_bar_settings = window.remember_theme = False
    if folder is None or not _can_be_written_to(folder):
        params.ini_disable = True
    else:
        params.ini_folder_type = hello_imgui.IniFolderType.absolute_path
        params.ini_filename = str(folder / "layout.ini")
    params.docking_params.docking_splits = [hello_imgui.DockingSplit(*split) for split in _SPLITS]
    params.docking_params.dockable_windows = [_dockable_window(guarded) for guarded in panels]
    _set_callbacks(params.callbacks, callbacks)
    return params


def _can_be_written_to(folder: Path) -> bool:
    """Whether a folder, which is made if it is missing, takes files; the home folder may be missing or read-only."""
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return os.access(folder, os.W_OK)


def _set_callbacks(target: hello_imgui.RunnerCallbacks, callbacks: LayoutCallbacks) -> None:
    def configure_imgui() -> None:
        io = imgui.get_io()
        io.config_windows_move_from_title_bar_only = True
        io.config_input_trickle_event_queue = True
        callbacks.apply_theme()

    target.default_icon_font = hello_imgui.DefaultIconFont.no_icons
    target.load_additional_fonts = theme.load_fonts
    target.setup_imgui_style = callbacks.apply_theme
    target.post_init = configure_imgui
    target.pre_new_frame = lambda: None
    target.show_menus = callbacks.draw_menus
    target.show_status = callbacks.draw_status
    target.before_imgui_render = callbacks.after_frame
    target.post_new_frame = callbacks.before_frame


def _dockable_window(guarded: GuardedPanel) -> hello_imgui.DockableWindow:
    panel = guarded.panel
    dock = _DOCK_NAMES.get(panel.dock, panel.dock)
    window = hello_imgui.DockableWindow(panel.title, dock, guarded.draw, is_visible_=panel.starts_open)
    window.imgui_window_flags = panel.flags
    return window


# --- notifications ---


DURATIONS_S = {"info": 4.0, "warning": 8.0, "error": 12.0}
_WIDTH, _GAP, _MOST = 380.0, 10.0, 4


class Toasts:
    """Draws the newest messages of a session until they expire or the user closes them.

    place: where they are drawn, above the picture, where no button is; None for the lower right of the window.
    """

    def __init__(self, messages: MessageLog, place: Callable[[], Rect | None] = lambda: None) -> None:
        self._messages, self._place = messages, place
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
        messages, place = self.visible(), self._place()
        self._drawn = [message.when for message in messages]
        if place is None:
            whole = imgui.get_main_viewport()
            bottom = whole.work_pos.y + whole.work_size.y - imgui.get_frame_height()
            place = whole.work_pos.x, whole.work_pos.y, whole.work_pos.x + whole.work_size.x, bottom
        left, top, right, bottom = place
        width = min(_WIDTH, right - left - 2 * _GAP)
        for number, message in enumerate(messages):
            bottom = self._draw_one(number, message, right - _GAP, bottom - _GAP, width)
            if bottom < top:
                break

    def _draw_one(self, number: int, message: Message, right: float, bottom: float, width: float) -> float:
        imgui.set_next_window_pos(imgui.ImVec2(right, bottom), imgui.Cond_.always, imgui.ImVec2(1.0, 1.0))
        imgui.set_next_window_size(imgui.ImVec2(width, 0.0))
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
        imgui.push_style_color(
            imgui.Col_.text, theme.signal_colour("accent" if message.kind == "info" else message.kind)
        )
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


def window_title(session: EditingSession, number: int = 1) -> str:
    """The name of the file, with a star before it while there is work that no file has, and from 2 on a number."""
    name = printable(session.document.title) + (f" ({number})" if number > 1 else "")
    return f"{'*' if session.has_unsaved_work else ''}{name} – holoview"


# --- menus ---


MENUS = ("File", "Edit", "Image", "Compare", "Focal plane", "Eye", "Lasers", "Speckle", "Optimise", "Rig", "Help")


def draw_menus(context: AppContext) -> None:
    """Draws all menus; commands of a group without a menu are reached by keys and the command palette."""
    for group in MENUS:
        commands = context.commands.of_group(group)
        if not commands or not imgui.begin_menu(group):
            continue
        if group == "File":
            _draw_file_menu(context, commands)
        else:
            _draw_items(context, commands)
        imgui.end_menu()
    if imgui.begin_menu("Window"):
        _draw_windows(context)
        imgui.end_menu()


def _draw_items(context: AppContext, commands: Iterable[Command]) -> None:
    for command in commands:
        keys = command.keys[0].text if command.keys else ""
        if imgui.menu_item(command.name, keys, False, command.is_enabled())[0]:
            context.attempt(command.action)
        tooltip(command.help)


def _draw_file_menu(context: AppContext, commands: Sequence[Command]) -> None:
    """Open, save, export, the rest, quit: the order of other programs."""
    saves = [command for command in commands if command.name.startswith("Save ")]
    first, last = ("Open…", "Save hologram…"), ("Quit",)
    rest = [command for command in commands if command not in saves and command.name not in first + last]
    _draw_items(context, [command for command in commands if command.name == "Open…"])
    _draw_open(context)
    imgui.separator()
    if saves:
        _draw_items(context, [command for command in saves if command.name in first])
        if imgui.begin_menu("Export"):
            _draw_items(context, [command for command in saves if command.name not in first])
            imgui.end_menu()
        imgui.separator()
    _draw_items(context, rest)
    imgui.separator()
    _draw_items(context, [command for command in commands if command.name in last])


def _draw_open(context: AppContext) -> None:
    if imgui.begin_menu("Preset"):
        for name in preset.names():
            if imgui.menu_item(name, "", name == context.session.system.name)[0]:
                context.attempt(context.loader.open, name)
        imgui.end_menu()
    recent = context.store.preferences.recent_files if context.store is not None else ()
    if imgui.begin_menu("Recent", bool(recent)):
        for number, path in enumerate(recent, start=1):
            if imgui.menu_item(label_of(f"{number} {path.name}"), "", False)[0]:
                context.attempt(context.loader.open, path)
            tooltip(printable(str(path)))
        imgui.end_menu()


def _draw_windows(context: AppContext) -> None:
    for window in hello_imgui.get_runner_params().docking_params.dockable_windows:
        clicked, visible = imgui.menu_item(window.label, "", window.is_visible)
        if clicked:
            window.is_visible = visible
    imgui.separator()
    for name in THEMES:
        if imgui.menu_item(f"{name} theme", "", context.theme == name)[0]:
            context.set_theme(name)
    if imgui.begin_menu("Text size"):
        for size in theme.TEXT_SIZES:
            if imgui.menu_item(f"{size:.0%}", "", context.text_size == size)[0]:
                context.set_text_size(size)
        imgui.end_menu()
    if imgui.menu_item("Original layout", "", False)[0]:
        _reset_layout(context)


def _reset_layout(context: AppContext) -> None:
    """Puts the panels where they were at first; those that were closed since are open again."""
    docking = hello_imgui.get_runner_params().docking_params
    open_at_first = {panel.title: panel.starts_open for panel in ALL}
    for window in docking.dockable_windows:
        window.is_visible = open_at_first.get(window.label, window.is_visible)
    docking.layout_reset = True
    context.window.wake()


def _add_menu_commands(context: AppContext, panels: Iterable[str]) -> None:
    """Adds to the palette what the menus Window and Preset have; these draw their own items, which show a state."""
    add = context.commands.add

    def open_preset(name: str) -> None:
        context.loader.open(name)

    for title in panels:
        add("Panel", f"Show {title}", partial(context.show_panel, title))
    for name in THEMES:
        add("Window", f"{name} theme", partial(context.set_theme, name))
    for size in theme.TEXT_SIZES:
        add("Window", f"Text size {size:.0%}", partial(context.set_text_size, size))
    add("Window", "Original layout", partial(_reset_layout, context))
    for name in preset.names():
        add("Preset", f"Open {name}", partial(open_preset, name))


# --- The commands that belong to no panel: undo, redo, random patterns, the still life, quit, help ---


def is_menu_open() -> bool:
    """Whether a menu, a dialog or another popup is open."""
    return imgui.is_popup_open("", imgui.PopupFlags_.any_popup)


def add_general_commands(context: AppContext) -> None:
    """Adds undo, redo, random patterns, the still life, quit and help to the commands."""
    session, add, toggle = context.session, context.commands.add, context.help_overlay.toggle

    def undo() -> None:
        _post_undone(context, "Undone", session.undo())

    def redo() -> None:
        _post_undone(context, "Done again", session.redo())

    add("Edit", "Undo", undo, "Ctrl+Z", is_enabled=lambda: session.can_undo)
    add("Edit", "Redo", redo, "Ctrl+Shift+Z Ctrl+Y", is_enabled=lambda: session.can_redo)

    def look_back() -> None:
        _post_undone(context, "As before", session.look_back())

    def look_forward() -> None:
        _post_undone(context, "As after", session.look_forward())

    before = "Comparisons, exposure, planes, regions and pages are no edits, and have steps of their own."
    add("Edit", "The look before", look_back, "Alt+Z", before, is_enabled=lambda: session.can_look_back)
    add("Edit", "The look after", look_forward, "Alt+Shift+Z", before, is_enabled=lambda: session.can_look_forward)
    others, has_patterns = "Others each time: another speckle on every modulator.", lambda: not session.system.is_field
    add("Edit", "Random patterns", lambda: _randomise(context), help=others, is_enabled=has_patterns)
    example = "The shipped hologram with its target, as at the first start."
    add("File", "Still life", lambda: show_example(session), help=example)
    if not context.is_read_only:
        help = "All is saved as it is, and offered at the next start."
        add("File", "Quit", context.window.request_close, "Ctrl+Q", help)
    add("Help", "Keys", lambda: toggle("keys"), "? F1", "Every key and what it does.")
    add("Help", "Commands", lambda: toggle("palette"), "Ctrl+P Ctrl+Shift+P", "Type what you want to do.")


def _randomise(context: AppContext) -> None:
    session = context.session
    seed, view = len(session.history), session.view_settings
    session.edit(
        "Random patterns",
        drive=random_drive(session.system, seed),
        view_settings=view.with_(exposure_stops=min(view.exposure_stops, SPECKLE_EXPOSURE_STOPS)),
        origin="random patterns",
        path=None,
    )


def _post_undone(context: AppContext, done: str, label: str | None) -> None:
    if label is not None:
        context.session.messages.post(f"{done}: {label}")


# --- The status bar: the adapter, limits of the model, durations of frames, progress of rendering and jobs ---


def draw_status(context: AppContext) -> None:
    """Draws the status bar, with details as tooltips."""
    info, renderer = context.device.info, context.side_renderers.now
    imgui.text(info.name)
    tooltip(info.label)
    if info.is_cpu:
        imgui.same_line()
        imgui.text_colored(theme.signal_colour("warning"), "software")
        tooltip("Shaders run on the processor: a GPU's driver wasn't found, or --adapter chose this one.")
    _draw_limits(context)
    parts = [f"full frame {_ms(renderer.update_s)}"] if renderer.update_s else []
    parts += [f"quick {_ms(renderer.quick_s)}"] if renderer.quick_s else []
    parts += [f"window {_ms(context.window.draw_s)}"]
    imgui.same_line(spacing=20)
    imgui.text_disabled("  ·  ".join(parts))
    tooltip("Time of the last full frame, of the last quick one, and of drawing this window (processor's part).")
    if renderer.is_busy:
        imgui.same_line(spacing=20)
        text = "quick view" if renderer.picture is not None and renderer.picture.is_quick else "computing"
        imgui.push_style_var(imgui.StyleVar_.frame_padding, imgui.ImVec2(6, 0))
        size = imgui.ImVec2(7.5 * imgui.get_font_size(), imgui.get_text_line_height() + 3)
        imgui.progress_bar(renderer.progress, size, text)
        imgui.pop_style_var()
        tooltip("A cheaper image is shown at once; the full one follows when your hand rests.")
    if context.session.save_problem:
        imgui.same_line(spacing=20)
        imgui.text_colored(theme.signal_colour("error"), "not saved")
        tooltip(f"{context.session.save_problem}. It is tried again every few seconds.")
    if context.wants_better_patterns:
        imgui.same_line(spacing=20)
        imgui.text_colored(theme.signal_colour("accent"), "Ctrl+Enter: better patterns")
        tooltip("This hologram is of a quick look: few iterations for one plane, with large pixels.")
        context.record_item_rect("better patterns")
    for job in context.session.jobs.active:
        imgui.same_line(spacing=20)
        imgui.text(f"{job.title} {job.fraction:.0%}" if job.control.total > 0 else format_job(job))


def _draw_limits(context: AppContext) -> None:
    """Says that the model isn't true of the bench, and in a tooltip in what respect."""
    limits = context.limit_notes
    notes = limits.known if imgui.is_any_item_active() else limits.notes(_seen_picture(context))  # milliseconds each
    if not notes:
        return
    imgui.same_line(spacing=20)
    text = notes[0].split(":")[0] if len(notes) == 1 else f"{len(notes)} limits of the model"
    imgui.text_colored(theme.signal_colour("warning"), text)
    context.record_item_rect("limits")
    tooltip("The picture isn't true in this respect:\n\n" + "\n\n".join(notes))


def _seen_picture(context: AppContext) -> SeenPicture | None:
    """The field that is seen and its picture, once nothing is computed any more."""
    now = context.side_renderers.now
    scene = now.full_scene
    if scene is None or not scene.system.is_field or now.is_busy:
        return None
    xyz = now.xyz()
    return None if xyz is None else (scene, xyz)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if seconds < 10 else f"{seconds:.1f} s"
