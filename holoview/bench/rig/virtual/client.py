"""Starts the process of a virtual bench, and devices that talk to it.

Messages go over a local socket: a line of JSON, and an array if the line announces one (`send`, `receive`). An answer
has the number of its request. Nothing in a message is run or unpickled. A side that sends anything else is
disconnected.
"""

from __future__ import annotations

import json
import math
import secrets
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Counts, DeviceError, DeviceGone, Levels
from holoview.util.errors import UserError
from holoview.util.tables import parse_json_table

_MAX_LINE, _MAX_BYTES = 1 << 16, 1 << 28
_TYPES = ("uint8", "uint16")
_EXPECTED = "a message"


class Disconnected(Exception):
    """The other side is gone, or sent something else than a message."""


@dataclass(frozen=True)
class Packet:
    """A table, and an array of uint8 or uint16 or None."""

    table: dict[str, Any]
    array: NDArray[Any] | None = None


class Connection:
    """One side of a connected socket."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self._stream = connected.makefile("rb")
        self._asked = 0

    def send(self, message: Packet) -> None:
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

    def receive(self) -> Packet:
        """Waits for the next message. Raises Disconnected, also after the socket's time-out."""
        try:
            line = self._stream.readline(_MAX_LINE)
            if not line.endswith(b"\n"):
                raise Disconnected("closed" if not line else "too long a line")
            table = parse_json_table(line.decode("utf-8", "replace"), "message", _EXPECTED)
            return Packet(table, self._array(table) if "shape" in table else None)
        except (OSError, UserError, KeyError, TypeError, ValueError, OverflowError) as error:
            raise Disconnected(str(error) or type(error).__name__) from error

    def ask(self, message: Packet) -> Packet:
        """Sends a message and waits for the answer to it, which has the same number. Raises Disconnected.

        An answer that is left over, because Ctrl-C ended an earlier call, isn't taken for this one's: lasers could pass
        as switched off when an earlier request to switch them on was confirmed.
        """
        self._asked += 1
        number = self._asked
        self.send(Packet({**message.table, "number": number}, message.array))
        while (answer := self.receive()).table.get("number") != number:
            pass
        return answer

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


# --- the process and its devices ---


_TIMEOUT_S, _END_S = 120.0, 10.0
_REMEDY = "run the command again; it goes on where it was"


def start_server(rig_path: Path) -> subprocess.Popen[str]:
    """The process of `server`, in a session of its own, which signals of a terminal don't reach."""
    return subprocess.Popen(
        [sys.executable, "-m", "holoview.bench.rig.virtual.server", str(rig_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


class VirtualBenchProcess:
    """A running virtual bench. Close it, or end this process, to end it."""

    def __init__(self, rig_path: Path) -> None:
        token = secrets.token_hex(16)
        self._process = start_server(rig_path)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(token + "\n")
        self._process.stdin.flush()
        kind, _, text = self._process.stdout.readline().strip().partition(" ")
        if kind != "port":
            self.close()
            raise DeviceError("virtual bench", text or "didn't start", remedy="see the table [virtual] in rig.toml")
        self.address, self.token = ("127.0.0.1", int(text)), token
        self._connection = connect(self.address, token)

    def ask(self, table: dict[str, Any], array: Levels | None = None) -> Packet:
        """Sends a message and returns the answer. Raises DeviceError."""
        return ask(self._connection, table, array)

    def close(self) -> None:
        """Ends the process; twice is once."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()
        try:
            self._process.wait(_END_S)  # it sees the end of its stdin
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if hasattr(self, "_connection"):
            self._connection.close()


def connect(address: tuple[str, int], token: str) -> Connection:
    """A connection to a virtual bench that runs. Raises DeviceError."""
    try:
        connection = Connection(socket.create_connection(address, timeout=_TIMEOUT_S))
    except OSError as error:
        raise DeviceError("virtual bench", f"can't be reached: {error}", remedy=_REMEDY) from error
    try:
        ask(connection, {"token": token})
    except DeviceError:
        connection.close()
        raise
    return connection


def ask(connection: Connection, table: dict[str, Any], array: Levels | None = None) -> Packet:
    """Sends a message and returns the answer. Raises DeviceGone where the bench is gone, DeviceError if it refuses."""
    try:
        answer = connection.ask(Packet(table, array))
    except Disconnected as error:
        raise DeviceGone("virtual bench", f"is gone ({error})", remedy=_REMEDY) from error
    if "error" in answer.table:
        raise DeviceError("virtual bench", str(answer.table["error"]))
    return answer


class VirtualModulator:
    """A modulator of a virtual bench. number: its index among them."""

    def __init__(self, bench: VirtualBenchProcess, rig: RigDescription, number: int, settle_s: float) -> None:
        self._bench, self._number = bench, number
        self.shape, self.settle_s = rig.slm_shapes[number], settle_s

    def show(self, levels: Levels) -> None:
        self._bench.ask({"do": "show", "slm": self._number}, levels)

    def close(self) -> None:
        self._bench.close()


class VirtualCamera:
    """The camera of a virtual bench."""

    def __init__(self, bench: VirtualBenchProcess, rig: RigDescription) -> None:
        self._bench, self.shape, self.exposures_s = bench, rig.camera_shape, rig.limits.exposures_s

    def set_exposure(self, exposure_s: float) -> float:
        return float(self._bench.ask({"do": "expose", "exposure": exposure_s}).table["exposure"])

    def take(self) -> Counts:
        array = self._bench.ask({"do": "take"}).array
        if array is None:
            raise DeviceError("camera", "sent no picture", remedy=_REMEDY)
        return array

    def close(self) -> None:
        self._bench.close()


class VirtualLasers:
    """The lasers of a virtual bench, with a connection of their own: they go off while the camera exposes."""

    def __init__(self, bench: VirtualBenchProcess, rig: RigDescription) -> None:
        self._bench, self.wavelengths_m = bench, rig.wavelengths_m
        self._connection = connect(bench.address, bench.token)

    def switch_on(self, wavelength_m: float, power: float) -> None:
        ask(self._connection, {"do": "laser", "wavelength": wavelength_m, "power": power})

    def switch_off(self) -> None:
        ask(self._connection, {"do": "laser", "wavelength": None})

    def close(self) -> None:
        self._bench.close()
        self._connection.close()


class VirtualStage:
    """The stage of a virtual bench."""

    def __init__(self, bench: VirtualBenchProcess, rig: RigDescription) -> None:
        self._bench, self.range_m = bench, rig.stage_m

    def move_to(self, distance_m: float) -> float:
        return float(self._bench.ask({"do": "move", "distance": distance_m}).table["distance"])

    def close(self) -> None:
        self._bench.close()


class VirtualClock:
    """The simulated time of a virtual bench."""

    def __init__(self, bench: VirtualBenchProcess) -> None:
        self._bench = bench

    def now(self) -> float:
        return float(self._bench.ask({"do": "time"}).table["time"])

    def wait(self, seconds: float) -> None:
        self._bench.ask({"do": "wait", "seconds": seconds})
