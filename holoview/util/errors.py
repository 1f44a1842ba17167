"""The exception for a user's mistake, and suggestions of similar words for its message.

Every message answers four questions in one line: where the mistake is, what was found there, what was expected, and
what to do about it. The command line prints the message and exits with code 2; Python code catches `UserError`.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from functools import partial
from typing import Any, Self

from holoview.util.text import printable

_LONGEST = 4000  # characters of a part of a message; names and values in it come from files


class UserError(ValueError):
    """A mistake that the user can correct: a wrong file, key or value, or a device that is missing.

    where: the file, key or argument, "" when there is none to name.
    found: the mistake there.
    expected: the right content.
    remedy: an action of the user that helps.

    The message joins them: "where: found; expected …; remedy", in one line that is safe to show (`printable`), since
    they may quote a file. All four are attributes of the exception, which is a ValueError and can be pickled.

    >>> import holoview as hv
    >>> try:
    ...     hv.load("holochrome-8").with_(gap="2 kg")
    ... except hv.UserError as error:
    ...     print(error.where, "|", error.found)
    gap | "2 kg" has the unit "kg"
    """

    def __init__(self, where: str, found: str, *, expected: str = "", remedy: str = "") -> None:
        self.where, self.found, self.expected, self.remedy = where, found, expected, remedy
        parts = [f"{_cut(where)}: {_cut(found)}" if where else _cut(found)]
        if expected:
            parts.append(f"expected {_cut(expected)}")
        if remedy:
            parts.append(_cut(remedy))
        super().__init__(printable("; ".join(parts)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickling, so that the exception can be passed between processes."""
        return partial(type(self), expected=self.expected, remedy=self.remedy), (self.where, self.found)

    def inside(self, outer: str) -> Self:
        """The same mistake with a longer description of its place.

        outer: the text before `where`, with its own punctuation.

        >>> import holoview as hv
        >>> hv.UserError("gap", "is missing").inside("bench.toml: ").where
        'bench.toml: gap'
        """
        return type(self)(outer + self.where, self.found, expected=self.expected, remedy=self.remedy)


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} …"


def suggest_matches(word: str, known: Iterable[str]) -> str:
    """A remedy for an unknown word: "did you mean …?" with up to three similar words, else the list of all words."""
    options = sorted(known)
    near = get_close_matches(word, options, n=3, cutoff=0.5)
    return f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(options)}"
