"""The file that a command writes when none is named: its name comes from a bench, which may be a stranger's."""

from __future__ import annotations

from pathlib import Path

from holoview.io.hologram import system_name_of
from holoview.io.pictures import png_texts
from holoview.util.errors import UserError
from holoview.util.text import plain_name, printable


def default_output(system_name: str, target: str, suffix: str) -> Path:
    """A file in the present folder: SYSTEM.png, or SYSTEM-TARGET.safetensors.

    A file of that name is overwritten only if holoview wrote it for a bench of this name. Raises UserError otherwise.
    """
    name = plain_name(system_name, "hologram" if target else "holoview")
    path = Path(f"{name}-{plain_name(target, 'target')}{suffix}" if target else f"{name}{suffix}")
    if path.exists() and _system_name(path) != system_name:
        raise UserError(
            str(path),
            f'is there already, and holoview didn\'t write it for "{printable(system_name)}"',
            remedy="name the file to write with -o",
        )
    return path


def _system_name(path: Path) -> str | None:
    """The name of the bench for which holoview wrote a picture or hologram file; None for any other file."""
    if path.suffix == ".png":
        return png_texts(path).get("holoview.preset")
    return system_name_of(path)
