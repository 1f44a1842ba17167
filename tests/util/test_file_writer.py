"""Writing files: whole or not at all, whatever a disk refuses, and always the same kind of error."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from typing import Any, NoReturn

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from holoview.util import file_writer
from holoview.util.errors import UserError
from holoview.util.file_writer import WriteError, check_writable, make_folder, save_elsewhere, write_file
from tests.file_limits import limit_of_file_size

posix = pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions and limits")
_SETTINGS = settings(
    deadline=None,
    max_examples=50,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
REFUSALS = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.EACCES, errno.ESTALE, errno.ENODEV)


def test_a_finished_write_replaces_the_old_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "result.toml"
    target.write_text("old")
    write_file(target, "µ")
    assert target.read_bytes() == "µ".encode()
    write_file(target, b"new")
    assert target.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [target]


@posix
@given(st.integers(0, 5000), st.integers(0, 5000), st.booleans())
@_SETTINGS
def test_on_a_disk_that_fills_the_file_is_the_old_or_the_new_one(
    tmp_path: Path, room: int, size: int, has_names: bool
) -> None:
    target = tmp_path / "result.bin"
    target.write_bytes(b"old")
    with pytest.MonkeyPatch.context() as patch, limit_of_file_size(room):
        if has_names:  # as where the file system has no files without a name
            patch.delattr(os, "O_TMPFILE", raising=False)
        try:
            write_file(target, b"x" * size)
            is_written = True
        except WriteError as error:
            is_written = False
            assert str(target) in str(error) and "can't be written" in str(error) and "free" in error.remedy
    assert is_written == (size <= room)
    assert target.read_bytes() == (b"x" * size if is_written else b"old")
    assert list(tmp_path.iterdir()) == [target]


@given(st.sampled_from(["open", "fsync", "link", "fdopen"]), st.sampled_from(REFUSALS), st.booleans())
@_SETTINGS
def test_whatever_the_system_refuses_is_one_kind_of_error(
    tmp_path: Path, call: str, code: int, has_names: bool
) -> None:
    target = tmp_path / "result.bin"
    target.write_bytes(b"old")

    def refuse(*_: Any, **__: Any) -> NoReturn:
        raise OSError(code, os.strerror(code))

    with pytest.MonkeyPatch.context() as patch:
        if has_names:
            patch.delattr(os, "O_TMPFILE", raising=False)
        patch.setattr(os, call, refuse)
        try:
            write_file(target, b"new")
        except WriteError as error:
            assert os.strerror(code) in str(error)
        patch.undo()
    assert target.read_bytes() in (b"old", b"new")
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("error", [RuntimeError("bug"), KeyboardInterrupt()])
@pytest.mark.parametrize("has_names", [True, False])
def test_another_exception_passes_and_leaves_the_old_file_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, has_names: bool
) -> None:
    target = tmp_path / "result.toml"
    target.write_text("old")

    def fail(*_: Any) -> NoReturn:
        raise error

    if has_names:
        monkeypatch.delattr(os, "O_TMPFILE", raising=False)
    monkeypatch.setattr(file_writer, "_fsync", fail)
    with pytest.raises(type(error)) as caught:
        write_file(target, "new")
    assert caught.value is error and target.read_text() == "old" and list(tmp_path.iterdir()) == [target]


def test_what_file_systems_lack_is_no_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unsupported(*_: Any, **__: Any) -> NoReturn:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(os, "fsync", unsupported)
    monkeypatch.setattr(os, "link", unsupported)
    write_file(tmp_path / "a", b"new")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("a", b"new")]


IMPOSSIBLE = [
    ("nowhere/result.toml", "nowhere doesn't exist; create it"),
    ("file/result.toml", "file"),
    ("", "is a folder; expected the name of a file"),
    ("x" * 300, "too long"),
    ("a\0b", "null byte"),
    ("pipe", "is a device or a pipe"),
    ("hanging/gone", "hanging"),
]


@posix
@pytest.mark.parametrize(("name", "found"), IMPOSSIBLE, ids=lambda v: v[:20].replace("\0", "NUL"))
def test_what_can_t_be_written_is_known_before_and_after(tmp_path: Path, name: str, found: str) -> None:
    (tmp_path / "file").write_text("old")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "hanging").symlink_to(tmp_path / "gone")
    before = sorted(tmp_path.rglob("*"))
    for write in (check_writable, lambda path: write_file(path, b"new")):
        with pytest.raises(WriteError, match=found):
            write(f"{tmp_path}/{name}")
    assert sorted(tmp_path.rglob("*")) == before and (tmp_path / "file").read_text() == "old"


@posix
def test_a_file_that_is_protected_isn_t_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"mine")
    path.chmod(0o444)
    if os.access(path, os.W_OK):  # the superuser may write everything
        monkeypatch.setattr(os, "access", lambda file, mode: False)
    with pytest.raises(WriteError, match="write-protected"):
        check_writable(path)


def test_a_longest_name_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 251 + ".png")
    check_writable(path)
    write_file(path, b"new")
    assert list(tmp_path.iterdir()) == [path]


@posix
def test_a_link_is_followed_and_stays(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "disk" / "file")
    for content in (b"1", b"2"):
        write_file(tmp_path / "link", content)
        assert (tmp_path / "link").is_symlink() and (tmp_path / "disk" / "file").read_bytes() == content


@posix
@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
@pytest.mark.parametrize("has_names", [True, False])
def test_a_new_file_has_the_permissions_that_the_umask_leaves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, umask: int, has_names: bool
) -> None:
    if has_names:
        monkeypatch.delattr(os, "O_TMPFILE", raising=False)
    before = os.umask(umask)
    try:
        write_file(tmp_path / "result.toml", "new")
        during = os.umask(umask)
    finally:
        os.umask(before)
    assert (tmp_path / "result.toml").stat().st_mode & 0o777 == 0o666 & ~umask
    assert during == umask  # and the process's umask is as it was


def test_a_folder_is_made_or_refused(tmp_path: Path) -> None:
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir() and not list((tmp_path / "a" / "b").iterdir())
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "x", tmp_path / ("x" * 300)):
        with pytest.raises(WriteError, match="can't be made"):
            make_folder(path)


def test_what_can_t_be_written_is_kept_elsewhere_and_overwrites_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    present, home = tmp_path / "present", tmp_path / "home"
    for folder in (present, home):
        folder.mkdir()
        (folder / "a.png").write_bytes(b"mine")
    monkeypatch.chdir(present)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("USERPROFILE", str(home))
    assert save_elsewhere(tmp_path / "full" / "a.png", lambda path: write_file(path, b"new")) == present / "a-2.png"

    def refuse_present(path: Path) -> None:
        if path.parent == present:
            raise WriteError(str(path), "can't be written: No space left on device")
        write_file(path, b"new")

    assert save_elsewhere(Path("a.png"), lambda path: write_file(path, b"new")) == home / "a-2.png"
    assert save_elsewhere(tmp_path / "full" / "a.png", refuse_present) == home / "a-3.png"
    assert (present / "a.png").read_bytes() == (home / "a.png").read_bytes() == b"mine"

    def refuse_all(path: Path) -> None:
        raise WriteError(str(path), "no")

    assert save_elsewhere(tmp_path / "a.png", refuse_all) is None


def test_the_error_is_a_user_s_and_can_be_sent_between_processes() -> None:
    import pickle

    error = pickle.loads(pickle.dumps(WriteError("a", "can't be written: full", remedy="free space")))
    assert isinstance(error, WriteError) and isinstance(error, UserError)
    assert str(error) == "a: can't be written: full; free space"
