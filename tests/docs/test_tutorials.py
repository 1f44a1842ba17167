"""Tutorials: every block of code runs, prints what the page shows, and draws its pictures."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs._hooks.tutorials import Tutorial, pages, working_in


@pytest.mark.explores
@pytest.mark.parametrize("page", pages(), ids=lambda path: path.stem)
def test_does_what_it_shows(page: Path, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if request.config.getoption("reseed") or request.config.getoption("other_noise"):
        pytest.skip("the page shows the numbers of its own seeds")
    tutorial = Tutorial.read(page)
    if "--offscreen" in tutorial.text:
        request.getfixturevalue("device")  # the viewer needs an adapter
    with working_in(tmp_path):
        tutorial.run()
        assert tutorial.mistakes() == []


def _run(tmp_path: Path, text: str) -> Tutorial:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    tutorial = Tutorial.read(page)
    with working_in(tmp_path):
        tutorial.run()
    return tutorial


@pytest.mark.parametrize("shown", ["1.00 of 3 dB", "1.01 of 3 dB", "…", "1.00 of 3 dB\n…"])
def test_numbers_may_be_a_little_off(tmp_path: Path, shown: str) -> None:
    tutorial = _run(tmp_path, f"```python\nprint('1.00 of 3 dB')\n```\n\n```text\n{shown}\n```\n")
    assert tutorial.mistakes() == []


@pytest.mark.parametrize("shown", ["1.10 of 3 dB", "1.00 of 4 dB", "1.00 of 3 m", "1.00 of 3 dB\n2", "…\n2"])
def test_what_differs_is_told(tmp_path: Path, shown: str) -> None:
    tutorial = _run(tmp_path, f"```python\nprint('1.00 of 3 dB')\n```\n\n```text\n{shown}\n```\n")
    assert len(tutorial.mistakes()) == 1


def test_a_page_is_brought_up_to_date(tmp_path: Path) -> None:
    code = "```python\nprint('first')\nprint('value 2.0')\nprint('last')\n```\n\n"
    assert _run(tmp_path, code + "```text\n```\n").rewritten() == code + "```text\nfirst\nvalue 2.0\nlast\n```\n"
    elided = code + "<!-- within 5 % -->\n\n```text\n…\nvalue 1.0\n…\n```\n"
    assert _run(tmp_path, elided).rewritten() == elided.replace("1.0", "2.0")


def test_a_picture_that_isnt_made_is_told(tmp_path: Path) -> None:
    assert len(_run(tmp_path, "![a](none.png)\n").mistakes()) == 1


def test_what_is_only_shown_isnt_run(tmp_path: Path) -> None:
    assert _run(tmp_path, "<!-- shown -->\n\n```sh\nrm -r somewhere\n```\n").printed == {}
    with pytest.raises(ValueError, match="holoview only"):
        _run(tmp_path, "```sh\nrm -r somewhere\n```\n")
