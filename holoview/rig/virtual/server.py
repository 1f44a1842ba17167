"""The process of a virtual bench: `python -m holoview.rig.virtual.server RIG.toml`.

It reads a token from stdin, prints the port of a local socket that it listens on, and serves whoever sends the token
first. It ends when stdin is closed, which is when the process that started it ends, however that ended.
"""

from __future__ import annotations

import hmac
import os
import random
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from holoview.rig.description import read_rig
from holoview.rig.devices import Counts
from holoview.rig.virtual.client import Connection, Disconnected, Message
from holoview.rig.virtual.virtual_bench import PICTURE_FAULTS, FaultSettings, VirtualBench, read_virtual_settings
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file

_NO_PICTURE_S = 1.0  # of bench time, after which a camera's time-out is told


class BenchServer:
    """Answers messages {"do": …}; an answer has the key "error" if it couldn't be done.

    Where a message has "live": true, the time since the last answer has passed on the bench.
    """

    def __init__(self, bench: VirtualBench, faults: FaultInjector) -> None:
        self._bench, self._faults, self._lock = bench, faults, threading.Lock()
        self._idle_since = time.monotonic()
        self._actions: dict[str, Callable[[Message], Message]] = {
            "show": self._show,
            "take": lambda _: Message({}, bench.take()),
            "expose": lambda m: Message({"exposure": bench.expose(float(m.table["exposure"]))}),
            "laser": self._laser,
            "move": lambda m: Message({"distance": bench.move_to(float(m.table["distance"]))}),
            "wait": self._wait,
            "time": lambda _: Message({"time": bench.time_s}),
        }

    def answer(self, message: Message) -> Message:
        """The answer to one message; those of several connections one after the other, but lasers go off at once."""
        action = self._actions.get(str(message.table.get("do")))
        if action is None:
            return Message({"error": "unknown message"})
        is_off = message.table.get("do") == "laser" and message.table.get("wavelength") is None
        try:
            if is_off:
                return action(message)
            with self._lock:
                return self._act(action, message)
        except UserError as error:
            return Message({"error": str(error)})
        except (KeyError, TypeError, ValueError, IndexError) as error:
            return Message({"error": f"not understood: {error}"})

    def _act(self, action: Callable[[Message], Message], message: Message) -> Message:
        if message.table.get("live") is True:
            self._bench.wait(time.monotonic() - self._idle_since)
        try:
            return action(message)
        finally:
            self._idle_since = time.monotonic()

    def serve(self, connection: Connection, token: str) -> None:
        """Answers messages until the other side is gone; without the right token the connection is closed."""
        try:
            if not hmac.compare_digest(str(connection.receive().table.get("token", "")).encode(), token.encode()):
                return
            connection.send(Message({}))
            while True:
                connection.send(self._faults.answer(connection.receive(), self.answer))
        except Disconnected:
            pass
        finally:
            connection.close()

    def _show(self, message: Message) -> Message:
        if message.array is None:
            raise ValueError("no levels")
        self._bench.show(int(message.table["slm"]), message.array)
        return Message({})

    def _laser(self, message: Message) -> Message:
        wavelength: Any = message.table.get("wavelength")
        if wavelength is None:
            self._bench.switch_off()
        else:
            self._bench.switch_on(float(wavelength), float(message.table["power"]))
        return Message({})

    def _wait(self, message: Message) -> Message:
        self._bench.wait(float(message.table["seconds"]))
        return Message({})


class FaultInjector:
    """Answers messages as devices with faults would. power_off: ends the process at once."""

    def __init__(self, settings: FaultSettings, power_off: Callable[[], None]) -> None:
        self._settings, self._power_off = settings, power_off
        self._chance = random.Random(settings.seed)
        self._before: Counts | None = None

    def answer(self, message: Message, answer: Callable[[Message], Message]) -> Message:
        """The answer of `answer`, unless a fault happens. Raises Disconnected for one of the connection."""
        is_late = self._chance.random() < 0.5  # a fault comes before the request is carried out, or after it
        found = answer(message) if is_late else None
        if self._happens("power_off"):
            self._power_off()
        if self._happens("disconnect"):
            raise Disconnected("a fault")
        found = found or answer(message)
        if message.table.get("do") != "take" or found.array is None:
            return found
        fault = next((name for name in PICTURE_FAULTS if self._happens(name)), None)
        if fault == "timeout":
            answer(Message({"do": "wait", "seconds": _NO_PICTURE_S}))
            return Message({"error": f"no picture within {_NO_PICTURE_S:g} s"})
        self._before = self._spoilt(found.array, fault)
        return Message(found.table, self._before)

    def _happens(self, fault: str) -> bool:
        share = self._settings.shares.get(fault, 0.0)
        return share > 0 and self._chance.random() < share

    def _spoilt(self, picture: Counts, fault: str | None) -> Counts:
        rows = len(picture)
        if fault == "short":
            return picture[: rows // 2]
        if self._before is None or self._before.shape != picture.shape:
            return picture
        if fault == "torn":
            tear = self._chance.randint(rows // 4, rows - max(rows // 8, 1))
            return np.concatenate([picture[:tear], self._before[tear:]])
        return self._before if fault == "repeated" else picture


class LaserLog:
    """A file with a line for each switching of a laser. path: None for no file."""

    def __init__(self, path: Path | None) -> None:
        self._path, self._lines, self._lock = path, list[str](), threading.Lock()

    def note(self, line: str) -> None:
        """Adds a line."""
        if self._path is not None:
            with self._lock:
                self._lines.append(line)
                write_file(self._path, "\n".join([*self._lines, ""]), is_durable=False)


def main() -> int:
    """Serves the rig of the first argument."""
    token = sys.stdin.readline().strip()
    torch.set_num_threads(1)
    try:
        rig = read_rig(sys.argv[1], is_registered=False)
        settings = read_virtual_settings(rig)
        log = LaserLog(settings.laser_log)
        bench = VirtualBench(rig, settings, log.note)
    except UserError as error:
        print(f"error {error}", flush=True)
        return 2
    server = BenchServer(bench, FaultInjector(settings.faults, lambda: _end(bench, log, "off: no power")))
    with socket.create_server(("127.0.0.1", 0)) as listening:
        print(f"port {listening.getsockname()[1]}", flush=True)
        threading.Thread(target=_end_with_stdin, args=(bench, log), daemon=True).start()
        while True:
            connected, _ = listening.accept()
            threading.Thread(target=server.serve, args=(Connection(connected), token), daemon=True).start()


def _end_with_stdin(bench: VirtualBench, log: LaserLog) -> None:
    """Ends with the program that started this one; a laser that is on goes off by an interlock for signs of life."""
    sys.stdin.read()
    _end(bench, log, "off: interlock")


def _end(bench: VirtualBench, log: LaserLog, line: str) -> None:
    if bench.laser is not None:
        log.note(line)
    os._exit(0)


if __name__ == "__main__":
    raise SystemExit(main())
