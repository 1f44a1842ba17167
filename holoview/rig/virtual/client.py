"""Starts the process of a virtual bench, and devices that talk to it."""

from __future__ import annotations

import secrets
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

from holoview.rig.description import RigDescription
from holoview.rig.devices import Counts, DeviceError, DeviceGone, Levels
from holoview.rig.virtual.wire import Connection, Disconnected, Message

_TIMEOUT_S, _END_S = 120.0, 10.0
_REMEDY = "run the command again; it goes on where it was"


def start_server(rig_path: Path) -> subprocess.Popen[str]:
    """The process of `server`, in a session of its own: what a terminal sends to the program doesn't reach it."""
    return subprocess.Popen(
        [sys.executable, "-m", "holoview.rig.virtual.server", str(rig_path)],
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

    def ask(self, table: dict[str, Any], array: Levels | None = None) -> Message:
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


def ask(connection: Connection, table: dict[str, Any], array: Levels | None = None) -> Message:
    """Sends a message and returns the answer. Raises DeviceGone where the bench is gone, DeviceError if it refuses."""
    try:
        connection.send(Message(table, array))
        answer = connection.receive()
    except Disconnected as error:
        raise DeviceGone("virtual bench", f"is gone ({error})", remedy=_REMEDY) from error
    if "error" in answer.table:
        raise DeviceError("virtual bench", str(answer.table["error"]))
    return answer


class VirtualModulator:
    """A modulator of a virtual bench. number: 0 or 1."""

    def __init__(self, bench: VirtualBenchProcess, rig: RigDescription, number: int, settle_s: float) -> None:
        self._bench, self._number = bench, number
        self.shape, self.settle_s = rig.slm_shape, settle_s

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
