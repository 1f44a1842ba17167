"""HDF5 files, MATLAB's of version 7.3 among them, whose arrays stand with their axes in reverse.

Complex numbers are pairs with names such as `real` and `imag`. Of a picture whose axes have coordinates (dimension
scales, as netCDF and xarray write them) their equal steps are its pitch. Nothing outside the file is followed: external
links, external storage and virtual datasets are refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, StoredArray, Window
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.memory_limit import format_size, require_memory

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_PLACES = (0, 512, 1024, 2048)  # of the signature: files may begin with other text
_MATLAB_PRIVATE = ("#refs#", "#subsystem#")
_MOST_LETTERS = 200  # of a text that is looked at
_MOST_DEPTH = 8
_MOST_OBJECTS = 2000
_MOST_ATTRIBUTES, _MOST_ATTRIBUTE_BYTES = 100, 1 << 16
_FEW_CHUNKS, _SMALL_CHUNK_BYTES = 20_000, 1024  # more chunks than these are larger: each is looked up by itself
_MOST_COORDINATES, _EVEN = 1 << 20, 1e-3  # of an axis; unevenness of its steps
_END_OF_YAML = "\n...\n"
_MOST_RATIO, _FREE_BYTES = 2000, 64 << 20
"""Size of data over that of their file, beyond the free bytes: deflate's limit is 1032 for each filter in a chain."""


class Hdf5Reader:
    """Datasets of an HDF5 file by their paths with dots; small attributes are numbers."""

    name = "HDF5"
    suffixes = (".h5", ".hdf5", ".he5", ".nc", ".mat")

    def recognises(self, head: bytes) -> bool:
        """Whether the signature stands at one of its places."""
        return any(head[place : place + 8] == _SIGNATURE for place in _PLACES)

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The arrays; a window is read from the disk when it is loaded."""
        with path.open("rb") as head:
            is_matlab = head.read(6) == b"MATLAB"
        with h5py.File(path, "r") as file:
            found = _Found(path, is_matlab)
            found.group(file, "", 0)
            if not found.arrays and found.notes:
                raise UserError(str(path), found.notes[0], expected="an array of numbers")
            yield Contents.of(found.arrays, notes=tuple(found.notes))


class _Found:
    """The arrays and numbers in the groups of a file. is_matlab: whether axes are in reverse."""

    def __init__(self, path: Path, is_matlab: bool) -> None:
        self.path, self.is_matlab = path, is_matlab
        self.arrays: list[StoredArray] = []
        self.notes: list[str] = []
        self.seen = 0

    def group(self, group: Any, prefix: str, depth: int) -> None:
        """Adds what a group holds. Raises UserError for too many or too deep ones."""
        if depth > _MOST_DEPTH:
            found = f"groups more than {_MOST_DEPTH} deep inside each other"
            raise UserError(str(self.path), found, expected="a hologram's file")
        self._attributes(group, prefix.rstrip("."))
        for key in group:
            self.seen += 1
            if self.seen > _MOST_OBJECTS:
                raise UserError(str(self.path), f"more than {_MOST_OBJECTS} objects", expected="a hologram's file")
            if key in _MATLAB_PRIVATE:
                continue
            name = f"{prefix}{key}"
            if not isinstance(group.get(key, getlink=True), h5py.HardLink):
                self.notes.append(f'"{name}" is a link: not followed')
                continue
            item = group[key]
            if isinstance(item, h5py.Group):
                self.group(item, f"{name}.", depth + 1)
            elif isinstance(item, h5py.Dataset):
                self._dataset(name, item)

    def _dataset(self, name: str, dataset: Any) -> None:
        if dataset.shape is None or "MATLAB_empty" in dataset.attrs:
            return
        if dataset.is_virtual or dataset.external:
            self.notes.append(f'"{name}" lies in another file: not read')
            return
        if "MATLAB_object_decode" in dataset.attrs:
            self.notes.append(f'the variable "{name}" is an object of MATLAB: not read')
            return
        if b"MATLAB_class" in dataset.attrs or "MATLAB_class" in dataset.attrs:
            kind = dataset.attrs["MATLAB_class"]
            if kind == b"char" and dataset.dtype == np.uint16 and dataset.size <= _MOST_LETTERS:
                text = "".join(map(chr, np.ravel(dataset[()])))
                self.arrays.append(StoredArray.of(name, np.array(text)))
            if kind in (b"char", b"cell", b"function_handle"):
                return
        self._attributes(dataset, name)
        self._steps(dataset, name)
        dtype = _complex_type(dataset.dtype) or dataset.dtype
        if dtype.kind not in "biufc":
            return
        where = f"{self.path}: {name}"
        chunk = math.prod(dataset.chunks or ()) * dataset.dtype.itemsize
        _check_filters(where, dataset)
        _check_sizes(where, dataset, self.path.stat().st_size)
        is_reversed = self.is_matlab or "MATLAB_class" in dataset.attrs
        shape = tuple(reversed(dataset.shape)) if is_reversed else tuple(dataset.shape)

        def load(window: Window) -> NDArray[Any]:
            inner = tuple(reversed(window)) if is_reversed else window
            size = math.prod(w.stop - w.start for w in window) * dataset.dtype.itemsize
            require_memory(where, 2 * size + chunk)
            values = np.asarray(dataset[inner])
            if dtype != dataset.dtype:
                values = _as_complex(values, dtype)
            return values.T if is_reversed else values

        self.arrays.append(StoredArray(name, shape, dtype, load, whole_bytes=chunk))

    def _steps(self, dataset: Any, name: str) -> None:
        """The steps of the coordinates along the last two long axes become numbers `dy` and `dx`."""
        long = [axis for axis, size in enumerate(dataset.shape) if size > 1][-2:]
        for axis, key in zip(long, ("dy", "dx"), strict=False):
            if len(long) == 2 and len(dataset.dims[axis]) and (step := _step(dataset.dims[axis][0])) is not None:
                self.arrays.append(StoredArray.of(f"{name}.{key}", np.array([step])))

    def _attributes(self, item: Any, name: str) -> None:
        """Attributes that are numbers become small arrays, named after the group or dataset that they belong to."""
        if len(item.attrs) > _MOST_ATTRIBUTES:
            return
        for key in item.attrs:
            stored = item.attrs.get_id(key)
            if stored.get_storage_size() > _MOST_ATTRIBUTE_BYTES:
                continue
            if stored.dtype.kind in "iuf" and not key.startswith(("MATLAB_", "H5")):
                values = np.atleast_1d(item.attrs[key])
                self.arrays.append(StoredArray.of(f"{name}.{key}" if name else key, values))
            elif isinstance(text := _text(item.attrs, key), str):
                values = np.array(text)
                if text.endswith(_END_OF_YAML):  # a number or text as YAML, as HoloPy writes its settings
                    text = text.removesuffix(_END_OF_YAML)
                    with suppress(ValueError):
                        values = np.array([float(text)])
                self.arrays.append(StoredArray.of(f"{name}.{key}" if name else key, values))


def _step(coordinates: Any) -> float | None:
    """The step of equidistant numbers along an axis; None of others."""
    if coordinates.ndim != 1 or coordinates.dtype.kind not in "iuf" or not 1 < coordinates.size <= _MOST_COORDINATES:
        return None
    steps = np.diff(np.asarray(coordinates[()], np.float64))
    step = float(abs(steps.mean()))
    return step if step > 0 and bool((np.abs(np.abs(steps) - step) < _EVEN * step).all()) else None


def _text(attributes: Any, key: str) -> str | None:
    """The text of an attribute, None for others."""
    if attributes.get_id(key).dtype.kind not in "OS" or attributes.get_id(key).shape not in ((), (1,)):
        return None
    value = np.ravel(attributes[key])[0]
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return text if isinstance(text, str) and len(text) <= _MOST_LETTERS else None


def _complex_type(dtype: np.dtype[Any]) -> np.dtype[Any] | None:
    """The complex type of a pair of floats, None for other types."""
    names = dtype.names or ()
    kinds = [dtype[name] for name in names]
    if len(names) != 2 or kinds[0] != kinds[1] or kinds[0].kind not in "fiu":
        return None
    first, second = (name.lower() for name in names)
    if not (first.startswith("r") and second.startswith("i")):
        return None
    return np.dtype("c16" if kinds[0].itemsize > 4 or kinds[0].kind != "f" else "c8")


def _as_complex(pairs: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    first, second = pairs.dtype.names or ("", "")
    values = np.empty(pairs.shape, dtype)
    values.real, values.imag = pairs[first], pairs[second]
    return values


def _check_sizes(where: str, dataset: Any, file_bytes: int) -> None:
    """Raises UserError for many small chunks, and for data that a file of this size can't hold."""
    size = math.prod(dataset.shape) * dataset.dtype.itemsize
    if size > _FREE_BYTES + _MOST_RATIO * file_bytes:
        found = f"declares {format_size(size)} of data in a file of {format_size(file_bytes)}"
        raise UserError(where, found, expected="a whole file", remedy="write the file again")
    chunks = dataset.chunks or dataset.shape
    count = math.prod(-(-whole // part) for whole, part in zip(dataset.shape, chunks, strict=True))
    if count > max(_FEW_CHUNKS, size // _SMALL_CHUNK_BYTES):
        found = f"is cut into {count} chunks of {format_size(size / count)}"
        raise UserError(where, found, expected=f"chunks of at least {_SMALL_CHUNK_BYTES} bytes", remedy="rechunk it")


def _check_filters(where: str, dataset: Any) -> None:
    """Raises UserError for a compression that the HDF5 library lacks."""
    plist = dataset.id.get_create_plist()
    for index in range(plist.get_nfilters()):
        code, _, _, name = plist.get_filter(index)
        if not h5py.h5z.filter_avail(code):
            found = f"is compressed by the HDF5 filter {code} ({name.decode('latin-1')[:60]}), which isn't installed"
            raise UserError(where, found, remedy="save it without compression or with gzip")
