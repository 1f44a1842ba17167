"""Writing results: whole or not at all, with the permissions that a plain write would give."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from holoview.util.errors import UserError
from holoview.util.files import atomic_write, cache_dir, data_dir, expand_home


def _write(path: Path, text: str) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(text)


def test_a_finished_write_replaces_the_old_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "result.toml"
    target.write_text("old")
    _write(target, "new")
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_the_old_file_is_whole_until_the_write_has_finished(tmp_path: Path) -> None:
    target = tmp_path / "result.toml"
    target.write_text("old")
    with atomic_write(target) as temporary:
        temporary.write_text("half")
        assert target.read_text() == "old"
        assert temporary.parent == tmp_path  # same file system, so that the rename is atomic


@pytest.mark.parametrize("error", [RuntimeError("bug"), KeyboardInterrupt(), UserError("x", "y")])
def test_an_exception_passes_leaves_the_old_file_whole_and_no_temporary(tmp_path: Path, error: BaseException) -> None:
    target = tmp_path / "result.toml"
    target.write_text("old")
    with pytest.raises(type(error)) as caught, atomic_write(target) as temporary:
        temporary.write_text("half")
        raise error
    assert caught.value is error
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_full_disk_is_a_users_error_and_leaves_the_old_file_whole(tmp_path: Path) -> None:
    target = tmp_path / "result.toml"
    target.write_text("old")
    with pytest.raises(UserError, match=r"writing failed.*No space left"), atomic_write(target) as temporary:
        temporary.write_text("half")
        raise OSError(28, "No space left on device")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_the_temporary_keeps_the_suffix_that_writers_choose_a_format_by(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "view.png") as temporary:
        assert temporary.suffix == ".png"


def test_a_missing_folder_is_a_users_error_that_names_it(tmp_path: Path) -> None:
    missing = tmp_path / "nowhere"
    with pytest.raises(UserError, match="nowhere doesn't exist; create it"):
        _write(missing / "result.toml", "new")
    assert not missing.exists()


def test_a_folder_that_is_really_a_file_is_a_users_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    with pytest.raises(UserError, match="file"):
        _write(tmp_path / "file" / "result.toml", "new")
    assert (tmp_path / "file").read_text() == "old"


def test_writing_onto_a_folder_is_a_users_error(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is a folder; expected the name of a file"):
        _write(tmp_path, "new")


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_a_new_file_has_the_permissions_that_the_umask_leaves(tmp_path: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        _write(tmp_path / "result.toml", "new")
        during = os.umask(umask)
    finally:
        os.umask(before)
    assert (tmp_path / "result.toml").stat().st_mode & 0o777 == 0o666 & ~umask
    assert during == umask  # and the process's umask is as it was


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
