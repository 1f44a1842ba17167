"""Opens HDF5 files that hold all of their data themselves, and reads their datasets within the memory that is allowed.

HDF5 can store data in other files (external storage, virtual datasets) and lead to other files and places (external and
soft links): a file from a stranger could make a reader read any file of its user. Such files are refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.file_schema import ArraySchema
from holoview.util.input_file import require_file
from holoview.util.memory_limit import format_size

_MOST_ATTRIBUTE_BYTES = 1 << 16
_MOST_RATIO, _FREE_BYTES = 2000, 64 << 20
"""Size of data over that of their file, beyond the free bytes: deflate's limit is 1032 for each filter in a chain."""


@contextmanager
def open_plain_hdf5(path: Path, expected: str, remedy: str) -> Iterator[h5py.File]:
    """A file that is open to be read; use `plain_child`, `read_attribute` and `DatasetReader` on it.

    expected, remedy: for the error. Raises UserError for what isn't a regular file, isn't HDF5, or is cut short; in the
    block, HDF5's errors become a UserError that says that the file is damaged.
    """
    require_file(path, expected)
    try:
        h5 = h5py.File(path, "r")
    except (OSError, RuntimeError, ValueError) as error:
        truncated = "truncated" in str(error)
        found = "is cut short: it ends before its data do" if truncated else "isn't an HDF5 file"
        raise UserError(str(path), found, expected=expected, remedy="copy it again" if truncated else remedy) from error
    with h5:
        try:
            yield h5
        except UserError as error:
            raise error.inside(f"{path}: ") from error
        except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
            reason = " ".join(str(error).split())
            raise UserError(str(path), f"is damaged: {reason}", remedy="copy or write the file again") from error


def plain_child(h5: h5py.File, name: str) -> h5py.Group | h5py.Dataset | None:
    """The group or dataset of a path such as "slm1/levels", None where there is none.

    Raises UserError where a link on the way isn't a hard one.
    """
    found: Any = h5
    for part in name.split("/"):
        link = found.get(part, getlink=True) if isinstance(found, h5py.Group) else None
        if link is None:
            return None
        if not isinstance(link, h5py.HardLink):
            kind = "an external" if isinstance(link, h5py.ExternalLink) else "a soft"
            raise UserError(name, f"is {kind} link", expected="the data themselves", remedy=_COPY)
        found = found.get(part)
    return found


_COPY = "copy them into the file"


def read_attribute(holder: h5py.Group | h5py.Dataset, name: str) -> Any:
    """The value of an attribute, None where there is none. Raises UserError for a large one."""
    if name not in holder.attrs:
        return None
    if holder.attrs.get_id(name).get_storage_size() > _MOST_ATTRIBUTE_BYTES:
        expected = f"at most {_MOST_ATTRIBUTE_BYTES >> 10} KiB"
        raise UserError(f"attribute {name}", "is larger than any that is known", expected=expected)
    return holder.attrs[name]


class DatasetReader:
    """A dataset that is checked against its schema before it is read.

    Raises UserError when it is missing, isn't what the schema says, or has its data elsewhere.

    sizes: what is known of the sizes that the schemas name; those that this one tells are added.
    """

    def __init__(self, h5: h5py.File, schema: ArraySchema, sizes: dict[str, int]) -> None:
        self.name, self._schema = schema.name, schema
        dataset = plain_child(h5, schema.name)
        if not isinstance(dataset, h5py.Dataset):
            raise UserError(schema.name, "is missing", expected="a dataset of this name")
        if dataset.is_virtual or dataset.external:
            raise UserError(schema.name, "has its data in other files", expected="the data themselves", remedy=_COPY)
        self._dataset = dataset
        self.dtype: np.dtype[Any] = dataset.dtype
        self.shape: tuple[int, ...] = dataset.shape or ()
        schema.check_header(dataset.dtype.newbyteorder("=").name, self.shape, sizes)
        if 0 in self.shape:
            raise UserError(schema.name, f"an array of shape {self.shape}", expected="at least one number")
        self._check_ratio(Path(h5.filename).stat().st_size)

    @property
    def size_bytes(self) -> int:
        """Memory that all of its numbers take."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def chunk_bytes(self) -> int:
        """Memory that HDF5 takes to decompress a part."""
        return math.prod(self._dataset.chunks or (0,)) * self.dtype.itemsize

    def read(self) -> NDArray[Any]:
        """All numbers. Raises UserError for numbers that the schema doesn't allow."""
        values = np.asarray(self._dataset[()])
        self._schema.check_values(values)
        return values

    def read_into(self, array: NDArray[Any]) -> None:
        """Reads into an array of the same shape, some chunks of the file at a time."""
        count = (self._dataset.chunks or (1,))[0]
        for first in range(0, self.shape[0], count):
            array[first : first + count] = self._dataset[first : first + count]

    def _check_ratio(self, file_bytes: int) -> None:
        if max(self.size_bytes, self.chunk_bytes) > _FREE_BYTES + _MOST_RATIO * file_bytes:
            found = f"{format_size(self.size_bytes)} of data in a file of {format_size(file_bytes)}"
            raise UserError(self.name, found, expected="what was measured", remedy="write the file again")
