"""Runs the tutorials: pages of Markdown whose code is executed in order, and compares what they show with what it did.

    ```python            run, in one namespace for the whole page
    ```sh                run: a `holoview …` command a line
    ```text              what the block before printed; a line `…` stands for any number of lines
    ![…](…/NAME.png)     a picture that the page's code wrote as NAME.png

A comment before a block says more: `<!-- shown -->`: don't run it; `<!-- within 5 % -->`: how far numbers may be off
(2 % if it says nothing); and anywhere on the page `<!-- files: a/b.png -->`: files of the repository that it
takes as given.

`python -m docs._hooks.tutorials` runs all pages and writes what they print and draw into them.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import shlex
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from docs._hooks.links import links_of
from docs._hooks.repository import ROOT

FOLDER = ROOT / "docs" / "tutorials"
WITHIN = 0.02
"""How far a printed number may be off, relative to itself, where the page says nothing."""
PICTURE_WITHIN = 0.03
"""How far the mean of a block of 8 × 8 pixels of a picture may be off, r.m.s., of full scale."""
_BLOCK = re.compile(r"(?:<!--(?P<note>[^>]*)-->\n+)?^```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
_FILES = re.compile(r"<!-- files: ([^>]*?) -->")
_NUMBER = re.compile(r"[-−+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_ANY_LINES = "…"


@dataclass(frozen=True)
class Block:
    """A fenced block: its kind, text, the comment before it, and where its text is in the page."""

    kind: str
    text: str
    note: str
    start: int
    end: int

    @property
    def within(self) -> float:
        """How far numbers may be off, relative."""
        match = re.search(r"within ([\d.]+) %", self.note)
        return float(match[1]) / 100 if match else WITHIN


@dataclass
class Tutorial:
    """A page, run: `printed` has what the block before each text block printed."""

    page: Path
    text: str
    printed: dict[Block, str] = field(default_factory=dict)

    @classmethod
    def read(cls, page: Path) -> Tutorial:
        """The page's file, not run yet."""
        return cls(page, page.read_text(encoding="utf-8"))

    @property
    def blocks(self) -> list[Block]:
        """The page's fenced blocks in order."""
        return [
            Block(match["kind"], match["text"], (match["note"] or "").strip(), match.start("text"), match.end("text"))
            for match in _BLOCK.finditer(self.text)
        ]

    @property
    def pictures(self) -> list[Path]:
        """The pictures that the page shows."""
        targets = [link.path for link in links_of(self.text)]
        return [(self.page.parent / one).resolve() for one in targets if one.endswith((".png", ".jpg"))]

    def run(self) -> None:
        """Runs the code in the current folder, which gets the files that the page takes as given."""
        for names in _FILES.findall(self.text):
            for name in names.split():
                shutil.copy(ROOT / name, Path(name).name)
        names_there: dict[str, Any] = {"__name__": "__main__"}
        printed = ""
        for block in self.blocks:
            if block.kind == "text":
                self.printed[block] = printed
            elif block.kind in ("python", "sh") and block.note != "shown":
                printed = self._run_block(block, names_there)

    def _run_block(self, block: Block, names_there: dict[str, Any]) -> str:
        line = self.text.count("\n", 0, block.start)
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            if block.kind == "python":
                exec(compile("\n" * line + block.text, str(self.page), "exec"), names_there)
            else:
                for command in _commands(block.text):
                    _holoview(command, f"{self.page.name}:{line}")
        return out.getvalue()

    def mistakes(self) -> list[str]:
        """What the page shows and the run in the current folder didn't give, in words."""
        found = []
        for block, printed in self.printed.items():
            if wrong := _difference(block.text, printed, block.within):
                found.append(f"{self.page.name}:{self.text.count(chr(10), 0, block.start)}: {wrong}")
        for picture in self.pictures:
            if wrong := _picture_difference(picture, Path(picture.name)):
                found.append(f"{self.page.name}: {picture.name}: {wrong}")
        return found

    def rewritten(self) -> str:
        """The page with what was printed now."""
        text = self.text
        for block, printed in sorted(self.printed.items(), key=lambda one: -one[0].start):
            if _difference(block.text, printed, 0.0):
                text = text[: block.start] + _brought_up_to_date(block.text, printed) + text[block.end :]
        return text


def _commands(text: str) -> Iterator[list[str]]:
    for line in text.replace("\\\n", " ").splitlines():
        if words := shlex.split(line, comments=True):
            yield words


def _holoview(words: list[str], where: str) -> None:
    """Runs a command line in this process, which saves seconds of importing for each; `> FILE` takes its output."""
    if words[0] != "holoview":
        raise ValueError(f"{where}: {words[0]}: a tutorial runs holoview only; mark what is only shown")
    target = None
    if ">" in words:
        target, words = words[words.index(">") + 1], words[: words.index(">")]
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        code = _program()(words[1:])
    if target is None:
        print(out.getvalue(), end="")
    else:
        Path(target).write_text(out.getvalue(), encoding="utf-8")
    if code != 0:
        raise RuntimeError(f"{where}: {shlex.join(words)} returned {code}")


@cache
def _program() -> Callable[[list[str]], int]:
    """The function behind the command `holoview`."""
    return import_module("holoview.commands.cli").main  # type: ignore[no-any-return]


def _difference(shown: str, printed: str, within: float) -> str:
    """The first line that differs, in words; empty where all agree."""
    at, skips, lines = 0, False, _lines(printed)
    for expected in _lines(shown):
        if expected.strip() == _ANY_LINES:
            skips = True
            continue
        found = _found(expected, lines, at, skips, within)
        if found is None:
            return f"shows “{expected}”, but the run printed “{lines[at] if at < len(lines) else 'nothing'}”"
        at, skips = found + 1, False
    return "" if skips or at >= len(lines) else f"the run also printed “{lines[at]}”"


def _brought_up_to_date(shown: str, printed: str) -> str:
    """What a page is to show: all that was printed, or, where it leaves lines out, its own lines with new numbers."""
    if _ANY_LINES not in _lines(shown):
        return printed.strip("\n") + "\n"
    at, new, lines = 0, [], _lines(printed)
    for expected in _lines(shown):
        found = None if expected.strip() == _ANY_LINES else _found(expected, lines, at, True, math.inf)
        new.append(expected if found is None else lines[found])
        at = at if found is None else found + 1
    return "\n".join(new) + "\n"


def _found(expected: str, lines: list[str], at: int, skips: bool, within: float) -> int | None:
    rest = range(at, len(lines) if skips else min(at + 1, len(lines)))
    return next((i for i in rest if _agrees(expected, lines[i], within)), None)


def _lines(text: str) -> list[str]:
    return [line.rstrip() for line in text.strip("\n").split("\n")]


def _agrees(shown: str, printed: str, within: float) -> bool:
    """Whether two lines have the same words and nearly the same numbers: one off in the last digit always passes."""
    if _NUMBER.sub("#", shown).split() != _NUMBER.sub("#", printed).split():
        return False
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(printed), strict=True)
    return all(_is_near(a.replace("−", "-"), b.replace("−", "-"), within) for a, b in pairs)


def _is_near(shown: str, printed: str, within: float) -> bool:
    if shown == printed:
        return True
    if "." not in shown and "." not in printed and within < 1:  # counts, unless they are large enough for a tolerance
        return abs(int(float(shown)) - int(float(printed))) <= within * abs(float(shown))
    last_digit = 10.0 ** -len(shown.partition(".")[2]) if "e" not in shown.lower() else 0.0
    return abs(float(shown) - float(printed)) <= max(within * abs(float(shown)), 1.01 * last_digit)


def _picture_difference(shown: Path, made: Path) -> str:
    if not made.is_file():
        return "the page's code made no such picture"
    with Image.open(shown) as page, Image.open(made) as run:
        if page.size != run.size:
            return f"the page's is {page.size}, the run's {run.size}"
        old, new = _blocks(page), _blocks(run)
    error = float(np.sqrt(np.mean((old - new) ** 2)))
    return "" if error <= PICTURE_WITHIN else f"the run made another, {error:.3f} of full scale away"


def _blocks(image: Image.Image) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Means of blocks of 8 × 8 pixels, 0…1."""
    shape = (math.ceil(image.width / 8), math.ceil(image.height / 8))
    small = image.convert("RGB").resize(shape, Image.Resampling.BOX)
    return np.asarray(small, dtype=np.float64) / 255


@contextlib.contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """Makes a folder the current one for a while."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def pages() -> list[Path]:
    """The tutorials' pages, with that of the live bench."""
    return [*sorted(path for path in FOLDER.glob("*.md") if path.name != "index.md"), FOLDER.parent / "rig.md"]


def write(page: Path) -> None:
    """Runs a page and writes what it printed and drew where it shows that."""
    tutorial = Tutorial.read(page)
    with tempfile.TemporaryDirectory() as folder, working_in(Path(folder)):
        tutorial.run()
        page.write_text(tutorial.rewritten(), encoding="utf-8")
        for picture in tutorial.pictures:
            picture.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(picture.name, picture)


if __name__ == "__main__":
    for each in pages():
        write(each)
        print(each)
