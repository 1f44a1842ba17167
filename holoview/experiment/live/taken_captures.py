"""The captures that were taken at the viewer's rig: each on the disk at once, all together as one capture file."""

from __future__ import annotations

import shutil
from pathlib import Path

from holoview.captures.capture_file import write_captures
from holoview.captures.dataset import Captures, join_captures
from holoview.captures.validation import check_settings
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder


class TakenCaptures:
    """Captures of one rig in the order in which they were taken.

    folder: where single captures are written, one file each; None writes none. Those of a plan are in its own store.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self._all: list[Captures] = []
        self._written = 0

    def __len__(self) -> int:
        return len(self._all)

    @property
    def all(self) -> tuple[Captures, ...]:
        """Each a session of one capture."""
        return tuple(self._all)

    def write(self, capture: Captures) -> None:
        """Writes a single capture into the folder, which is made for the first one. Raises WriteError."""
        if self.folder is None:
            return
        make_folder(self.folder)
        write_captures(self.folder / f"{self._written:05d}.h5", capture, check_settings)
        self._written += 1

    def add(self, capture: Captures) -> None:
        """Adds a capture that is on the disk."""
        self._all.append(capture)

    def clear(self) -> None:
        """Forgets all; their files stay."""
        self._all = []

    def save(self, path: Path) -> None:
        """Writes all as one capture file, and removes the folder of single ones. Raises UserError."""
        if not self._all:
            raise UserError("captures", "there are none yet", remedy="take a capture or run a plan")
        write_captures(path, join_captures(self._all))
        if self.folder is not None and self.folder.exists():
            shutil.rmtree(self.folder)
