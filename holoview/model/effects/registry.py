"""The effects there are: every module of this package that defines one, and files of the user's own."""

from __future__ import annotations

import importlib.util
import inspect
import os
import pkgutil
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType, ModuleType

from holoview.model.effects.effect import Effect
from holoview.util.errors import UserError, suggest_matches

_LIBRARY = "holoview.effects"
_OWN_MODULES = "holoview_user_effects"
_user_effects: dict[str, Effect] = {}


def listed_effects() -> Mapping[str, Effect]:
    """Effects by id, sorted: the library's and those that `load_user_effects` added, as far as they are listed."""
    return MappingProxyType({name: one for name, one in _everything().items() if one.listed})


def get_effect(name: str) -> Effect:
    """The effect of an id; UserError with near matches when there is none."""
    known = _everything()
    if name not in known:
        raise UserError(f"effects.{name}", "unknown effect", remedy=suggest_matches(name, known))
    return known[name]


def load_user_effects(path: str | os.PathLike[str]) -> list[Effect]:
    """Runs a Python file and adds the effects that it defines. It runs whatever code the file holds.

    Raises UserError for a file that is missing, fails, defines no effect, or takes an id that is in use.
    """
    file = Path(path)
    if not file.is_file():
        raise UserError(str(file), "no such file", expected="a Python file that defines an Effect")
    spec = importlib.util.spec_from_file_location(f"{_OWN_MODULES}.{file.stem}", file)
    if spec is None or spec.loader is None:
        raise UserError(str(file), "isn't a Python file", expected="a name that ends in .py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        found = list(_effects_of(module))
    except Exception as error:
        raise UserError(str(file), f"failed: {type(error).__name__}: {error}", remedy="mend the file") from error
    if not found:
        raise UserError(str(file), "defines no effect", expected="a class that derives from holoview.effects.Effect")
    for one in found:
        _check(one, str(file))
        if one.id in _library():
            raise UserError(str(file), f'the id "{one.id}" is in use', expected="an id of its own")
    _user_effects.update({one.id: one for one in found})
    sys.modules[module.__name__] = module
    return found


def is_user_effect(one: Effect) -> bool:
    """Whether an effect comes from a user's file."""
    return type(one).__module__.startswith(_OWN_MODULES)


def _everything() -> Mapping[str, Effect]:
    return dict(sorted({**_library(), **_user_effects}.items()))


@cache
def _library() -> Mapping[str, Effect]:
    found: dict[str, Effect] = {}
    for info in pkgutil.iter_modules(import_module(_LIBRARY).__path__):
        for one in _effects_of(import_module(f"{_LIBRARY}.{info.name}")):
            _check(one, info.name)
            found[one.id] = one
    return found


def _effects_of(module: ModuleType) -> Iterator[Effect]:
    for _, thing in inspect.getmembers(module, inspect.isclass):
        if issubclass(thing, Effect) and thing.__module__ == module.__name__ and hasattr(thing, "id"):
            yield thing()


def _check(one: Effect, where: str) -> None:
    """UserError unless everything that an effect must state is there."""
    for name in ("id", "cause", "finding", "parameters", "acts_on"):
        if not getattr(one, name, None):
            raise UserError(where, f"{type(one).__name__} has no `{name}`", expected="every field that Effect lists")
    for p in one.parameters:
        if not p.low <= p.identity <= p.high or not p.prior > 0:
            raise UserError(where, f"parameter {p.name} of {one.id}", expected="low ≤ identity ≤ high and prior > 0")
