"""A viewer that is served by a process of its own, for the tests of the connection and of the page."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SECONDS = 60


@contextmanager
def serving(folder: Path, *options: str) -> Iterator[tuple[str, str]]:
    """HOST:PORT and token of `holoview view --serve`; its state lies in `folder`. It ends in good order."""
    command = [sys.executable, "-m", "holoview.cli", "view", "--serve", "127.0.0.1:0", "--set", "shape=[32, 48]"]
    folders = {key: str(folder) for key in ("XDG_STATE_HOME", "XDG_CACHE_HOME")}
    process = subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ | folders
    )
    assert process.stdout is not None
    try:
        said = ""
        for line in process.stdout:
            said += line
            if found := re.search(r"http://(\S+)/\?token=(\S+)", line):
                yield found[1], found[2]
                break
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=SECONDS)
        assert process.returncode == 0 and "Traceback" not in rest, said + rest
    finally:
        process.kill()
        process.communicate()
