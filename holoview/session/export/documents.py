"""The session's hologram and its bench as files."""

from __future__ import annotations

from pathlib import Path

from holoview import preset
from holoview.hologram import Hologram
from holoview.session.session import Session


def save_hologram(session: Session, path: Path) -> None:
    """Writes patterns and bench as a hologram file, which the session then is a view of. Raises UserError."""
    state, file = session.state, with_suffix(path, ".safetensors")
    Hologram(state.drive, state.system).save(file)
    session.edit("Save", path=file, undoable=False)
    session.messages.post(f"hologram written to {file}")


def save_preset(session: Session, path: Path) -> None:
    """Writes the bench as a preset in people's units. Raises UserError."""
    file = with_suffix(path, ".toml")
    preset.save(session.system, file)
    session.messages.post(f"preset written to {file}")


def with_suffix(path: Path, suffix: str) -> Path:
    """The path with a suffix, where people left it out."""
    return path if path.suffix else path.with_suffix(suffix)
