"""The commands that belong to no panel: undo, redo, random patterns, the still life, quit, help."""

from __future__ import annotations

from holoview.app.context import AppContext
from holoview.document.example import show_example
from holoview.render.view_settings import SPECKLE_EXPOSURE_STOPS
from holoview.view import random_drive


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
