"""Text that came from a file, as a line to show and as the name of a file."""

from __future__ import annotations

import re
import unicodedata

_JOINERS = "\u200c\u200d"  # of Persian and Indian scripts: invisible, and terminals do nothing with them
_BREAKS = re.compile(r"[\s\x1c-\x1f\x85\u2028\u2029]+")
_IN_NAMES = frozenset("._-+=,@() ")
_NOT_AT_START = " .-"  # hidden files; options of commands
_NOT_AT_END = " .-"  # Windows drops spaces and dots
_OF_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)  # on Windows, with any suffix
_MAX_NAME_BYTES = 120  # of 255, so that a suffix and the number of a file have room
_MAX_READ = 1000  # characters of a text of which a name is made


def printable(text: str) -> str:
    r"""The text as one line that does nothing but show: for names, titles and descriptions that came from a file.

    Line breaks become spaces. Everything but visible characters (terminal escapes and other control characters, marks
    that change the direction of writing, halves of surrogate pairs) is written as \u001b, as in JSON and TOML.

    >>> printable("\x1b[31mred\x07")
    '\\u001b[31mred\\u0007'
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(map(_visible, _BREAKS.sub(_space_of, text)))


def printable_lines(text: str) -> str:
    """`printable` of each line; the ends of lines stay."""
    return "\n".join(map(printable, text.split("\n")))


def plain_name(text: str, fallback: str) -> str:
    """A file name without suffix, made of letters, digits and a few signs, with no folder and no special meaning.

    fallback: the name if nothing is left.

    >>> plain_name("../../etc/passwd", "bench"), plain_name("..", "bench"), plain_name("Größe 8 µm", "bench")
    ('etc-passwd', 'bench', 'Größe 8 µm')
    """
    kept = "".join(c if _is_in_names(c) else "-" for c in unicodedata.normalize("NFC", text[:_MAX_READ]))
    name = "".join("-" if "-" in part else part for part in re.split(r"([- ]+)", kept)).lstrip(_NOT_AT_START)
    name = name.encode("utf-8")[:_MAX_NAME_BYTES].decode("utf-8", "ignore").rstrip(_NOT_AT_END)
    if not any(c.isalnum() for c in name):
        return fallback
    return f"_{name}" if _OF_DEVICES.match(name) else name


def _is_in_names(c: str) -> bool:
    return c.isalnum() or c in _IN_NAMES or unicodedata.category(c) in ("Mn", "Mc")


def _space_of(match: re.Match[str]) -> str:
    """Spaces stay as they are; a break is one space, whatever surrounds it."""
    found = match[0]
    return found if all(c == " " or unicodedata.category(c) == "Zs" for c in found) else " "


def _visible(c: str) -> str:
    if c.isprintable() or c in _JOINERS or unicodedata.category(c) == "Zs":
        return c
    return f"\\u{ord(c):04x}" if ord(c) < 0x10000 else f"\\U{ord(c):08x}"
