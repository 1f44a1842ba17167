"""What a stranger meets first: few modules at the root, and a sentence that says what each module is for."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import holoview

PACKAGE = Path(holoview.__file__).resolve().parent
FILES = sorted(PACKAGE.rglob("*.py"))
MOST_LINES, MOST_FUNCTION_LINES = 320, 60


def _name(path: Path) -> str:
    return str(path.relative_to(PACKAGE))


def test_at_most_eight_modules_stand_loose_at_the_root() -> None:
    loose = [path.name for path in PACKAGE.glob("*.py")]
    assert len(loose) <= 8, loose


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_a_module_says_in_its_first_line_what_it_is_for(path: Path) -> None:
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert text is not None, "no docstring"
    first = text.split("\n\n")[0].replace("\n", " ")
    assert first.rstrip().endswith((".", ":")), first
    assert len(first.split()) >= 4, first


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_files_and_functions_hold_one_concept(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert node.body[-1].end_lineno is not None
            assert node.body[-1].end_lineno - node.lineno < MOST_FUNCTION_LINES, node.name
