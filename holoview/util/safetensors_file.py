"""Our safetensors files: named tensors, and texts that say which format they are. Nothing is ever unpickled."""

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
    """A kind of file: its name and version, what people call it, and the tensors and texts that it must hold."""

    name: str
    version: str
    what: str
    tensors: tuple[str, ...]
    metadata_keys: tuple[str, ...]

    def write(
        self, path: str | os.PathLike[str], tensors: Mapping[str, NDArray[Any]], texts: Mapping[str, str]
    ) -> None:
        """Writes the file, whole or not at all."""
        contiguous = {name: np.ascontiguousarray(tensors[name]) for name in self.tensors}
        with atomic_write(path) as temporary:
            save_file(contiguous, temporary, metadata={"format": self.name, "version": self.version, **texts})

    def read(self, path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
        """Tensors and texts. Raises UserError when the file is missing, damaged, of another format, or lacks something.

        The header is checked before any tensor is read.
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
    """The format that one of our files says it has, or "" for any other file; only the header is read."""
    try:
        with safe_open(path, framework="numpy") as file:
            return str((file.metadata() or {}).get("format", ""))
    except (SafetensorError, OSError, ValueError, TypeError, AttributeError):
        return ""
