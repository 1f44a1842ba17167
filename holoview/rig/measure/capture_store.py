"""Captures one by one in a folder beside the session's file, and the whole session as one capture file.

Each capture is a capture file of its own, written whole or not at all. So whatever ends a session, at most the capture
in flight is lost, and what is there can be read by everything that reads capture files.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

from holoview.captures.capture_file import read_captures, write_captures
from holoview.captures.dataset import Captures, join_captures
from holoview.captures.validation import check_settings
from holoview.rig.measure.bench_record import BenchRecord, read_bench_record
from holoview.rig.measure.capture_plan import CapturePlan
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.util.files import read_text
from holoview.util.tables import parse_json_table

_SESSION, _RECORD = "session.json", "bench.h5"
_EXPECTED = "the state of a measurement session"


class CaptureStore:
    """The captures of one session. output: the capture file that they will be.

    record: what has been found out of the bench beside them.
    """

    def __init__(self, output: Path, plan: CapturePlan, rig_text: str) -> None:
        self.output, self.folder = output, output.with_name(f"{output.name}.captures")
        self._finished = output.with_name(f"{output.name}.finished")
        self._record_file = self.folder / _RECORD
        self._count, self._exposures = len(plan.requests), dict[int, float]()
        self.record = BenchRecord()
        self._fingerprint = hashlib.sha256((repr(plan.requests) + rig_text).encode()).hexdigest()

    def inspect(self) -> list[int]:
        """Finds out what is there, and changes nothing; returns damaged captures, which are missing.

        Raises UserError for a folder of another plan or rig, and for an output that is there already.
        """
        file = self.folder / _SESSION
        if not file.exists():
            if self.output.exists():
                remedy = "choose another output, or remove the file if it isn't wanted"
                raise UserError(str(self.output), "is there already", remedy=remedy)
            return []
        if parse_json_table(read_text(file, _EXPECTED), str(file), _EXPECTED).get("fingerprint") != self._fingerprint:
            remedy = "choose another output, or remove the folder if it isn't wanted"
            raise UserError(str(self.folder), "holds captures of another plan or rig", remedy=remedy)
        if self._record_file.exists():
            self.record = read_bench_record(self._record_file)
        written = [k for k in range(self._count) if self._file(k).exists()]
        self._exposures = {k: exposure_s for k in written if (exposure_s := self._exposure(k)) is not None}
        return [k for k in written if k not in self._exposures]

    def open(self) -> list[int]:
        """As `inspect`, then makes the folder if it isn't there."""
        shutil.rmtree(self._finished, ignore_errors=True)  # of a program that was killed while it removed it
        damaged = self.inspect()
        if not self.folder.exists():
            make_folder(self.folder)
        if not (self.folder / _SESSION).exists():
            write_file(self.folder / _SESSION, json.dumps({"fingerprint": self._fingerprint}))
        return damaged

    def keep(self, record: BenchRecord) -> None:
        """Writes what has been found out of the bench beside the captures."""
        record.write(self._record_file)
        self.record = record

    @property
    def exposures_s(self) -> list[float]:
        """Exposure times of the captures that are there."""
        return list(self._exposures.values())

    @property
    def missing(self) -> list[int]:
        """Numbers of the captures that aren't on the disk, ascending."""
        return [k for k in range(self._count) if k not in self._exposures]

    @property
    def written(self) -> int:
        """How many captures are on the disk, also one that was written while an interruption came."""
        return sum(self._file(k).exists() for k in range(self._count))

    def add(self, number: int, capture: Captures) -> None:
        """Writes one capture, a session of one."""
        write_captures(self._file(number), capture, check_settings)
        self._exposures[number] = float(capture.exposure_s[0])

    def join(self) -> Captures:
        """All captures that are there, in the order of the plan, as one session. Raises UserError if there is none."""
        if not self._exposures:
            raise UserError(str(self.folder), "holds no capture yet")
        return join_captures([self._read(k) for k in sorted(self._exposures)])

    def finish(self) -> Captures:
        """Writes the session's file, then removes the folder; returns the session."""
        captures = self.join()
        write_captures(self.output, captures, extend=self.record.write_into)
        self.folder.rename(self._finished)  # at once, so that no session goes on with a folder half removed
        shutil.rmtree(self._finished)
        return captures

    def _exposure(self, number: int) -> float | None:
        """The exposure time of a capture, None for a damaged one."""
        try:
            return float(self._read(number).exposure_s[0])
        except UserError:
            return None

    def _read(self, number: int) -> Captures:
        return read_captures(self._file(number), check_settings)

    def _file(self, number: int) -> Path:
        return self.folder / f"{number:05d}.h5"
