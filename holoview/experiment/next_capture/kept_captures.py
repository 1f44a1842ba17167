"""The captures of a closed loop on the disk: each at once, beside the file that they will be."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

from holoview.captures.capture_file import read_captures, write_captures
from holoview.captures.dataset import Captures, join_captures
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.util.files import read_text
from holoview.util.tables import parse_json_table

_STATE = "loop.json"
_EXPECTED = "the state of a closed loop"


class KeptCaptures:
    """Captures of one loop, in a folder until the loop ends. output: the capture file; None keeps none of them.

    rig_text: the rig's description; captures of another one aren't gone on with.
    folder: where each capture is until the loop ends; None without an output.
    """

    def __init__(self, output: Path | None, rig_text: str) -> None:
        self.output = output
        self.folder = None if output is None else output.with_name(f"{output.name}.captures")
        self._fingerprint = hashlib.sha256(rig_text.encode()).hexdigest()

    def open(self) -> list[Captures]:
        """The captures of a loop that was interrupted before its end; none of a loop that begins.

        Raises UserError where the folder holds something else.
        """
        if self.folder is None:
            return []
        state = self.folder / _STATE
        if not state.exists():
            make_folder(self.folder)
            write_file(state, json.dumps({"fingerprint": self._fingerprint}))
        elif (
            parse_json_table(read_text(state, _EXPECTED), str(state), _EXPECTED).get("fingerprint") != self._fingerprint
        ):
            remedy = "choose another output, or remove the folder if it isn't wanted"
            raise UserError(str(self.folder), "holds captures of another rig, or of a plan", remedy=remedy)
        return [read_captures(file) for file in sorted(self.folder.glob("[0-9]*.h5"))]

    def add(self, number: int, capture: Captures) -> None:
        """Writes one capture, a session of one."""
        if self.folder is not None:
            write_captures(self.folder / f"{number:05d}.h5", capture)

    def finish(self, parts: list[Captures]) -> None:
        """Writes the capture file, then removes the folder."""
        if self.output is None or self.folder is None or not parts:
            return
        write_captures(self.output, join_captures(parts))
        shutil.rmtree(self.folder)


def _fingerprint_of(state: Path) -> Any:
    return parse_json_table(read_text(state, _EXPECTED), str(state), _EXPECTED).get("fingerprint")
