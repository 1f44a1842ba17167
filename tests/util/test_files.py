"""Folders: of what is shipped, of caches, of the user."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from holoview.util.files import cache_dir, data_dir, expand_home


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
