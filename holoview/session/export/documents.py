"""The session's hologram and its bench as files."""

from __future__ import annotations

from pathlib import Path

from holoview import preset
from holoview.hologram import Hologram
from holoview.session.session import Session


def save_hologram(session: Session, path: Path) -> None:
    """Writes patterns and bench as a hologram file, which the session then is a view of. Raises UserError."""
    state = session.state
    Hologram(state.drive, state.system).save(with_suffix(path, ".safetensors"))
    session.edit("Save", path=with_suffix(path, ".safetensors"), undoable=False)


def save_preset(session: Session, path: Path) -> None:
    """Writes the bench as a preset in people's units. Raises UserError."""
    preset.save(session.system, with_suffix(path, ".toml"))


def with_suffix(path: Path, suffix: str) -> Path:
    """The path with a suffix, where people left it out."""
    return path if path.suffix else path.with_suffix(suffix)
