"""Every command that README and manual show is one that the command line takes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from docs._hooks.repository import ROOT
from holoview.commands import cli

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
_BLOCK = re.compile(
    r"^```(?P<kind>\w*)\n(?P<fenced>.*?)^```$|(?P<indented>(?:^ {4}\S[^\n]*\n)+)", re.MULTILINE | re.DOTALL
)
_COMMAND = re.compile(r"^\s*(?:\$ )?(?:\.venv/bin/)?holoview (.+)$")


def commands_of(text: str) -> Iterator[list[str]]:
    """The words of each `holoview …` line in the blocks of a page, without comments; abbreviated lines are left out."""
    blocks = [match for match in _BLOCK.finditer(text) if match["kind"] in (None, "", "sh")]
    for block in blocks:
        for line in (block["fenced"] or block["indented"]).replace("\\\n", " ").splitlines():
            for part in re.sub(r"\s(#|> ).*$", "", line).split("&&"):
                command = _COMMAND.match(part)
                if command and "…" not in part:
                    yield shlex.split(command[1])


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_commands_are_taken(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for words in commands_of(page.read_text(encoding="utf-8")):
        assert cli._parser(words[0]).parse_args(words).run, words


def test_commands_are_found() -> None:
    text = "```sh\n$ holoview a --b 'c d' \\\n  e   # f\nholoview g && holoview h > x\n```\n\nholoview k\n\n"
    text += "    holoview i …\n    holoview j\n```toml\nholoview l\n```\nholoview m\n"
    assert list(commands_of(text)) == [["a", "--b", "c d", "e"], ["g"], ["h"], ["j"]]
