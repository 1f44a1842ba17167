"""One page of the manual is built into the site that is there: as in the whole, and nothing else is touched."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mkdocs")

from mkdocs.config import load_config

from docs._hooks import one_page
from docs._hooks.repository import ROOT

PAGE = "docs/viewer.md"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A site of two pages and a search index, in place of that of the repository."""
    folder = tmp_path / "site"
    (folder / "search").mkdir(parents=True)
    for name in ("index.html", "eye.html", "viewer.html", "search/search_index.json"):
        (folder / name).write_text("as it was")
    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder))
    monkeypatch.setattr(one_page, "load_config", lambda path: config)
    return folder


def test_one_page_is_built_and_all_others_stay(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert one_page.main(str(ROOT / PAGE)) == 0
    html = (site / "viewer.html").read_text(encoding="utf-8")
    for heading in ("The viewer", "What is where", "Keys"):  # as in docs/viewer.md
        assert heading in html
    assert 'href="eye.html' in html and '.md"' not in html  # links are those of the site
    for name in ("index.html", "eye.html", "search/search_index.json"):
        assert (site / name).read_text() == "as it was", name
    assert "viewer.html: built in" in capsys.readouterr().out


def test_the_start_of_the_manual_is_the_readme(site: Path) -> None:
    assert one_page.main(str(ROOT / "README.md")) == 0
    assert "<iframe" in (site / "index.html").read_text(encoding="utf-8")  # with its live hologram
    assert (site / "viewer.html").read_text() == "as it was"


def test_a_broken_link_and_a_name_that_is_no_page_are_refused(
    site: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert one_page.main(str(ROOT / "docs/nix.md")) == 2
    assert one_page.main(str(ROOT / "Makefile")) == 2
    monkeypatch.setattr(one_page.links, "mistakes", lambda page, root: [f"{page.name}: nix.md isn't there"])
    assert one_page.main(str(ROOT / PAGE)) == 1
    assert "nix.md isn't there" in capsys.readouterr().err
    assert (site / "viewer.html").read_text() == "as it was"
