"""Types of the functions that a long computation calls to report its progress, and one that reports nothing."""

from __future__ import annotations

from collections.abc import Callable

ProgressCallback = Callable[[int, int, str], None]
"""Called with the number of steps done, the number of steps in all, and a note of a few words."""

StepCallback = Callable[[int, int], None]
"""Called with the number of steps done and the number of steps in all."""

TextCallback = Callable[[str], None]
"""Called with a sentence that a user should read."""


def no_progress(done: int, total: int, note: str) -> None:
    """A `ProgressCallback` for computations that nobody watches."""


def no_text(text: str) -> None:
    """A `TextCallback` for computations that nobody watches."""
