"""The initial arrangement of windows, and the settings of HelloImGui."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from imgui_bundle import hello_imgui, imgui

from holoview.app import theme
from holoview.app.panel import GuardedPanel

_SPLITS = (
    ("MainDockSpace", "Left", imgui.Dir.left, 0.26),
    ("MainDockSpace", "Right", imgui.Dir.right, 0.34),
    ("Right", "Low right", imgui.Dir.down, 0.50),
    ("MainDockSpace", "Bottom", imgui.Dir.down, 0.20),
)
"""Docks: the one that is split, the new one, where it lies, and its share of the space."""
_DOCK_NAMES = {"Centre": "MainDockSpace"}


@dataclass(frozen=True)
class LayoutCallbacks:
    """What HelloImGui calls: once to apply the theme, then in each frame for menus, status bar, and around panels."""

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
