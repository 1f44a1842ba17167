"""Options that take numbers take finite ones in range; every command knows --memory."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from holoview.commands.arguments import number, whole
from holoview.commands.cli import COMMANDS, _parser, main
from holoview.util.memory_limit import VARIABLE


def _leaves(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    nested = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not nested:
        yield parser
    for inner in (choice for action in nested for choice in action.choices.values()):
        yield from _leaves(inner)


def _command(name: str) -> argparse.ArgumentParser:
    (action,) = [a for a in _parser(name)._actions if isinstance(a, argparse._SubParsersAction)]
    found: argparse.ArgumentParser = action.choices[name]
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_no_option_takes_any_number_and_every_command_knows_memory(name: str) -> None:
    for parser in _leaves(_command(name)):
        assert [action.dest for action in parser._actions if action.type in (int, float)] == []
        assert "--memory" in parser._option_string_actions


@given(text=st.one_of(st.text(max_size=50), st.floats().map(repr), st.integers().map(str)))
def test_numbers_are_finite_and_in_range_or_refused(text: str) -> None:
    for kind, low, high in ((number(-60, 60), -60, 60), (whole(1, 9), 1, 9), (number(), -1e30, 1e30)):
        try:
            value = kind(text)
        except argparse.ArgumentTypeError as error:
            assert "expected" in str(error) and "\n" not in str(error)
        else:
            assert math.isfinite(value) and low <= value <= high and value == float(text)


def test_what_needs_more_than_is_allowed_is_refused_with_the_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["render", "holochrome-8", "--set", "shape=[16384,16384]", "--backend", "torch", "-o", "seen.png"]
    assert main([*arguments, "--memory", "4GB"]) == 2
    message = capsys.readouterr().err
    assert "needs about" in message and "of the 4GB that were allowed" in message and "--memory" in message
    assert VARIABLE not in os.environ
    assert main(["info", "holochrome-8", "--memory", "many"]) == 2
    assert "a size such as 8GB" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    ["study eye --workers N", "study eye --shape Nx20", "bench --rounds N", "bench --size Nx20", "view --size Nx20"],
)
def test_numbers_of_thousands_of_digits_are_refused_in_a_sentence(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Python converts at most 4300 digits, and raises an error of its own beyond."""
    assert main(words.replace("N", "9" * 5000).split()) == 2
    message = capsys.readouterr().err
    assert words.split()[-2] in message and "expected" in message and message.count("\n") == 1
