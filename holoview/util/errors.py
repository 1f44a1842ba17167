"""The one exception for a user's mistake, and how it reads.

Every message answers four questions in one line: where it is, what was found, what was expected, what to do.
The command line prints it and exits with code 2; Python callers catch `UserError`.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from functools import partial
from typing import Any


class UserError(ValueError):
    """A mistake in the input that the user can mend: a file, a key, a value, a missing device."""

    def __init__(self, where: str, found: str, *, expected: str = "", remedy: str = "") -> None:
        self.where, self.found, self.expected, self.remedy = where, found, expected, remedy
        parts = [f"{where}: {found}" if where else found]
        if expected:
            parts.append(f"expected {expected}")
        if remedy:
            parts.append(remedy)
        super().__init__("; ".join(parts))

    def __reduce__(self) -> tuple[Any, ...]:
        """How it passes from one process to another."""
        return partial(UserError, expected=self.expected, remedy=self.remedy), (self.where, self.found)

    def inside(self, outer: str) -> UserError:
        """The same mistake, located from further out: "gap" inside "bench.toml: " is "bench.toml: gap"."""
        return UserError(outer + self.where, self.found, expected=self.expected, remedy=self.remedy)


def suggest_matches(word: str, known: Iterable[str]) -> str:
    """A remedy that names the known words nearest to `word`, or all of them when none is near."""
    options = sorted(known)
    near = get_close_matches(word, options, n=3, cutoff=0.5)
    return f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(options)}"
