"""A program that a test starts, and that never outlives it."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def child_process(command: list[Any], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """`subprocess.Popen`, which waits for the program's end; if the test fails first, the program is killed.

    Popen alone would wait for ever, and the failure would never be told.
    """
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        except BaseException:
            process.kill()
            raise
