"""Where windows are at first, menus and the status bar, as HelloImGui wants them described."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from imgui_bundle import hello_imgui, imgui

from holoview.app import theme
from holoview.app.menus import draw_menus
from holoview.app.status import draw_status
from holoview.session.autosave import SessionStore

if TYPE_CHECKING:
    from holoview.app.app import App

_SPLITS = (
    ("MainDockSpace", "Left", imgui.Dir.left, 0.24),
    ("MainDockSpace", "Right", imgui.Dir.right, 0.34),
    ("Right", "Low right", imgui.Dir.down, 0.50),
    ("MainDockSpace", "Bottom", imgui.Dir.down, 0.20),
)
_NAMES = {"Centre": "MainDockSpace"}


def runner_params(app: App, store: SessionStore | None) -> hello_imgui.RunnerParams:
    """All that HelloImGui is told of the app."""
    params = hello_imgui.RunnerParams()
    params.app_window_params.window_title = "holoview"
    window = params.imgui_window_params
    window.default_imgui_window_type = hello_imgui.DefaultImGuiWindowType.provide_full_screen_dock_space
    window.show_menu_bar = window.show_status_bar = True
    window.show_menu_app = window.show_menu_view = window.show_status_fps = False
    window.remember_status_bar_settings = window.remember_theme = False
    if store is None:
        params.ini_disable = True
    else:
        store.folder.mkdir(parents=True, exist_ok=True)
        params.ini_folder_type = hello_imgui.IniFolderType.absolute_path
        params.ini_filename = str(store.folder / "layout.ini")
    params.docking_params.docking_splits = [_split(*split) for split in _SPLITS]
    params.docking_params.dockable_windows = _windows(app)
    calls = params.callbacks
    calls.default_icon_font = hello_imgui.DefaultIconFont.no_icons
    calls.load_additional_fonts = theme.load_fonts
    calls.setup_imgui_style = partial(theme.apply, app.theme)
    calls.post_init = partial(_begin, app)
    calls.pre_new_frame = lambda: None
    calls.show_menus = partial(draw_menus, app)
    calls.show_status = partial(draw_status, app)
    calls.before_imgui_render = app.after_frame
    calls.post_new_frame = app.before_frame
    return params


def _begin(app: App) -> None:
    io = imgui.get_io()
    io.config_windows_move_from_title_bar_only = True
    io.config_input_trickle_event_queue = True
    theme.apply(app.theme)


def _split(initial: str, new: str, direction: imgui.Dir, ratio: float) -> hello_imgui.DockingSplit:
    return hello_imgui.DockingSplit(initial, new, direction, ratio)


def _windows(app: App) -> list[hello_imgui.DockableWindow]:
    windows = []
    for guarded in app.panels:
        panel = guarded.panel
        dock = _NAMES.get(panel.dock, panel.dock)
        window = hello_imgui.DockableWindow(panel.title, dock, guarded.draw, is_visible_=panel.starts_open)
        window.imgui_window_flags = panel.flags
        windows.append(window)
    return windows
