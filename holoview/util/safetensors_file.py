"""Safetensors files with a declared format: tensors with a schema and text metadata, checked when a file is read.

Safetensors (https://github.com/huggingface/safetensors) holds plain numbers and text, so that reading a file from an
unknown source runs no code, as unpickling would. The library maps files into memory, where one that shrinks ends the
process; files are therefore read here (`open_tensors`) and written by the library.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import opened_file
from holoview.util.memory_limit import format_size, require_memory
from holoview.util.plain_arrays import read_window
from holoview.util.tables import ArraySchema, parse_json_table

_TYPES = {
    "U8": "uint8",
    "U16": "uint16",
    "U32": "uint32",
    "U64": "uint64",
    "BOOL": "bool",
    "I8": "int8",
    "I16": "int16",
    "I32": "int32",
    "I64": "int64",
    "F16": "float16",
    "F32": "float32",
    "F64": "float64",
    "C64": "complex64",
}
"""Numpy's names of safetensors' types; others, such as BF16, numpy doesn't have."""

NO_SIZES: Mapping[str, int] = {}


# --- the tensors of a file --------------------------------------------------------------------------------------------


_MOST_HEADER_BYTES = 16 << 20  # the holograms of a study with all of their notes have 100 kB
_MOST_AXES, _MOST_TENSORS = 32, 10_000


@dataclass(frozen=True)
class StoredTensor:
    """A tensor of a file: safetensors' name of its type, its shape, and the byte at which its numbers begin."""

    path: Path
    name: str
    kind: str
    shape: tuple[int, ...]
    offset: int

    @property
    def dtype(self) -> np.dtype[Any] | None:
        """The type of its numbers, None for one that numpy doesn't have."""
        return np.dtype(_TYPES[self.kind]).newbyteorder("<") if self.kind in _TYPES else None

    def read(self, window: Sequence[slice] | None = None) -> NDArray[Any]:
        """All numbers, or those of a window: a slice without steps for each axis."""
        assert self.dtype is not None
        whole = tuple(slice(0, size) for size in self.shape)
        return read_window(self.path, self.dtype, self.shape, self.offset, whole if window is None else window)


@dataclass(frozen=True)
class StoredTensors:
    """What the header of a file says. texts: its metadata."""

    tensors: dict[str, StoredTensor]
    texts: dict[str, str]


def open_tensors(path: str | os.PathLike[str], expected: str) -> StoredTensors:
    """The tensors of a safetensors file, none of which is read yet.

    The header is a JSON table, whose offsets have to fill the rest of the file without gaps, in the order of their
    starts. Raises UserError for a file that is missing, or whose header says something else.
    """
    where = str(path)
    with opened_file(path, expected) as file:
        size = os.fstat(file.fileno()).st_size
        length = int.from_bytes(file.read(8), "little")
        if size < 8 or length > min(size - 8, _MOST_HEADER_BYTES):
            found = f"can't be read: a header of {format_size(length)} in a file of {format_size(size)}"
            raise UserError(where, found, expected=expected)
        try:
            text = file.read(length).decode("utf-8")
        except UnicodeDecodeError as error:
            raise UserError(where, f"can't be read: {error}", expected=expected) from error
    header = parse_json_table(text, where, expected)
    texts = header.pop("__metadata__", {})
    if not isinstance(texts, dict) or not all(isinstance(value, str) for value in texts.values()):
        raise UserError(where, "can't be read: its metadata aren't texts", expected=expected)
    if len(header) > _MOST_TENSORS:
        raise UserError(where, f"has {len(header)} tensors", expected=f"at most {_MOST_TENSORS}")
    tensors, spans = {}, []
    for name, entry in header.items():
        try:
            kind, shape, (first, last) = str(entry["dtype"]), tuple(entry["shape"]), entry["data_offsets"]
        except (KeyError, TypeError, ValueError) as error:
            raise UserError(
                f"{where}: {name}", "can't be read: no type, shape and offsets", expected=expected
            ) from error
        numbers = (*shape, first, last)
        if len(shape) > _MOST_AXES or not all(type(n) is int and n >= 0 for n in numbers):
            raise UserError(f"{where}: {name}", "can't be read: sizes that are none", expected=expected)
        if kind in _TYPES and math.prod(shape) * np.dtype(_TYPES[kind]).itemsize != last - first:
            found = f"can't be read: an array of shape {shape}, {kind}, in {format_size(last - first)}"
            raise UserError(f"{where}: {name}", found, expected=expected)
        spans.append((first, last))
        tensors[name] = StoredTensor(Path(path), name, kind, shape, 8 + length + first)
    ends = [0, *(last for _, last in sorted(spans))]
    if [first for first, _ in sorted(spans)] != ends[:-1] or ends[-1] != size - 8 - length:
        found = f"can't be read: {format_size(size - 8 - length)} of numbers aren't those that its header places"
        raise UserError(where, found, expected=expected)
    return StoredTensors(tensors, texts)


# --- formats ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TensorFormat:
    """A file format.

    name, version: stored in the metadata as "format" and "version", and compared when a file is read.
    what: the kind of file in words, for error messages.
    tensors: a schema for each tensor of the file; other tensors in a file are ignored.
    metadata_keys: further metadata that the file must hold.
    copies: memory that a reader takes besides the tensors, in sizes of the tensors.
    """

    name: str
    version: str
    what: str
    tensors: tuple[ArraySchema, ...]
    metadata_keys: tuple[str, ...]
    copies: float = 2.0

    def write(
        self, path: str | os.PathLike[str], tensors: Mapping[str, NDArray[Any]], texts: Mapping[str, str]
    ) -> None:
        """Writes the tensors of this format and the metadata `texts` atomically. Raises WriteError when it fails."""
        contiguous = {name: np.ascontiguousarray(tensors[name]) for name in (schema.name for schema in self.tensors)}
        write_file(path, save(contiguous, metadata={"format": self.name, "version": self.version, **texts}))

    @contextmanager
    def open(self, path: str | os.PathLike[str]) -> Iterator[TensorFile]:
        """Opens a file to read. Its format and the names of its tensors and texts are checked; no tensor is read yet.

        Raises UserError, in the block too, when the file is missing or damaged, has another format or version, or lacks
        a tensor or a metadata key.
        """
        stored = open_tensors(path, self.what)
        self._check(path, stored.texts, set(stored.tensors))
        yield TensorFile(str(path), self, stored.texts, stored.tensors)

    def read(self, path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
        """Reads a file: {name: array} and the metadata. Raises UserError as `open` and `TensorFile.tensors` do."""
        with self.open(path) as file:
            return file.tensors(), file.texts

    def _check(self, path: str | os.PathLike[str], texts: Mapping[str, str], names: set[str]) -> None:
        if texts.get("format") != self.name or texts.get("version") != self.version:
            found = f'format "{texts.get("format", "none")}", version {texts.get("version", "none")}'
            expected = f'{self.what}: format "{self.name}", version {self.version}'
            raise UserError(str(path), found, expected=expected)
        missing = sorted({schema.name for schema in self.tensors} - names) or [
            f"its {text}" for text in self.metadata_keys if text not in texts
        ]
        if missing:
            raise UserError(str(path), f"lacks {', '.join(missing)}", expected=self.what)


@dataclass(frozen=True)
class TensorFile:
    """A file that is open to be read. where: how errors name it. texts: its metadata."""

    where: str
    format: TensorFormat
    texts: dict[str, str]
    _stored: Mapping[str, StoredTensor]

    def tensors(self, sizes: Mapping[str, int] = NO_SIZES) -> dict[str, NDArray[Any]]:
        """The tensors of the format, {name: array}; types, shapes and memory are checked before any is read.

        sizes: the sizes that the schema names, as far as the metadata tell them.
        Raises UserError for a tensor that isn't what the schema says, and when all need too much memory.
        """
        try:
            self._check_headers(dict(sizes))
            found = {schema.name: self._stored[schema.name].read() for schema in self.format.tensors}
            for schema in self.format.tensors:
                schema.check_values(found[schema.name])
        except UserError as error:
            raise error if error.where.startswith(self.where) else error.inside(f"{self.where}: ") from error
        return found

    def _check_headers(self, sizes: dict[str, int]) -> None:
        needed = 0
        for schema in self.format.tensors:
            tensor = self._stored[schema.name]
            type_name = _TYPES.get(tensor.kind, tensor.kind)
            schema.check_header(type_name, tensor.shape, sizes)
            needed += math.prod(tensor.shape) * np.dtype(type_name).itemsize
        require_memory(self.where, (1 + self.format.copies) * needed)


def format_of(path: str | os.PathLike[str]) -> str:
    """The name of the format that a file's metadata declares, "" for any other file. Only the header is read."""
    return metadata_of(path).get("format", "")


def metadata_of(path: str | os.PathLike[str]) -> dict[str, str]:
    """The metadata of a safetensors file, none for any other file. Only the header is read."""
    try:
        return open_tensors(path, "a file").texts
    except UserError:
        return {}


# --- checkpoints ------------------------------------------------------------------------------------------------------


def differing_fields(stored: Any, given: Any) -> list[str]:
    """The names of the fields in which two instances of one dataclass differ."""
    stored_values, given_values = dataclasses.asdict(stored), dataclasses.asdict(given)
    return [name for name, value in stored_values.items() if value != given_values[name]]


def refuse_differences(differing: Sequence[str], where: str, run: str, inputs: str) -> None:
    """Raises UserError that names what differs, located at `where`, unless nothing does.

    run: the kind of run in words ("optimisation"). inputs: the setting that must be the same as when it was begun.
    """
    if differing:
        raise UserError(
            where,
            f"is of another {run}: {', '.join(differing)} differ",
            expected=f"the same {inputs} as when it was begun",
        )
