"""Flags of fields that are declared once have their sentence, range and default, in every command."""

from __future__ import annotations

import argparse
import inspect
import math
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import MISSING, Field
from functools import cache
from importlib import import_module
from typing import Any

import pytest

from holoview import commands
from holoview.commands.cli import COMMANDS, _parser
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.fields import Duration, Integer, Maybe, Number, Shape, Word, fields_by_key, flag_of
from holoview.util import units
from holoview.util.errors import UserError

OTHERS = {
    "render": ("--exposure",),
    "export": ("--region", "--bits", "--levels"),
    "rig lut": ("--wavelength", "--levels"),
    "captures plan": ("--dark",),
    "calibrate": ("--checkpoint", "--resume", "--wavelength", "--order"),
    "sweep": ("--region", "--workers"),
    "study": ("--shape", "--seed", "--pupils", "--scores", "--workers"),
    "point": ("--window",),
    "contrast": ("--region", "--pupils"),
    "report": ("--region",),
    "demo": ("--shape",),
}
"""Flags with a meaning, or a notation, of their own beside declared fields of the same name."""


def _leaves(parser: argparse.ArgumentParser, name: str) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    nested = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not nested:
        yield name, parser
    for inner, choice in (pair for action in nested for pair in action.choices.items()):
        yield from _leaves(choice, f"{name} {inner}")


def _descriptions() -> set[type[Any]]:
    """The descriptions of which commands add flags, as their sources say."""
    found: set[type[Any]] = set()
    for info in pkgutil.iter_modules(commands.__path__):
        module = import_module(f"holoview.commands.{info.name}")
        names = re.findall(r"(?<!def )add_fields\(\s*\w+,\s*(\w+)", inspect.getsource(module))
        found |= {getattr(module, name) for name in names}
    return found


@cache
def _declared() -> dict[str, list[tuple[argparse.Action, Field[Any] | None]]]:
    """{command: [(flag, its field; None where only the name is that of one)]}."""
    by_flag: dict[str, list[Field[Any]]] = {}
    for description in _descriptions():
        for field in fields_by_key(description).values():
            by_flag.setdefault(flag_of(field), []).append(field)
    found: dict[str, list[tuple[argparse.Action, Field[Any] | None]]] = {}
    for name in COMMANDS:
        (action,) = [a for a in _parser(name)._actions if isinstance(a, argparse._SubParsersAction)]
        for command, parser in _leaves(action.choices[name], name):
            for flag, own in parser._option_string_actions.items():
                known = by_flag.get(flag, ())
                help_text = (own.help or "").replace("%%", "%")
                fields = [field for field in known if help_text.startswith(field.metadata["doc"])]
                if known:
                    found.setdefault(command, []).extend((own, field) for field in fields or [None])
    return found


def _flags(name: str) -> Iterator[tuple[argparse.Action, Field[Any]]]:
    """The flags of fields of a command and of those within it."""
    for command, pairs in _declared().items():
        if command.split()[0] == name:
            yield from ((action, field) for action, field in pairs if field is not None)


def _taken(action: argparse.Action, kind: Any, text: str) -> Any:
    """What a flag and its field make of a text, as often as they want it. Raises ArgumentTypeError or UserError where
    they refuse it."""
    count = action.nargs if isinstance(action.nargs, int) else getattr(kind, "count", None) or 1
    if action.nargs:
        return kind.parse([_typed(action, text)] * count, "flag")
    return kind.parse(_typed(action, ",".join([text] * (2 if action.metavar == "X,Y" else count))), "flag")


def _typed(action: argparse.Action, text: str) -> Any:
    return action.type(text) if callable(action.type) else text


def _bounds(item: Any) -> list[tuple[float, float]]:
    """(a value at a bound of a range, one beyond it)."""
    if isinstance(item, Shape):
        return [(2, 1), (item.most, item.most + 1)]
    if isinstance(item, Integer):
        return [(item.low, item.low - 1), (item.high, item.high + 1)]
    if not isinstance(item, Number):
        return []
    width = item.high - item.low if math.isfinite(item.high - item.low) else 1.0
    pairs = [(item.low, -1.0), (item.high, 1.0)]  # inside by a rounding, as a unit may have moved a bound
    return [(at - sign * 1e-9 * width, at + sign * 1e-3 * width) for at, sign in pairs if math.isfinite(at)]


def _text(action: argparse.Action, item: Any, value: float) -> str:
    unit = getattr(item, "unit", "")
    if not unit:
        return str(value)
    in_unit = float(value / units.parse(f"1 {unit}", "unit", units.quantity_of(unit)))
    return f"{in_unit!r} {unit}" if action.metavar in ("LENGTH", "X,Y") else repr(in_unit)


def test_every_description_has_flags_in_a_command() -> None:
    flagged = {id(field) for pairs in _declared().values() for _, field in pairs}
    without = [one.__name__ for one in _descriptions() if not flagged & {*map(id, fields_by_key(one).values())}]
    assert without == [] and Settings in _descriptions()


def test_flags_that_share_the_name_alone_of_a_field_are_known() -> None:
    """A flag that a command describes by hand, where a field of its name is declared, is on the list or a mistake."""
    alone = {
        name: {action.option_strings[-1] for action, field in pairs if field is None}
        for name, pairs in _declared().items()
    }
    assert {name: flags for name, flags in alone.items() if flags} == {k: set(v) for k, v in OTHERS.items()}


@pytest.mark.parametrize("name", COMMANDS)
def test_flags_take_what_their_fields_take_and_nothing_beyond(name: str) -> None:
    for action, field in _flags(name):
        kind = field.metadata["kind"]
        inner = kind.item if isinstance(kind, Maybe) else kind
        item = getattr(inner, "item", inner)
        if isinstance(inner, Word):
            assert set(inner.options) <= set(action.choices or ()), flag_of(field)
        for at, beyond in _bounds(item):
            _taken(action, inner, _text(action, item, at))
            with pytest.raises((argparse.ArgumentTypeError, UserError)):
                _taken(action, inner, _text(action, item, beyond))


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_flag_tells_the_default_of_its_field(name: str) -> None:
    for action, field in _flags(name):
        default = action.default if action.default not in (None, False) else field.default
        values = default if isinstance(default, tuple) else (default,)
        values = tuple(v for v in values if v not in (None, "", math.inf, math.nan, MISSING) and v is not False)
        stated = re.search(r"\(default ([^)]*)\)", action.help or "")
        assert (stated is not None) == bool(values), flag_of(field)
        kind = field.metadata["kind"]
        item = getattr(kind, "item", kind)
        unit = getattr(getattr(item, "item", item), "unit", "")
        for text, value in zip(stated[1].split(", ") if stated else (), values, strict=True):
            if isinstance(kind, Duration) or unit:
                parse = Duration().parse if isinstance(kind, Duration) else units.parse
                assert parse(text, "default") == pytest.approx(value), flag_of(field)
            else:
                assert text == str(value), flag_of(field)
