"""Docstrings of the public interface are complete, and their examples do what they show."""

from __future__ import annotations

import asyncio
import dataclasses
import doctest
import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import holoview as hv
from docs._hooks.tutorials import working_in

NAMES = [name for name in hv.__all__ if not name.startswith("__")]
IN_A_NOTEBOOK = {"show"}


def _documented() -> Iterator[tuple[str, Any]]:
    """Every public function, class, method and property by its name in `hv`."""
    yield "holoview", hv
    for name in NAMES:
        thing = getattr(hv, name)
        yield name, thing
        if inspect.isclass(thing):
            for member, value in vars(thing).items():
                if not member.startswith("_") and (callable(value) or hasattr(value, "__get__")):
                    yield f"{name}.{member}", value


DOCUMENTED = dict(_documented())


def _parameters(name: str) -> list[str]:
    """What the docstring has to explain: arguments, or the fields of a dataclass."""
    thing = DOCUMENTED[name]
    if dataclasses.is_dataclass(thing):
        return [field.name for field in dataclasses.fields(thing) if not field.name.startswith("_")]
    if isinstance(thing, ModuleType) or not callable(thing):
        return []
    return [key for key in inspect.signature(thing).parameters if key != "self"]


def _run(name: str) -> doctest.TestResults:
    text = inspect.getdoc(DOCUMENTED[name]) or ""
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    return doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test)


@pytest.mark.parametrize("name", DOCUMENTED)
def test_arguments_and_fields_are_explained(name: str) -> None:
    text = inspect.getdoc(DOCUMENTED[name])
    assert text is not None and text.split("\n\n")[0].endswith((".", ":"))
    assert not [key for key in _parameters(name) if key not in text]


@pytest.mark.parametrize("name", [name for name in DOCUMENTED if name not in IN_A_NOTEBOOK])
def test_the_example_does_what_it_shows(name: str, tmp_path: Path) -> None:
    with working_in(tmp_path):
        result = _run(name)
    assert result.attempted > 1 and result.failed == 0


@pytest.mark.gpu
@pytest.mark.parametrize("name", sorted(IN_A_NOTEBOOK))
@pytest.mark.usefixtures("device")
def test_an_example_for_a_notebook_does_what_it_shows(name: str) -> None:
    async def cell() -> doctest.TestResults:
        return _run(name)

    pytest.importorskip("anywidget")
    result = asyncio.run(cell())
    assert result.attempted > 1 and result.failed == 0
