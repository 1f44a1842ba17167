"""Links of the manual lead to files and headings, on a repository's page as on the site; tables are tables on both."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs._hooks.links import anchors_of, links_of, mistakes, slugify
from docs._hooks.repository import ROOT, page_of, rewritten

PAGES = [path for name in ("*.md", "docs/**/*.md", "assets/*.md", "benchmarks/*.md") for path in ROOT.glob(name)]


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    assert mistakes(page, ROOT) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_blank_line_stands_before_each_table(page: Path) -> None:
    """Else the site takes the table for text of the paragraph before; a repository's page doesn't."""
    lines = page.read_text(encoding="utf-8").splitlines()
    rules = [i for i, line in enumerate(lines) if re.fullmatch(r"\|(\s*:?-{3,}:?\s*\|)+", line)]
    assert [f"line {i}" for i in rules if i >= 2 and lines[i - 2].strip()] == []


def test_mistakes_are_told(tmp_path: Path) -> None:
    (tmp_path / "other.md").write_text("# A heading, *twice*\n## A heading, *twice*\n", encoding="utf-8")
    page = tmp_path / "page.md"
    good = (
        "[a](other.md#a-heading-twice-1) ![b](other.md) [c](https://example.org/x) `[d](none.md)` [e](#here)\n# Here\n"
    )
    page.write_text(good, encoding="utf-8")
    assert mistakes(page, tmp_path) == []
    page.write_text("\n[a](none.md)\n[b](other.md#none) [c](https://localhost) [d](../x.md)\n", encoding="utf-8")
    assert [wrong.partition(" ")[0] for wrong in mistakes(page, tmp_path)] == ["page.md:2:", *["page.md:3:"] * 3]


def test_code_holds_no_links_and_no_headings() -> None:
    text = "```sh\n# no heading\n[x](none.md)\n```\n<!-- [y](none.md) -->\n# One `two` [three](here.md)\n"
    assert [link.target for link in links_of(text)] == ["here.md"]
    assert anchors_of(text) == {"one-two-three"}


@pytest.mark.parametrize(
    ("heading", "anchor"), [("Étendue, in mm²", "étendue-in-mm²"), ("JSON", "json"), ("A – b", "a--b")]
)
def test_anchors_are_those_of_repository_pages(heading: str, anchor: str) -> None:
    assert slugify(heading) == anchor


def test_links_that_leave_docs_lead_to_pages_of_the_site() -> None:
    text = (
        "[a](../README.md) [b](../assets/README.md#x) [c](effects.md#write-your-own) [d](../presets/holochrome-8.toml)"
    )
    assert rewritten(text, "physics.md") == (
        "[a](index.md) [b](repository/assets/README.md#x) [c](effects.md#write-your-own) "
        "[d](repository/presets/holochrome-8.toml.md)"
    )
    assert rewritten("[a](docs/captures.md) ![b](docs/images/viewer.jpg)", "index.md") == (
        "[a](captures.md) ![b](images/viewer.jpg)"
    )
    assert page_of("holoview/__init__.py") == "reference/modules/holoview/index.md"
