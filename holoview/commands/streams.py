"""Standard output and error while a command runs: nothing acts on the terminal, and no failure ends the work.

What a command prints may quote a file; it is made `printable`. A reader that has gone (`| head -1`), a terminal that
was closed or a full disk behind a redirection doesn't end a computation: what follows is dropped.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from holoview.util.text import printable_lines


class SafeStream:
    """A text stream that never raises. error: why it took no more, None while all went well."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream
        self.error: OSError | None = None

    def write(self, text: str) -> int:
        """Writes a text, or drops it where that has failed."""
        self._attempt("write", text)
        return len(text)

    def flush(self) -> None:
        """Passes on what was written."""
        self._attempt("flush")

    def isatty(self) -> bool:
        """Whether it is a terminal that still takes text."""
        with suppress(OSError, ValueError):
            return self._stream is not None and self.error is None and self._stream.isatty()
        return False

    def _attempt(self, method: str, *arguments: str) -> None:
        if self._stream is None or self.error is not None:
            return
        try:
            getattr(self._stream, method)(*arguments)
        except OSError as error:
            self.error = error
            self._discard_rest()
        except ValueError as error:  # it was closed
            self.error = OSError(errno.EBADF, str(error))

    def _discard_rest(self) -> None:
        """Leads the stream to nowhere, so that Python's flush at exit doesn't fail again."""
        assert self._stream is not None
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class PrintableStream(SafeStream):
    """A `SafeStream`, `safe`, to which every line is passed as `printable`."""

    def __init__(self, safe: SafeStream) -> None:
        super().__init__(safe)  # type: ignore[arg-type]
        self.safe = safe

    def write(self, text: str) -> int:
        """Writes the text with everything but its ends of lines made printable."""
        self.safe.write(printable_lines(text))
        return len(text)


@contextmanager
def console_streams() -> Iterator[tuple[SafeStream, SafeStream]]:
    """Makes standard output and error safe and printable in the block; yields the safe streams."""
    before = sys.stdout, sys.stderr
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # "étendue" on a terminal that has no é
    safe = SafeStream(sys.stdout), SafeStream(sys.stderr)
    sys.stdout, sys.stderr = (PrintableStream(stream) for stream in safe)
    try:
        yield safe
    finally:
        for stream in safe:
            stream.flush()
        sys.stdout, sys.stderr = before


def raw_stderr() -> Any:
    """Standard error for what moves the cursor itself, such as a progress bar."""
    return sys.stderr.safe if isinstance(sys.stderr, PrintableStream) else sys.stderr
