"""The manual has three parts, use, understand, prove: the first two are short, the third has the measured tables."""

from __future__ import annotations

import re

import pytest

from docs._hooks.links import links_of
from docs._hooks.repository import ROOT

DOCS = ROOT / "docs"
PARTS = ("1 Use", "2 Understand", "3 Prove")
DEVELOPMENT = ["architecture.md"]
"""Pages beside the three parts, for people who change the code."""
MOST_WORDS = 30_000
"""Words of prose in the first two parts together; blocks of code and tables aren't prose."""
UNPICTURED = {"formats.md", "security.md", "tutorials/index.md", "rig.md"}
UNPICTURED |= {"speckle-contrast.md", "tutorials/from-a-vendors-table-to-a-preset.md"}
"""Pages of the first two parts that may do without a picture: lists, and pages whose results are sentences."""
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_TABLE = re.compile(r"(?:^\|.*\|$\n?)+", re.MULTILINE)
_INDENTED = re.compile(r"^ {4}.*$", re.MULTILINE)
_MEASURED = re.compile(r"\d ?(?:dB|ms)\b|\b(?:PSNR|seconds?)\b")


def _parts() -> dict[str, list[str]]:
    """The pages of each part, in the order of the navigation."""
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    sections = re.split(r"^  - (\w[^:\n]*):", nav, flags=re.MULTILINE)[1:]
    pages = {
        title: re.findall(r"(\S+\.md)$", text, re.MULTILINE)
        for title, text in zip(sections[::2], sections[1::2], strict=True)
    }
    return {title: pages[title] for title in PARTS}


PAGES = _parts()
SHORT = [*PAGES["1 Use"], *PAGES["2 Understand"]]


def _text(page: str) -> str:
    return _FENCE.sub("", (DOCS / page).read_text(encoding="utf-8"))


def prose_words(text: str) -> int:
    """Words outside blocks of code and tables."""
    return len(re.findall(r"\w[^\s|]*", _INDENTED.sub("", _TABLE.sub("", _FENCE.sub("", text)))))


def is_measured(table: str) -> bool:
    """Whether a table has measured results: decibels, PSNR, milliseconds or seconds in its head or most of its rows."""
    head, _, *rows = table.strip().split("\n")
    return bool(_MEASURED.search(head)) or 2 * sum(bool(_MEASURED.search(row)) for row in rows) > len(rows)


def test_each_page_is_in_one_part() -> None:
    listed = [page for pages in PAGES.values() for page in pages]
    assert tuple(PAGES) == PARTS
    assert sorted([*listed, *DEVELOPMENT]) == sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


def test_use_and_understand_are_short() -> None:
    assert sum(prose_words((DOCS / page).read_text(encoding="utf-8")) for page in SHORT) <= MOST_WORDS


@pytest.mark.parametrize("page", SHORT)
def test_measured_tables_stand_in_the_third_part(page: str) -> None:
    assert [table.split("\n")[0] for table in _TABLE.findall(_text(page)) if is_measured(table)] == []


@pytest.mark.parametrize("page", [page for page in SHORT if page not in UNPICTURED])
def test_each_page_shows_a_picture(page: str) -> None:
    assert any(link.target.endswith((".jpg", ".png", ".svg")) for link in links_of(_text(page)))


def test_words_and_measured_tables_are_recognised() -> None:
    assert (
        prose_words(
            "# One two\n\n| a | b |\n| - | - |\n| c | d |\n\nthree *four*, 5.5 dB\n\n    code\n\n```sh\nx y\n```\n"
        )
        == 6
    )
    assert is_measured("| a | gain |\n| - | - |\n| b | 3.1 dB |\n| c | 4 dB |\n| d | |\n")
    assert is_measured("| a | PSNR |\n| - | - |\n| b | 3.1 |\n")
    assert not is_measured("| option | |\n| - | - |\n| `psnr` | ends at so many dB |\n")
