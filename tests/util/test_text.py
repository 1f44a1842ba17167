"""Text from files: whatever it is, one line that shows and does nothing else, and a name that stays in its folder."""

from __future__ import annotations

import json
import tomllib
import unicodedata
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from holoview.util.text import plain_name, printable, printable_lines

ANY_TEXT = st.text(st.characters(codec=None), max_size=300)  # surrogates too
HOSTILE = [
    "../../x",
    "/etc/passwd",
    "C:\\a",
    "a/b",
    "..",
    ".",
    "",
    "\0",
    "-rf",
    "~/a",
    ".bashrc",
    "CON",
    "nul.png",
    "a\n",
]
HOSTILE += ["\x1b[31mred\x1b]0;title\x07", "\u202egnp.exe", "x" * 5000, "日" * 500, "\udcff", "a " * 300, "lpt1."]
ACTS = {"Cc", "Cs", "Co", "Cn", "Zl", "Zp"}  # categories of what a terminal acts on, or nobody sees


@settings(deadline=None, derandomize=True)
@given(ANY_TEXT)
def test_what_is_shown_is_one_line_that_no_terminal_acts_on(text: str) -> None:
    shown = printable(text)
    categories = {unicodedata.category(c) for c in shown}
    assert not categories & ACTS and len(shown.splitlines()) <= 1
    assert not {c for c in shown if unicodedata.category(c) == "Cf"} - {"\u200c", "\u200d"}
    assert printable(shown) == shown


@settings(deadline=None, derandomize=True)
@given(ANY_TEXT)
def test_lines_stay_lines(text: str) -> None:
    assert printable_lines(text).split("\n") == [printable(line) for line in text.split("\n")]


@pytest.mark.parametrize("text", ["HoloChrome, 8 wavelengths", "größe 8 µm ± 2 %", "日本語 ω", "é", "a  b"])
def test_text_of_people_is_as_it_was(text: str) -> None:
    assert printable(text) == text


def test_escapes_mean_the_same_in_json_and_toml() -> None:
    raw = "a\u202eb\x9bc"
    shown = printable(raw)
    assert json.loads(f'"{shown}"') == tomllib.loads(f'a = "{shown}"')["a"] == raw


@settings(deadline=None, derandomize=True)
@given(ANY_TEXT)
@example("../../x")
def test_a_name_from_a_file_is_a_file_in_the_folder_where_it_is_wanted(text: str) -> None:
    _assert_plain(plain_name(text, "bench"))


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_names_are_plain_files_that_can_be_made(text: str, tmp_path: Path) -> None:
    name = plain_name(text, "bench")
    _assert_plain(name)
    (tmp_path / f"{name}-10mm.safetensors").touch()
    assert [path.parent for path in tmp_path.rglob("*")] == [tmp_path]


def _assert_plain(name: str) -> None:
    assert name and Path(name).name == name and not set(name) & set("/\\:*?\"<>|\0$`;&!'")
    assert name[0] not in ".- ~" and name[-1] not in ". " and printable(name) == name
    assert len(name.encode()) <= 121 and any(c.isalnum() for c in name)
    assert name.split(".")[0].lower() not in {"con", "prn", "aux", "nul", "com1", "lpt1"}
    assert plain_name(name, "bench") == name


@pytest.mark.parametrize("name", ["holochrome-8", "holochrome-8+1slm", "bench (mine), v1.2", "Größe 8 µm"])
def test_plain_names_stay(name: str) -> None:
    assert plain_name(name, "bench") == name
