"""What a session has found out of its bench beside the captures: dark frames, settling, notes.

It stands in the capture file, where what reads captures ignores it, and in the session's folder until then.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from holoview.captures.capture_file import DatasetReader, open_plain_hdf5, plain_child, read_attribute
from holoview.rig.measure.dark_frames import DarkFrame
from holoview.rig.measure.settling import Settling
from holoview.util.file_schema import ArraySchema
from holoview.util.file_writer import write_file
from holoview.util.memory import require_memory

_DARK = (
    ArraySchema("dark/images", ("float32",), ("dark frame", "camera row", "camera column")),
    ArraySchema("dark/exposure", ("float64",), ("dark frame",)),
    ArraySchema("dark/noise", ("float64",), ("dark frame",)),
    ArraySchema("dark/pictures", ("int64",), ("dark frame",)),
)
_SETTLING = ("constant", "deviation", "wait")
_MODULATORS = ("slm1", "slm2")


@dataclass(frozen=True)
class BenchRecord:
    """dark: dark frames. settling: of the modulators that were measured, by their tables in rig.toml."""

    dark: tuple[DarkFrame, ...] = ()
    settling: Mapping[str, Settling] = field(default_factory=dict)
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
    """The record of a capture file, or of a file of its own; what isn't there is empty.

    Raises UserError for a file that is damaged, isn't HDF5, or holds something else in its place.
    """
    with open_plain_hdf5(path, "what was measured of a bench (HDF5)", "remove it; it is measured again") as h5:
        notes = read_attribute(h5, "notes")
        return BenchRecord(
            dark=_read_dark(h5),
            settling={name: found for name in _MODULATORS if (found := _read_settling(h5, name)) is not None},
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


def _read_settling(h5: h5py.File, name: str) -> Settling | None:
    group = plain_child(h5, f"settling/{name}")
    if group is None:
        return None
    constant, deviation, wait = (float(read_attribute(group, key)) for key in _SETTLING)
    return Settling(constant, deviation, wait)
