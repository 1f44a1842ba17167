"""Torch's .pt and .pth files and other pickles: recognised and refused, because opening one runs its code."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

from holoview.holograms.files.readers.contents import Contents
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError


class TorchReader:
    """Refuses pickles and says what to do."""

    name = "torch"
    suffixes = (".pt", ".pth", ".pkl")

    def recognises(self, head: bytes) -> bool:
        """Whether it is a ZIP archive with a pickle, or begins as a pickle of protocols 2 to 5."""
        is_archive = head.startswith(b"PK\x03\x04") and b"data.pkl" in head[30:200]
        return is_archive or (head[:1] == b"\x80" and head[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05"))

    def open(self, path: Path, request: ReadRequest) -> AbstractContextManager[Contents]:
        """Raises UserError."""
        remedy = f'save the tensor with np.save("{path.stem}.npy", tensor.numpy(force=True)) and open that file'
        raise UserError(str(path), "is a pickle, which can run code when it is opened", remedy=remedy)
