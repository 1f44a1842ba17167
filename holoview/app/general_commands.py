"""The commands that belong to no panel: files, undo, help."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.view import random_drive

if TYPE_CHECKING:
    from holoview.app.app import App


def add_general_commands(app: App) -> None:
    """Adds them to the app's commands."""
    session, add = app.session, app.commands.add
    add(
        "Undo",
        lambda: _post_undone(app, "Undone", session.undo()),
        "Edit",
        "Ctrl+Z",
        is_possible=lambda: session.can_undo,
    )
    add(
        "Redo",
        lambda: _post_undone(app, "Done again", session.redo()),
        "Edit",
        "Ctrl+Shift+Z Ctrl+Y",
        is_possible=lambda: session.can_redo,
    )
    add(
        "Random patterns", lambda: _randomise(app), "Edit", help="Others each time: another speckle on every modulator."
    )
    add("Quit", app.quit, "File", "Ctrl+Q", "All is saved as it is, and offered at the next start.")
    add("Keys", lambda: app.help_overlay.toggle("keys"), "Help", "? F1", "Every key and what it does.")
    add(
        "Commands",
        lambda: app.help_overlay.toggle("palette"),
        "Help",
        "Ctrl+P Ctrl+Shift+P",
        "Type what you want to do.",
    )


def _randomise(app: App) -> None:
    session = app.session
    seed = len(session.history)
    session.edit("Random patterns", drive=random_drive(session.system, seed), origin="random patterns", path=None)


def _post_undone(app: App, done: str, label: str | None) -> None:
    if label is not None:
        app.session.messages.post(f"{done}: {label}")
