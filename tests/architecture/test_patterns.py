"""No regular expression goes back for ever: none repeats, without bounds, what itself has a variable length."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from re import _constants as codes  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
_GOES_BACK = (codes.MAX_REPEAT, codes.MIN_REPEAT)
_FUNCTIONS = ("compile", "match", "fullmatch", "search", "sub", "split", "findall", "finditer")


def _repeats_of_repeats(tree: Any, is_inside: bool = False) -> Iterator[str]:
    """Repeats that can give back what they took, inside an unbounded one that can too."""
    for code, value in tree:
        if code in _GOES_BACK:
            low, high, inner = value
            if is_inside and high != low:
                yield f"{{{low},{high}}}"
            yield from _repeats_of_repeats(inner, is_inside or high is codes.MAXREPEAT)
        elif code is codes.POSSESSIVE_REPEAT:
            yield from _repeats_of_repeats(value[2])
        elif code is codes.BRANCH:
            for branch in value[1]:
                yield from _repeats_of_repeats(branch, is_inside)
        elif code is codes.SUBPATTERN:
            yield from _repeats_of_repeats(value[3], is_inside)
        elif code in (codes.ASSERT, codes.ASSERT_NOT):
            yield from _repeats_of_repeats(value[1], is_inside)


def _patterns() -> Iterator[tuple[str, str | bytes]]:
    """Every pattern in the product that is written as a constant, and those that its modules hold."""
    for file in sorted((ROOT / "holoview").rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if "import re\n" not in text:
            continue
        is_held = False
        for node in ast.walk(ast.parse(text)):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args):
                continue
            if isinstance(node.func.value, ast.Name) and node.func.value.id == "re" and node.func.attr in _FUNCTIONS:
                pattern = node.args[0]
                if isinstance(pattern, ast.Constant):
                    yield f"{file.name}:{node.lineno}", pattern.value
                else:
                    is_held = True
        if is_held:
            module = import_module(".".join(file.relative_to(ROOT).with_suffix("").parts))
            for name, value in vars(module).items():
                if isinstance(value, re.Pattern):
                    yield f"{file.name}: {name}", value.pattern


def test_no_pattern_repeats_what_repeats() -> None:
    found = {place: [*_repeats_of_repeats(parser.parse(pattern))] for place, pattern in _patterns()}
    assert len(found) > 30
    assert {place: repeats for place, repeats in found.items() if repeats} == {}


@pytest.mark.parametrize(
    ("pattern", "count"), [(r"(?:a+)+", 1), (r"(?:a+)*+", 0), (r"(?:a?b){2}", 0), (r"(a|b*)*x", 1)]
)
def test_such_patterns_are_found(pattern: str, count: int) -> None:
    assert len([*_repeats_of_repeats(parser.parse(pattern))]) == count
