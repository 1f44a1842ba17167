"""A viewer that is served by a process of its own, and what a browser of its page does."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.session_store import SessionStore
from tests.patience import PATIENCE_S

if TYPE_CHECKING:  # the library is an optional one
    from websockets.sync.client import ClientConnection


@dataclass(frozen=True)
class Served:
    """A viewer that is served. process: the one that serves. folder: where its state lies."""

    process: subprocess.Popen[str]
    address: str
    token: str
    folder: Path

    @property
    def url(self) -> str:
        """The address of the page, with the token."""
        return f"http://{self.address}/?token={self.token}"

    def next_url(self) -> str:
        """The address that it prints next, after a start of its own."""
        return _next_match(self.process, r"http://\S+")[0][0]

    def restarted(self) -> Served:
        """The same viewer once it has started anew by itself, with another token."""
        found, _ = _next_match(self.process, _ADDRESS)
        return replace(self, address=found[1], token=found[2])

    def edits(self) -> list[str]:
        """What was done in the viewer and not undone, as far as it has been saved."""
        return [step.label for found in self._saved() for step in found.history[1 : found.history_position + 1]]

    def looks(self) -> list[str]:
        """How the look was changed in the viewer and not changed back, as far as it has been saved."""
        return [step.label for found in self._saved() for step in found.looks[0]]

    def _saved(self) -> list[EditingSession]:
        return [saved.restore() for saved in SessionStore(self.folder / "holoview").saved_sessions()]


def _next_match(process: subprocess.Popen[str], pattern: str) -> tuple[re.Match[str], str]:
    """The first match in a line that the process prints from now on, and all of these lines.

    The test fails where the process ends before, or prints none for as long as tests wait: it is killed then.
    """
    assert process.stdout is not None
    patience, said = threading.Timer(PATIENCE_S, process.kill), ""
    patience.start()
    try:
        for line in process.stdout:
            said += line
            if found := re.search(pattern, line):
                return found, said
    finally:
        patience.cancel()
    raise AssertionError(f"the viewer ended, or told no address in {PATIENCE_S:.0f} s: {said}")


PROGRAM = ("-m", "holoview")
_ADDRESS = r"http://(\S+)/\?token=(\S+)"


@contextmanager
def serving(
    folder: Path, *options: str, end: int = signal.SIGINT, program: Sequence[str] = PROGRAM
) -> Iterator[Served]:
    """Runs `holoview view --serve` with its state in `folder`; the signal `end` ends it in good order.

    program: arguments of Python that run `holoview`.
    """
    command = [sys.executable, *program, "view", "--serve", "127.0.0.1:0", "--set", "shape=[32, 48]"]
    environment = os.environ | {"XDG_STATE_HOME": str(folder)}
    process = subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    )
    try:
        found, said = _next_match(process, _ADDRESS)
        yield Served(process, found[1], found[2], folder)
        process.send_signal(end)
        rest, _ = process.communicate(timeout=PATIENCE_S)
        usual = 0 if end == signal.SIGINT else 128 + end
        assert process.returncode in (usual, -signal.SIGKILL) and "Traceback" not in rest, said + rest
    finally:
        process.kill()
        process.communicate(timeout=PATIENCE_S)


def browser_cookie(address: str, token: str) -> str:
    """The cookie that the page sets for whoever has the token."""

    class Stay(urllib.request.HTTPRedirectHandler):
        def redirect_request(self, *_: Any) -> None:
            return None

    opener = urllib.request.build_opener(Stay)
    try:
        opener.open(f"http://{address}/?token={token}", timeout=PATIENCE_S)
    except urllib.error.HTTPError as answer:
        with answer:
            assert answer.code == 303
            return str(answer.headers["set-cookie"]).split(";")[0]
    raise AssertionError("the page sends nobody on")


def next_frame(browser: ClientConnection, timeout_s: float = PATIENCE_S) -> np.ndarray:
    """The next picture; the browser says that it has shown it. Raises TimeoutError where none comes in time."""
    while True:
        message = json.loads(browser.recv(timeout=timeout_s))
        if message.get("type") != "framebufferdata":
            continue
        data = browser.recv(timeout=PATIENCE_S)
        assert isinstance(data, bytes)
        shown = {"index": message["index"], "timestamp": message["timestamp"], "localtime": 0.0}
        browser.send(json.dumps({"type": "_framefeedback", **shown}))
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)
