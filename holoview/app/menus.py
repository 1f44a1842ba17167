"""The menu bar, with one menu for each group of commands."""

from __future__ import annotations

from imgui_bundle import hello_imgui, imgui

from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip
from holoview.app.theme import THEMES
from holoview.model import preset

MENUS = ("File", "Edit", "Image", "Compare", "Focal plane", "Eye", "Lasers", "Speckle", "Optimise", "Rig", "Help")


def draw_menus(context: AppContext) -> None:
    """Draws all menus; commands of a group without a menu are reached by keys and the command palette."""
    for group in MENUS:
        commands = context.commands.of_group(group)
        if not commands or not imgui.begin_menu(group):
            continue
        if group == "File":
            _draw_open(context)
        for command in commands:
            keys = command.keys[0].text if command.keys else ""
            if imgui.menu_item(command.name, keys, False, command.is_enabled())[0]:
                context.attempt(command.action)
            tooltip(command.help)
        imgui.end_menu()
    if imgui.begin_menu("Window"):
        _draw_windows(context)
        imgui.end_menu()


def _draw_open(context: AppContext) -> None:
    if imgui.begin_menu("Preset"):
        for name in preset.names():
            if imgui.menu_item(name, "", name == context.session.system.name)[0]:
                context.attempt(context.loader.open, name)
        imgui.end_menu()
    recent = context.store.preferences.recent_files if context.store is not None else ()
    if imgui.begin_menu("Recent", bool(recent)):
        for number, path in enumerate(recent, start=1):
            if imgui.menu_item(f"{number} {path.name}", "", False)[0]:
                context.attempt(context.loader.open, path)
            tooltip(str(path))
        imgui.end_menu()
    imgui.separator()


def _draw_windows(context: AppContext) -> None:
    for window in hello_imgui.get_runner_params().docking_params.dockable_windows:
        clicked, visible = imgui.menu_item(window.label, "", window.is_visible)
        if clicked:
            window.is_visible = visible
    imgui.separator()
    for name in THEMES:
        if imgui.menu_item(f"{name} theme", "", context.theme == name)[0]:
            context.set_theme(name)
    if imgui.menu_item("Original layout", "", False)[0]:
        hello_imgui.get_runner_params().docking_params.layout_reset = True
