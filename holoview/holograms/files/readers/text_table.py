"""Tables of numbers as text, one row a line, separated by spaces, tabs, commas or semicolons.

Numbers may have decimal points or decimal commas (`holoview.util.number_text`), and may be complex ("0.5+0.3i").
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, StoredArray
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.files import read_bytes
from holoview.util.memory_limit import require_memory
from holoview.util.number_text import NumberLayout, find_layout

_BYTES_A_CHARACTER = 40  # of words as Python objects, at the peak
_MOST_HEADER_LINES = 40
_JUDGED_LINES = 200  # by which separators are recognised
_LEAST_COLUMNS = 3
_MOST_IN_LISTS = 5
_LONGEST_WORD = 100
_LEAST_COUNTED = 8  # numbers in a row that count
_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))
_CONTROLS = re.compile(r"[\x00-\x08\x0e-\x1f\x7f-\x9f]")
_BETWEEN = re.compile(r"[\s,;]+")


class TextReader:
    """A table of at least three columns; lines before the first row of numbers are left out."""

    name = "text table"
    suffixes = (".txt", ".csv", ".dat", ".asc")

    def recognises(self, head: bytes) -> bool:
        """Whether it is text with a row of numbers in one of its first lines."""
        text = _decoded(head)
        if text is None:
            return False
        return any(_begins_with_numbers(line) for line in text.splitlines()[:_MOST_HEADER_LINES])

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The table as float64 or complex128."""
        require_memory(str(path), _BYTES_A_CHARACTER * path.stat().st_size)
        lines = (_decoded(read_bytes(path, "a table of numbers")) or "").splitlines()
        first = next((number for number, line in enumerate(lines) if _begins_with_numbers(line)), 0)
        table = [line.strip() for line in lines[first:] if not line.lstrip().startswith(("#", "%"))]
        _check_blocks(path, table)
        table = [line for line in table if line]
        layout = find_layout(table[:_JUDGED_LINES], str(path))
        values = _values(_rows(path, table, layout))
        _check_is_picture(path, values)
        values, counted = _without_counts(values)
        notes: tuple[str, ...] = ()
        if first:
            notes = (f"the first {'line is' if first == 1 else f'{first} lines are'} left out",)
        notes += counted
        if layout.has_decimal_commas:
            notes += ("its commas are taken as decimal signs",)
        yield Contents.of([StoredArray.of("", values)], notes=notes)


def _decoded(data: bytes) -> str | None:
    """The text that the bytes are, by their byte order mark, else UTF-8 or Latin-1; None for other data."""
    mark, encoding = next(((m, e) for m, e in _MARKS if data.startswith(m)), (b"", "utf-8"))
    content = data[len(mark) :]
    if encoding == "utf-8":
        try:
            text = content.decode()
        except UnicodeDecodeError:
            text = content.decode("latin-1")  # a unit such as µm in the header, or a character cut at the end
    else:
        text = content[: len(content) // 2 * 2].decode(encoding, "replace")
    return None if _CONTROLS.search(text) else text


def _begins_with_numbers(line: str) -> bool:
    """Whether the first three words, whatever separates them, are numbers."""
    words = _BETWEEN.split(line.strip(), maxsplit=_LEAST_COLUMNS)[:_LEAST_COLUMNS]
    return len(words) == _LEAST_COLUMNS and all(_number(word) is not None for word in words)


def _number(word: str) -> complex | None:
    if len(word) > _LONGEST_WORD:
        return None
    try:
        return complex(word.strip("()").replace("i", "j") if word[-1:] in "ij)" else word)
    except ValueError:
        return None


def _check_blocks(path: Path, lines: Sequence[str]) -> None:
    """Raises UserError for several tables one below the other; empty lines between all rows separate nothing."""
    blocks = [len(list(group)) for is_row, group in groupby(lines, key=bool) if is_row]
    if len(blocks) > 1 and max(blocks) > 1:
        found = f"holds {len(blocks)} tables of {' and '.join(map(str, sorted(set(blocks))))} rows, with empty lines"
        remedy = "save each in a file of its own; name them together, with --parts"
        raise UserError(str(path), found, expected="one table", remedy=remedy)


def _rows(path: Path, lines: Sequence[str], layout: NumberLayout) -> list[list[str]]:
    """The words of each row. Raises UserError for rows of several lengths, and for empty cells."""
    rows = []
    for number, line in enumerate(lines, start=1):
        row = layout.words(line)
        if "" in row:
            found = f"the cell in row {number}, column {row.index('') + 1} is empty"
            raise UserError(str(path), found, expected="a number in each cell")
        rows.append(row)
    widths = {len(row) for row in rows}
    if len(widths) != 1:
        found = f"rows of {min(widths)} to {max(widths)} numbers"
        raise UserError(str(path), found, expected="rows of one length")
    return rows


def _values(rows: list[list[str]]) -> NDArray[Any]:
    """The numbers (y, x). Raises ValueError for words that aren't numbers."""
    if max(len(word) for row in rows for word in row) <= _LONGEST_WORD:
        try:
            return np.array(rows, dtype=np.float64)
        except ValueError:
            pass  # complex numbers, or words
    return np.array([[_required_number(word) for word in row] for row in rows], dtype=np.complex128)


def _without_counts(values: NDArray[Any]) -> tuple[NDArray[Any], tuple[str, ...]]:
    """The table without a first row and a first column that count columns and rows, and remarks."""
    notes: tuple[str, ...] = ()
    for axis, name in ((0, "row"), (1, "column")):
        first, second = np.take(values, 0, axis), np.take(values, min(1, values.shape[axis] - 1), axis)
        counts = np.arange(len(first)) + first[0]
        is_count = len(first) >= _LEAST_COUNTED and first[0] in (0, 1) and np.array_equal(first, counts)
        if is_count and not np.array_equal(second, counts):
            values = np.delete(values, 0, axis)
            notes += (f"its first {name} counts from {int(first[0].real)}: it is left out",)
    return values, notes


def _check_is_picture(path: Path, values: NDArray[Any]) -> None:
    """Raises UserError for a list of places and values: two columns with each place of a grid once."""
    rows, columns = values.shape
    if columns > _MOST_IN_LISTS or rows < _LEAST_COLUMNS**2 or values.dtype.kind == "c":
        return
    along = [len(np.unique(values[:, axis])) for axis in (0, 1)]
    if min(along) >= _LEAST_COLUMNS and along[0] * along[1] == rows == len(np.unique(values[:, :2], axis=0)):
        found = f"is a list of the values at {along[0]} × {along[1]} places, one a line"
        raise UserError(str(path), found, expected="a table with a row of the picture in each line")


def _required_number(word: str) -> complex:
    number = _number(word)
    if number is None:
        raise ValueError(f'"{word[:24]}" is no number')
    return number
