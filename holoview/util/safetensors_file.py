"""Safetensors files with a declared format: tensors with a schema and text metadata, checked when a file is read.

Safetensors (https://github.com/huggingface/safetensors) holds plain numbers and text, so that reading a file from an
unknown source runs no code, as unpickling would.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import require_file
from holoview.util.memory_limit import require_memory
from holoview.util.tables import ArraySchema

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
}
"""Numpy's names of safetensors' types; others, such as BF16, numpy doesn't have."""

NO_SIZES: Mapping[str, int] = {}


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
        file = require_file(path, self.what)
        try:
            with safe_open(file, framework="numpy") as opened:
                texts = opened.metadata() or {}
                self._check(path, texts, set(opened.keys()))
                yield TensorFile(str(path), self, texts, opened)
        except UserError:
            raise
        except (SafetensorError, OSError, ValueError, TypeError, AttributeError) as error:
            raise UserError(str(path), f"can't be read: {error}", expected=self.what) from error

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
    _opened: Any

    def tensors(self, sizes: Mapping[str, int] = NO_SIZES) -> dict[str, NDArray[Any]]:
        """The tensors of the format, {name: array}; types, shapes and memory are checked before any is read.

        sizes: the sizes that the schema names, as far as the metadata tell them.
        Raises UserError for a tensor that isn't what the schema says, and when all need too much memory.
        """
        try:
            self._check_headers(dict(sizes))
            found = {schema.name: self._opened.get_tensor(schema.name) for schema in self.format.tensors}
            for schema in self.format.tensors:
                schema.check_values(found[schema.name])
        except UserError as error:
            raise error if error.where.startswith(self.where) else error.inside(f"{self.where}: ") from error
        return found

    def _check_headers(self, sizes: dict[str, int]) -> None:
        needed = 0
        for schema in self.format.tensors:
            header = self._opened.get_slice(schema.name)
            type_name, shape = _TYPES.get(header.get_dtype(), header.get_dtype()), header.get_shape()
            schema.check_header(type_name, shape, sizes)
            needed += math.prod(shape) * np.dtype(type_name).itemsize
        require_memory(self.where, (1 + self.format.copies) * needed)


def format_of(path: str | os.PathLike[str]) -> str:
    """The name of the format that a file's metadata declares, "" for any other file. Only the header is read."""
    return metadata_of(path).get("format", "")


def metadata_of(path: str | os.PathLike[str]) -> dict[str, str]:
    """The metadata of a safetensors file, none for any other file. Only the header is read."""
    try:
        with safe_open(require_file(path, "a file"), framework="numpy") as file:
            return dict(file.metadata() or {})
    except (SafetensorError, OSError, ValueError, TypeError, AttributeError):
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
