"""Messages over a local socket: a line of JSON, and an array if the line announces one.

Nothing in a message is run or unpickled. A side that sends anything else is disconnected.
"""

from __future__ import annotations

import json
import math
import socket
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.tables import parse_json_table

_MAX_LINE, _MAX_BYTES = 1 << 16, 1 << 28
_TYPES = ("uint8", "uint16")
_EXPECTED = "a message"


class Disconnected(Exception):
    """The other side is gone, or sent what isn't a message."""


@dataclass(frozen=True)
class Message:
    """A table, and an array of uint8 or uint16 or None."""

    table: dict[str, Any]
    array: NDArray[Any] | None = None


class Connection:
    """One side of a connected socket."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self._stream = connected.makefile("rb")

    def send(self, message: Message) -> None:
        """Sends a message. Raises Disconnected."""
        table, array = dict(message.table), message.array
        data = b""
        if array is not None:
            if array.dtype.name not in _TYPES:
                raise ValueError(f"arrays of {array.dtype.name} aren't sent")
            table |= {"type": array.dtype.name, "shape": list(array.shape)}
            data = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        try:
            self._socket.sendall(json.dumps(table).encode() + b"\n" + data)
        except OSError as error:
            raise Disconnected(str(error)) from error

    def receive(self) -> Message:
        """Waits for the next message. Raises Disconnected, also after the socket's time-out."""
        try:
            line = self._stream.readline(_MAX_LINE)
            if not line.endswith(b"\n"):
                raise Disconnected("closed" if not line else "too long a line")
            table = parse_json_table(line.decode("utf-8", "replace"), "message", _EXPECTED)
            return Message(table, self._array(table) if "shape" in table else None)
        except (OSError, UserError, KeyError, TypeError, ValueError, OverflowError) as error:
            raise Disconnected(str(error) or type(error).__name__) from error

    def close(self) -> None:
        """Closes the socket; twice is once."""
        self._stream.close()
        self._socket.close()

    def _array(self, table: dict[str, Any]) -> NDArray[Any]:
        name, shape = table["type"], [int(n) for n in table["shape"]]
        if name not in _TYPES or any(n < 0 for n in shape):
            raise Disconnected("an array of another kind")
        size = math.prod(shape) * np.dtype(name).itemsize
        if size > _MAX_BYTES:
            raise Disconnected("too large an array")
        data = self._stream.read(size)
        if len(data) != size:
            raise Disconnected("closed within an array")
        return np.frombuffer(data, dtype=np.dtype(name).newbyteorder("<")).reshape(shape).astype(name)
