"""Folders: of what is shipped, of caches, of the user."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from holoview.util.errors import UserError
from holoview.util.files import TEXT_LIMIT, cache_dir, data_dir, expand_home, read_bytes, read_text, require_file


def test_product_data_are_found_in_this_checkout() -> None:
    assert (data_dir("presets") / "holochrome-8.toml").is_file()


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="elsewhere no variable decides")
def test_the_folder_for_caches_is_where_the_user_has_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_dir() == tmp_path / "holoview"
    monkeypatch.setenv("XDG_CACHE_HOME", "not/absolute")
    assert cache_dir() == Path.home() / ".cache" / "holoview"


def test_a_home_folder_is_found_and_that_of_an_unknown_user_is_a_name_like_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for variable in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(variable, str(tmp_path))
    assert expand_home("~/a.png") == tmp_path / "a.png"
    assert expand_home("~no-such-user/a.png") == Path("~no-such-user/a.png")
    assert expand_home(Path("b/~")) == Path("b/~")


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
