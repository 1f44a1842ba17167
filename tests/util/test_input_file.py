"""Only regular files are read: whatever else a name leads to is refused at once."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from holoview.util.errors import UserError
from holoview.util.files import TEXT_LIMIT, read_bytes, read_text, require_file


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes in folders")
@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda path: None, "no such file"),
        (Path.mkdir, "is a folder"),
        (os.mkfifo if hasattr(os, "mkfifo") else None, "is a pipe"),
        (_socket, "is a socket"),
        (lambda path: path.symlink_to("/dev/zero"), "is a device"),
        (lambda path: path.symlink_to(path.name), "can't be read"),
        (lambda path: path.symlink_to("nothing"), "no such file"),
    ],
)
@pytest.mark.parametrize("read", [require_file, read_bytes, read_text])
def test_what_isnt_a_file_is_refused(
    make: Callable[[Path], object], found: str, read: Callable[[Path, str], object], tmp_path: Path
) -> None:
    make(tmp_path / "f")
    with pytest.raises(UserError, match=f"f: {found}"):
        read(tmp_path / "f", "a file")


@pytest.mark.parametrize(("name", "found"), [("a\0b", "isn't the name of a file"), ("a" * 5000, "can't be read")])
def test_impossible_names_are_refused(name: str, found: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=found):
        read_text(tmp_path / name, "a file")


def test_text_is_utf_8_of_a_limited_size(tmp_path: Path) -> None:
    path = tmp_path / "f"
    path.write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n")
    assert read_text(path, "text") == "a\nb\nc\n"
    path.write_bytes(b"\xff")
    with pytest.raises(UserError, match="can't be read: 'utf-8'"):
        read_text(path, "text")
    path.write_bytes(b"a" * (TEXT_LIMIT + 1))
    with pytest.raises(UserError, match="more than 4 MiB"):
        read_text(path, "text")
    assert read_bytes(path, "text", most=3) == b"aaa"
