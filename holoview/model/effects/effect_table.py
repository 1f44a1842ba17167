"""The System field that holds the active effects and their values: parsed from tables, and written to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from holoview.model.effects.parameter import Parameter
from holoview.model.effects.registry import get_effect
from holoview.util.errors import UserError
from holoview.util.tables import read_table

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
