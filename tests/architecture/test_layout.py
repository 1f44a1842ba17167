"""What a stranger meets first: few names at the root, and a sentence that says what each module is for."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.architecture.source_trees import PACKAGE, source_trees
from tests.conftest import LONGEST

MOST_FUNCTION_LINES = 60


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    """The syntax of every module by its path."""
    return {str(path.relative_to(PACKAGE)): tree for path, tree in source_trees().items()}


def test_at_most_nine_names_stand_at_the_root() -> None:
    names = [path.name for path in PACKAGE.iterdir() if path.name not in ("__pycache__", "data")]  # data: of a wheel
    assert len(names) <= 9, names


def test_every_module_says_in_its_first_sentence_what_it_is_for(trees: dict[str, ast.Module]) -> None:
    first = {name: (ast.get_docstring(tree) or "").split("\n\n")[0].rstrip() for name, tree in trees.items()}
    assert [name for name, text in first.items() if not text.endswith((".", ":")) or len(text.split()) < 4] == []


def test_functions_are_short_enough_to_hold_one_concept(trees: dict[str, ast.Module]) -> None:
    functions = {
        f"{name}: {node.name}": node.body[-1].end_lineno - node.lineno  # type: ignore[operator]
        for name, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    assert [name for name, lines in functions.items() if lines >= MOST_FUNCTION_LINES] == []


def test_every_public_function_and_class_has_a_docstring(trees: dict[str, ast.Module]) -> None:
    """Overriding methods take theirs from what they override."""
    missing = [
        f"{name}: {node.name}"
        for name, tree in trees.items()
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        and not node.name.startswith("_")
        and ast.get_docstring(node) is None
    ]
    assert missing == []


def test_the_files_whose_tests_begin_first_are_there() -> None:
    folder = Path(__file__).parents[1]
    assert [name for name in LONGEST if not (folder / name).is_file()] == []
