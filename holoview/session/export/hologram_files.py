"""The session's hologram and its bench as files."""

from __future__ import annotations

from pathlib import Path

from holoview.io.hologram import Hologram
from holoview.model import preset
from holoview.session.editing_session import EditingSession


def save_hologram(session: EditingSession, path: Path) -> None:
    """Writes patterns and bench as a hologram file, which the session then is a view of. Raises UserError."""
    state, file = session.document, with_default_suffix(path, ".safetensors")
    Hologram(state.drive, state.system).save(file)
    session.edit("Save", path=file, undoable=False)
    session.messages.post(f"hologram written to {file}")


def save_preset(session: EditingSession, path: Path) -> None:
    """Writes the bench as a preset in people's units. Raises UserError."""
    file = with_default_suffix(path, ".toml")
    preset.save(session.system, file)
    session.messages.post(f"preset written to {file}")


def with_default_suffix(path: Path, suffix: str) -> Path:
    """The path with a suffix, where people left it out."""
    return path if path.suffix else path.with_suffix(suffix)
