"""The effects that a bench has on, as a field of its description: read from people's tables, and written to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from holoview.model.effects.registry import get_effect
from holoview.util.errors import UserError, suggest_matches

EffectPairs = tuple[tuple[str, tuple[tuple[str, Any], ...]], ...]


@dataclass(frozen=True)
class EffectTable:
    """Effects that are switched on, {id: {parameter: value}}; kept as sorted (id, ((parameter, SI value), …)) pairs."""

    def parse(self, value: Any, where: str) -> EffectPairs:
        table = dict(value) if isinstance(value, tuple) else value
        if not isinstance(table, Mapping):
            raise UserError(where, f"{value!r}", expected='tables such as [effects.gap] gap_error = "0.1 mm"')
        return tuple((name, self._values(name, table[name], f"{where}.{name}")) for name in sorted(table))

    def to_toml(self, value: EffectPairs) -> dict[str, Any]:
        return {name: {key: self._known(name)[key].to_toml(x) for key, x in pairs} for name, pairs in value}

    def with_changes(self, value: EffectPairs, changes: Mapping[str, Any], where: str) -> EffectPairs:
        """With some values changed: {"gap.gap_error": "0.1 mm"} or {"gap": {…}}."""
        table: dict[str, Any] = {name: dict(pairs) for name, pairs in value}
        for key, change in changes.items():
            name, _, parameter = key.partition(".")
            table[name] = {**table.get(name, {}), parameter: change} if parameter else change
        return self.parse(table, where)

    def _values(self, name: str, given: Any, where: str) -> tuple[tuple[str, Any], ...]:
        values = dict(given) if isinstance(given, tuple) else given
        if not isinstance(values, Mapping):
            raise UserError(where, f"{given!r}", expected="a table of its parameters")
        known = self._known(name)
        for key in values:
            if key not in known:
                raise UserError(f"{where}.{key}", "unknown parameter", remedy=suggest_matches(key, known))
        return tuple((key, known[key].parse(values[key], f"{where}.{key}")) for key in sorted(values))

    @staticmethod
    def _known(name: str) -> dict[str, Any]:
        return {parameter.name: parameter for parameter in get_effect(name).parameters}
