"""Writes the session's hologram and system as files."""

from __future__ import annotations

from pathlib import Path

from holoview.document.editing_session import EditingSession
from holoview.document.export.suffix import with_default_suffix
from holoview.io.hologram import Hologram
from holoview.model import preset


def save_hologram(session: EditingSession, path: Path) -> None:
    """Writes patterns and system as a hologram file, and makes it the document's path. Raises UserError."""
    document, file = session.document, with_default_suffix(path, ".safetensors")
    Hologram(document.drive, document.system).save(file)
    session.edit("Save", path=file, undoable=False)
    session.messages.post(f"hologram written to {file}")


def save_preset(session: EditingSession, path: Path) -> None:
    """Writes the system as a preset. Raises UserError."""
    file = with_default_suffix(path, ".toml")
    preset.save(session.system, file)
    session.messages.post(f"preset written to {file}")
