"""All effects by id, of `holoview.effects` and of users' files, and the field of a System with the active ones."""

from __future__ import annotations

import importlib.util
import inspect
import os
import pkgutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter
from holoview.util.errors import UserError
from holoview.util.tables import check_keys, read_table

_LIBRARY = "holoview.effects"
_USER_MODULES = "holoview_user_effects"
_user_effects: dict[str, Effect] = {}


def listed_effects() -> Mapping[str, Effect]:
    """The effects that are offered as causes and in the viewer, by id, sorted; those of users' files included."""
    return MappingProxyType({name: effect for name, effect in _all_effects().items() if effect.listed})


def get_effect(name: str) -> Effect:
    """The effect of an id, listed or not. Raises UserError, which suggests similar ids, when there is none."""
    known = _all_effects()
    check_keys([name], known, "effects.", noun="effect")
    return known[name]


def load_user_effects(path: str | os.PathLike[str]) -> list[Effect]:
    """Runs a Python file and registers the effects that it defines. All code in the file is run.

    Raises UserError for a file that is missing or fails, defines no effect, or uses the id of an effect of the library.
    """
    file = Path(path)
    if not file.is_file():
        raise UserError(str(file), "no such file", expected="a Python file that defines an Effect")
    spec = importlib.util.spec_from_file_location(f"{_USER_MODULES}.{file.stem}", file)
    if spec is None or spec.loader is None:
        raise UserError(str(file), "isn't a Python file", expected="a name that ends in .py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        effects = list(_effects_of(module))
    except Exception as error:
        raise UserError(str(file), f"failed: {type(error).__name__}: {error}", remedy="mend the file") from error
    if not effects:
        raise UserError(str(file), "defines no effect", expected="a class that derives from holoview.effects.Effect")
    for effect in effects:
        _check(effect, str(file))
        if effect.id in _library():
            raise UserError(str(file), f'the id "{effect.id}" is in use', expected="an id of its own")
    _user_effects.update({effect.id: effect for effect in effects})
    sys.modules[module.__name__] = module
    return effects


@contextmanager
def without_user_effects() -> Iterator[None]:
    """Context manager without users' effects at first; afterwards the former ones are registered again."""
    before = dict(_user_effects)
    _user_effects.clear()
    try:
        yield
    finally:
        _user_effects.clear()
        _user_effects.update(before)


def is_user_effect(effect: Effect) -> bool:
    """Whether an effect comes from a user's file."""
    return type(effect).__module__.startswith(_USER_MODULES)


def _all_effects() -> Mapping[str, Effect]:
    return dict(sorted({**_library(), **_user_effects}.items()))


@cache
def _library() -> Mapping[str, Effect]:
    """The effects of `holoview.effects`; its subpackages hold what effects use."""
    effects: dict[str, Effect] = {}
    for info in pkgutil.iter_modules(import_module(_LIBRARY).__path__):
        if info.ispkg:
            continue
        for effect in _effects_of(import_module(f"{_LIBRARY}.{info.name}")):
            _check(effect, info.name)
            effects[effect.id] = effect
    return effects


def _effects_of(module: ModuleType) -> Iterator[Effect]:
    """The effects that a module defines; base classes have no id."""
    for _, member in inspect.getmembers(module, inspect.isclass):
        if issubclass(member, Effect) and member.__module__ == module.__name__ and hasattr(member, "id"):
            yield member()


def _check(effect: Effect, where: str) -> None:
    """Raises UserError unless the effect states all that it must."""
    for name in ("id", "cause", "finding", "parameters", "acts_on"):
        if not getattr(effect, name, None):
            raise UserError(where, f"{type(effect).__name__} has no `{name}`", expected="every field that Effect lists")
    for p in effect.parameters:
        if not p.has_sound_bounds:
            raise UserError(where, f"parameter {p.name} of {effect.id}", expected="low ≤ identity ≤ high and prior > 0")


# --- the table of active effects --------------------------------------------------------------------------------------


EffectPairs = tuple[tuple[str, tuple[tuple[str, Any], ...]], ...]


@dataclass(frozen=True)
class EffectTable:
    """Field type of active effects: a table {id: {parameter: value}}.

    Its value is hashable: sorted pairs (id, ((parameter, SI value), …)).
    """

    def parse(self, value: Any, where: str) -> EffectPairs:
        table = dict(value) if isinstance(value, tuple) else value
        if not isinstance(table, Mapping):
            raise UserError(where, f"{value!r}", expected='tables such as [effects.gap] gap_error = "0.1 mm"')
        return tuple((name, self._parse_values(name, table[name], f"{where}.{name}")) for name in sorted(table))

    def to_toml(self, value: EffectPairs) -> dict[str, Any]:
        return {name: {key: self._parameters(name)[key].to_toml(x) for key, x in pairs} for name, pairs in value}

    def with_changes(self, value: EffectPairs, changes: Mapping[str, Any], where: str) -> EffectPairs:
        """With some values changed: {"gap.gap_error": "0.1 mm"} or {"gap": {…}}."""
        table: dict[str, Any] = {name: dict(pairs) for name, pairs in value}
        for key, change in changes.items():
            name, _, parameter = key.partition(".")
            table[name] = {**table.get(name, {}), parameter: change} if parameter else change
        return self.parse(table, where)

    def _parse_values(self, name: str, given: Any, where: str) -> tuple[tuple[str, Any], ...]:
        """The values of one effect's parameters."""
        values = dict(given) if isinstance(given, tuple) else given
        if not isinstance(values, Mapping):
            raise UserError(where, f"{given!r}", expected="a table of its parameters")
        read = read_table(values, self._parameters(name), f"{where}.", noun="parameter")
        return tuple(sorted(read.items()))

    @staticmethod
    def _parameters(name: str) -> dict[str, Parameter]:
        return {parameter.name: parameter for parameter in get_effect(name).parameters}
