"""The menu bar, the commands that belong to no panel (undo, random patterns, quit, help), and the status bar."""

from __future__ import annotations

from imgui_bundle import hello_imgui, imgui

from holoview.app import theme
from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip
from holoview.app.theme import THEMES
from holoview.document.example import show_example
from holoview.model import preset
from holoview.render.view_settings import SPECKLE_EXPOSURE_STOPS
from holoview.view import random_drive

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


# --- The commands that belong to no panel: undo, redo, random patterns, the still life, quit, help ---


def add_general_commands(context: AppContext) -> None:
    """Adds undo, redo, random patterns, the still life, quit and help to the commands."""
    session, add = context.session, context.commands.add
    add(
        "Undo",
        lambda: _post_undone(context, "Undone", session.undo()),
        "Edit",
        "Ctrl+Z",
        is_enabled=lambda: session.can_undo,
    )
    add(
        "Redo",
        lambda: _post_undone(context, "Done again", session.redo()),
        "Edit",
        "Ctrl+Shift+Z Ctrl+Y",
        is_enabled=lambda: session.can_redo,
    )
    add(
        "Random patterns",
        lambda: _randomise(context),
        "Edit",
        help="Others each time: another speckle on every modulator.",
        is_enabled=lambda: not session.system.is_field,
    )
    add(
        "Still life",
        lambda: show_example(session),
        "File",
        help="The shipped hologram with its target, as at the first start.",
    )
    if not context.is_read_only:
        help = "All is saved as it is, and offered at the next start."
        add("Quit", context.window.request_close, "File", "Ctrl+Q", help)
    add("Keys", lambda: context.help_overlay.toggle("keys"), "Help", "? F1", "Every key and what it does.")
    add(
        "Commands",
        lambda: context.help_overlay.toggle("palette"),
        "Help",
        "Ctrl+P Ctrl+Shift+P",
        "Type what you want to do.",
    )


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
        imgui.text_colored(theme.WARNING, "software")
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
        imgui.progress_bar(renderer.progress, imgui.ImVec2(110, imgui.get_text_line_height()), text)
        imgui.pop_style_var()
        tooltip("A cheaper image is shown at once; the full one follows when your hand rests.")
    if context.session.save_problem:
        imgui.same_line(spacing=20)
        imgui.text_colored(theme.ERROR, "not saved")
        tooltip(f"{context.session.save_problem}. It is tried again every few seconds.")
    for job in context.session.jobs.active:
        imgui.same_line(spacing=20)
        imgui.text(f"{job.title} {job.fraction:.0%}")


def _draw_limits(context: AppContext) -> None:
    """Says that the model isn't true of the bench, and in a tooltip in what respect."""
    limits = context.limit_notes
    notes = limits.known if imgui.is_any_item_active() else limits.notes()  # milliseconds for each new bench
    if not notes:
        return
    imgui.same_line(spacing=20)
    text = notes[0].split(":")[0] if len(notes) == 1 else f"{len(notes)} limits of the model"
    imgui.text_colored(theme.WARNING, text)
    context.record_item_rect("limits")
    tooltip("The picture isn't true in this respect:\n\n" + "\n\n".join(notes))


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if seconds < 10 else f"{seconds:.1f} s"
