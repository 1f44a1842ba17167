"""Starts the helper process of `tune`, sends it requests, collects its answers, and ends it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import weakref
from collections.abc import Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

WORKER_ARGUMENTS = ("-m", "holoview.gpu.tune_worker")
"""Arguments of the Python interpreter that start the helper."""
_JOIN_TIMEOUT_S = 2.0
Message = dict[str, Any]
"""One line of JSON: see `tune_worker` for the protocol."""


class TuningProcess:
    """Runs `tune_worker` on the adapter of a name, for at most `budget_s` seconds of CPU time.

    A thread collects the answers, so that `next_answer` never waits. arguments: of the Python interpreter.
    """

    def __init__(self, adapter: str, budget_s: float, arguments: Sequence[str] = WORKER_ARGUMENTS) -> None:
        package = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH", "")]))
        self._answers: SimpleQueue[Message] = SimpleQueue()
        self._process = subprocess.Popen(
            [sys.executable, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            env={**os.environ, "PYTHONPATH": path},
        )
        self._reader = threading.Thread(target=_collect, args=(self._process, self._answers), daemon=True)
        self._reader.start()
        self._kill = weakref.finalize(self, _kill, self._process, self._reader)
        self.send({"adapter": adapter, "budget_s": budget_s})

    @property
    def has_ended(self) -> bool:
        """Whether the process has exited and all its answers have been taken."""
        return not self._reader.is_alive() and self._process.poll() is not None and self._answers.empty()

    @property
    def hit_time_limit(self) -> bool:
        """Whether the operating system ended the process because it used up its CPU time."""
        return sys.platform != "win32" and self._process.poll() in (-signal.SIGXCPU, -signal.SIGKILL)

    def send(self, request: Message) -> None:
        """Send a request; has no effect if the process has exited."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError, ValueError):
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()

    def next_answer(self) -> Message | None:
        """The next answer, or None if none has arrived yet."""
        with contextlib.suppress(Empty):
            return self._answers.get_nowait()
        return None

    def close(self) -> None:
        """Kill the process."""
        self._kill()


def _collect(process: subprocess.Popen[str], answers: SimpleQueue[Message]) -> None:
    """Put the answers into the queue until the process closes its output."""
    assert process.stdout is not None
    with contextlib.suppress(OSError, ValueError):
        for line in process.stdout:
            with contextlib.suppress(json.JSONDecodeError):
                answers.put(json.loads(line))


def _kill(process: subprocess.Popen[str], reader: threading.Thread) -> None:
    assert process.stdin is not None and process.stdout is not None
    with contextlib.suppress(OSError):
        process.kill()
    process.wait()
    reader.join(_JOIN_TIMEOUT_S)
    for pipe in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):
            pipe.close()
