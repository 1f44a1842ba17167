"""The helper process of `tune.py`, from the side of the program that it helps: requests, answers, and its end."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

_COMMAND = ("-m", "holoview.gpu.tune_worker")
_PATIENCE_S = 2.0
Message = dict[str, Any]


class TuningProcess:
    """Runs `tune_worker.py` on the adapter of a name, for at most so many seconds of processor time.

    A thread collects the answers, so that asking never waits.
    """

    def __init__(self, adapter: str, budget_s: float) -> None:
        package = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH", "")]))
        self._answers: SimpleQueue[Message] = SimpleQueue()
        self._process = subprocess.Popen(
            [sys.executable, *_COMMAND],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            env={**os.environ, "PYTHONPATH": path},
        )
        self._reader = threading.Thread(target=_collect, args=(self._process, self._answers), daemon=True)
        self._reader.start()
        self._end = weakref.finalize(self, _kill, self._process, self._reader)
        self.send({"adapter": adapter, "budget_s": budget_s})

    @property
    def has_ended(self) -> bool:
        """Whether the process is over and its last answer was taken."""
        return not self._reader.is_alive() and self._process.poll() is not None and self._answers.empty()

    @property
    def hit_time_limit(self) -> bool:
        """Whether it ended because its time was up."""
        return sys.platform != "win32" and self._process.poll() in (-signal.SIGXCPU, -signal.SIGKILL)

    def send(self, request: Message) -> None:
        """Hand over a request; a helper that has ended answers none."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError, ValueError):
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()

    def next_answer(self) -> Message | None:
        """The next answer, if there is one by now."""
        with contextlib.suppress(Empty):
            return self._answers.get_nowait()
        return None

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._end()


def _collect(process: subprocess.Popen[str], answers: SimpleQueue[Message]) -> None:
    """Answers, until there are no more."""
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
    reader.join(_PATIENCE_S)
    for pipe in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):
            pipe.close()
