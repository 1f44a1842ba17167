"""A folder of captures beside the capture file that they will be, and the record of the bench that goes with them.

CaptureFolder    captures one by one; at the end all together as one capture file
CaptureStore     the captures of a plan: which are missing, and the record of the bench beside them
BenchRecord      dark frames, settling and notes; in a capture file, readers of captures ignore them

Each capture is a capture file of its own, written whole or not at all. However the program ends, at most the capture in
flight is lost, and everything that reads capture files can read the others.
"""

from __future__ import annotations

import hashlib
import io
import json
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from holoview.bench.captures.capture_file import (
    DatasetReader,
    open_plain_hdf5,
    plain_child,
    read_attribute,
    read_captures,
    write_captures,
)
from holoview.bench.captures.dataset import Captures, join_captures
from holoview.bench.captures.validation import check_captures, check_settings
from holoview.bench.rig.camera_pictures import DarkFrame, SettlingTime
from holoview.bench.rig.capture_plan import CapturePlan
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.util.files import read_text
from holoview.util.memory_limit import require_memory
from holoview.util.tables import ArraySchema, parse_json_table

_RECORD = "bench.h5"
_DARK = (
    ArraySchema("dark/images", ("float32",), ("dark frame", "camera row", "camera column")),
    ArraySchema("dark/exposure", ("float64",), ("dark frame",)),
    ArraySchema("dark/noise", ("float64",), ("dark frame",)),
    ArraySchema("dark/pictures", ("int64",), ("dark frame",)),
)
_SETTLING = ("constant", "deviation", "wait")


class CaptureFolder:
    """Captures in a folder, numbered from 0, until they become one capture file.

    folder: is made for the first capture. state: name of the file in it that says which captures belong there, "" for
    none. contents: a text on which these depend. others: captures of other contents, in words.
    check: raises UserError for a capture that mustn't be written or read.
    """

    def __init__(
        self,
        folder: Path,
        state: str = "",
        contents: str = "",
        others: str = "",
        check: Callable[[Captures], object] = check_settings,
    ) -> None:
        self.folder, self._others, self._check = folder, others, check
        self._state = folder / state if state else None
        self._fingerprint = hashlib.sha256(contents.encode()).hexdigest()
        self._finished = folder.with_suffix(".finished")

    @property
    def is_begun(self) -> bool:
        """Whether captures of these contents were begun here. Raises UserError for a folder of others."""
        if self._state is None or not self._state.exists():
            return False
        expected = f"the state of {self._others}"
        state = parse_json_table(read_text(self._state, expected), str(self._state), expected)
        if state.get("fingerprint") != self._fingerprint:
            remedy = "choose another output, or remove the folder if it isn't wanted"
            raise UserError(str(self.folder), f"holds {self._others}", remedy=remedy)
        return True

    def begin(self) -> None:
        """Makes the folder with its state, or goes on with an existing folder."""
        self._remove_finished()
        if not self.folder.exists():
            make_folder(self.folder)
        if self._state is not None and not self._state.exists():
            write_file(self._state, json.dumps({"fingerprint": self._fingerprint}))

    def resume(self) -> list[Captures]:
        """All captures that are there, and begins the folder if there are none. Raises UserError as `is_begun` does."""
        if not self.is_begun:
            self.begin()
        return [self.read(number) for number in self.numbers]

    @property
    def numbers(self) -> list[int]:
        """Numbers of the captures that are there, damaged ones too, ascending."""
        return sorted(int(file.stem) for file in self.folder.glob(f"{'[0-9]' * 5}.h5"))

    def write(self, number: int, capture: Captures) -> None:
        """Writes one capture. Raises WriteError."""
        write_captures(self._file(number), capture, self._check)

    def read(self, number: int) -> Captures:
        """One capture. Raises UserError for a damaged one."""
        return read_captures(self._file(number), self._check)

    def join_into(
        self, output: Path, captures: Iterable[Captures], extend: Callable[[h5py.File], object] = lambda _: None
    ) -> Captures:
        """Writes the captures into one file, and removes the folder; returns them joined. Raises UserError."""
        joined = join_captures(list(captures))
        write_captures(output, joined, extend=extend)
        if self.folder.exists():
            self.folder.rename(self._finished)  # at once, so that nothing goes on with a folder half removed
            shutil.rmtree(self._finished)
        return joined

    def _remove_finished(self) -> None:
        """Removes the rest of a folder whose program was killed while it removed the folder."""
        shutil.rmtree(self._finished, ignore_errors=True)

    def _file(self, number: int) -> Path:
        return self.folder / f"{number:05d}.h5"


def folder_beside(output: Path) -> Path:
    """The folder for the captures of a capture file."""
    return output.with_name(f"{output.name}.captures")


def loop_captures(output: Path, rig_text: str) -> CaptureFolder:
    """The captures of a closed loop. rig_text: the rig's description; captures of another rig are refused."""
    others = "captures of another rig, or of a plan"
    return CaptureFolder(folder_beside(output), "loop.json", rig_text, others, check_captures)


class CaptureStore(CaptureFolder):
    """The captures of a plan. output: the capture file that they will be. rig_text: the description of the rig.

    record: the measurements of the bench beside them. on_capture: called with each capture once it is written.
    """

    def __init__(
        self, output: Path, plan: CapturePlan, rig_text: str, on_capture: Callable[[Captures], None] = lambda _: None
    ) -> None:
        others = "captures of another plan or rig"
        super().__init__(folder_beside(output), "session.json", repr(plan.requests) + rig_text, others)
        self.output, self._on_capture = output, on_capture
        self._record_file = self.folder / _RECORD
        self._count, self._exposures = len(plan.requests), dict[int, float]()
        self.record = BenchRecord()

    def inspect(self) -> list[int]:
        """Looks for captures, and changes nothing; returns the numbers of damaged captures, which count as missing.

        Raises UserError for a folder of another plan or rig, and for an output that is there already.
        """
        if not self.is_begun:
            if self.output.exists():
                remedy = "choose another output, or remove the file if it isn't wanted"
                raise UserError(str(self.output), "is there already", remedy=remedy)
            return []
        if self._record_file.exists():
            self.record = read_bench_record(self._record_file)
        written = [k for k in self.numbers if k < self._count]
        self._exposures = {k: exposure_s for k in written if (exposure_s := self._exposure(k)) is not None}
        return [k for k in written if k not in self._exposures]

    def open(self) -> list[int]:
        """As `inspect`; then makes the folder if it isn't there."""
        self._remove_finished()
        damaged = self.inspect()
        self.begin()
        return damaged

    def keep(self, record: BenchRecord) -> None:
        """Writes the record of the bench beside the captures."""
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
        """How many captures are on the disk, with a capture that was written while an interruption came."""
        return sum(k < self._count for k in self.numbers)

    def add(self, number: int, capture: Captures) -> None:
        """Writes one capture."""
        self.write(number, capture)
        self._exposures[number] = float(capture.exposure_s[0])
        self._on_capture(capture)

    def finish(self) -> Captures:
        """Writes the capture file in the order of the plan, then removes the folder; returns the captures.

        Raises UserError if there is none.
        """
        if not self._exposures:
            raise UserError(str(self.folder), "holds no capture yet")
        return self.join_into(self.output, map(self.read, sorted(self._exposures)), self.record.write_into)

    def _exposure(self, number: int) -> float | None:
        """The exposure time of a capture, None for a damaged one."""
        try:
            return float(self.read(number).exposure_s[0])
        except UserError:
            return None


@dataclass(frozen=True)
class BenchRecord:
    """dark: dark frames. settling: of the modulators that were measured, by their tables in rig.toml."""

    dark: tuple[DarkFrame, ...] = ()
    settling: Mapping[str, SettlingTime] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def write_into(self, h5: h5py.File) -> None:
        """Adds the groups `dark` and `settling` and the attribute `notes` to a file."""
        if self.notes:
            h5.attrs["notes"] = list(self.notes)
        if self.dark:
            group = h5.create_group("dark")
            images = np.stack([frame.mean for frame in self.dark])
            group.create_dataset("images", data=images, compression="gzip", compression_opts=4)
            group.create_dataset("exposure", data=np.array([frame.exposure_s for frame in self.dark]))
            group.create_dataset("noise", data=np.array([frame.noise for frame in self.dark]))
            group.create_dataset("pictures", data=np.array([frame.pictures for frame in self.dark], np.int64))
        for name, found in self.settling.items():
            values = (found.constant_s, found.deviation_s, found.wait_s)
            h5.create_group(f"settling/{name}").attrs.update(dict(zip(_SETTLING, values, strict=True)))

    def write(self, path: Path) -> None:
        """Writes a file of the record alone, whole or not at all. Raises WriteError."""
        buffer = io.BytesIO()
        with h5py.File(buffer, "w") as h5:
            self.write_into(h5)
        write_file(path, buffer.getbuffer())


def read_bench_record(path: Path) -> BenchRecord:
    """The record of a capture file, or of a file of its own; missing parts are empty.

    Raises UserError for a file that is damaged, isn't HDF5, or holds something else in its place.
    """
    with open_plain_hdf5(path, "what was measured of a bench (HDF5)", "remove it; it is measured again") as h5:
        notes, group = read_attribute(h5, "notes"), plain_child(h5, "settling")
        names = tuple(group) if isinstance(group, h5py.Group) else ()
        return BenchRecord(
            dark=_read_dark(h5),
            settling={name: found for name in names if (found := _read_settling(h5, name)) is not None},
            notes=() if notes is None else tuple(str(note) for note in np.atleast_1d(notes)),
        )


def _read_dark(h5: h5py.File) -> tuple[DarkFrame, ...]:
    if plain_child(h5, "dark") is None:
        return ()
    sizes: dict[str, int] = {}
    readers = [DatasetReader(h5, schema, sizes) for schema in _DARK]
    require_memory("dark frames", 2 * sum(reader.size_bytes for reader in readers))
    images, exposures, noises, pictures = (reader.read() for reader in readers)
    rows = zip(images, exposures, noises, pictures, strict=True)
    return tuple(DarkFrame(float(s), image, float(noise), int(count)) for image, s, noise, count in rows)


def _read_settling(h5: h5py.File, name: str) -> SettlingTime | None:
    group = plain_child(h5, f"settling/{name}")
    if group is None:
        return None
    constant, deviation, wait = (float(read_attribute(group, key)) for key in _SETTLING)
    return SettlingTime(constant, deviation, wait)
