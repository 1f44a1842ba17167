"""Safetensors files with a declared format: named tensors and text metadata, checked when a file is read.

Safetensors (https://github.com/huggingface/safetensors) holds plain numbers and text, so that reading a file from an
unknown source runs no code, as unpickling would.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from holoview.util.errors import UserError
from holoview.util.files import atomic_write


@dataclass(frozen=True)
class TensorFormat:
    """A file format.

    name, version: stored in the metadata as "format" and "version", and compared when a file is read.
    what: the kind of file in words, for error messages.
    tensors: names of the tensors that the file holds.
    metadata_keys: further metadata that the file must hold.
    """

    name: str
    version: str
    what: str
    tensors: tuple[str, ...]
    metadata_keys: tuple[str, ...]

    def write(
        self, path: str | os.PathLike[str], tensors: Mapping[str, NDArray[Any]], texts: Mapping[str, str]
    ) -> None:
        """Writes the tensors of this format and the metadata `texts` atomically. Raises UserError when it fails."""
        contiguous = {name: np.ascontiguousarray(tensors[name]) for name in self.tensors}
        with atomic_write(path) as temporary:
            save_file(contiguous, temporary, metadata={"format": self.name, "version": self.version, **texts})

    def read(self, path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
        """Reads a file: {name: array} and the metadata. The header is checked before any tensor is read.

        Raises UserError when the file is missing or damaged, has another format or version, or lacks a tensor or a
        metadata key.
        """
        if not Path(path).is_file():
            raise UserError(str(path), "no such file", expected=self.what)
        try:
            with safe_open(path, framework="numpy") as file:
                texts = file.metadata() or {}
                self._check(path, texts, set(file.keys()))
                return {name: file.get_tensor(name) for name in self.tensors}, texts
        except UserError:
            raise
        except (SafetensorError, OSError, ValueError, TypeError, AttributeError) as error:
            raise UserError(str(path), f"can't be read: {error}", expected=self.what) from error

    def _check(self, path: str | os.PathLike[str], texts: Mapping[str, str], names: set[str]) -> None:
        if texts.get("format") != self.name or texts.get("version") != self.version:
            found = f'format "{texts.get("format", "none")}", version {texts.get("version", "none")}'
            expected = f'{self.what}: format "{self.name}", version {self.version}'
            raise UserError(str(path), found, expected=expected)
        missing = sorted(set(self.tensors) - names) or [
            f"its {text}" for text in self.metadata_keys if text not in texts
        ]
        if missing:
            raise UserError(str(path), f"lacks {', '.join(missing)}", expected=self.what)


def format_of(path: str | os.PathLike[str]) -> str:
    """The name of the format that a file's metadata declares, "" for any other file. Only the header is read."""
    try:
        with safe_open(path, framework="numpy") as file:
            return str((file.metadata() or {}).get("format", ""))
    except (SafetensorError, OSError, ValueError, TypeError, AttributeError):
        return ""
