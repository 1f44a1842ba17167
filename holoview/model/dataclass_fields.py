"""Descriptions: frozen dataclasses whose fields carry a `Kind`, built from tables, written to tables, and edited.

People write a field's name without its unit: `gap` for `gap_m`. Errors name the key from the outermost table inwards.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from holoview.model.field_types import FieldType, TableType
from holoview.util.errors import UserError, suggest_matches


@dataclasses.dataclass(frozen=True)
class Nested:
    """A nested description, given as an instance or as a table of its keys."""

    description: type[Any]

    def parse(self, value: Any, where: str) -> Any:
        if isinstance(value, self.description):
            return value
        if not isinstance(value, Mapping):
            raise UserError(
                where, f"{value!r}", expected=f"a table with the keys {', '.join(fields_by_key(self.description))}"
            )
        try:
            return from_mapping(self.description, value)
        except UserError as error:
            raise error.inside(f"{where}.") from error

    def to_toml(self, value: Any) -> dict[str, Any]:
        return to_mapping(value)


@dataclasses.dataclass(frozen=True)
class NestedList:
    """A tuple of nested descriptions."""

    description: type[Any]

    def parse(self, value: Any, where: str) -> tuple[Any, ...]:
        if isinstance(value, Mapping | str) or not isinstance(value, Iterable):
            raise UserError(where, f"{value!r}", expected=f"a list of tables, one [[{where}]] each")
        return tuple(Nested(self.description).parse(entry, f"{where}[{i}]") for i, entry in enumerate(value))

    def to_toml(self, value: tuple[Any, ...]) -> list[dict[str, Any]]:
        return [to_mapping(entry) for entry in value]


def described_field(kind: FieldType, doc: str, **kwargs: Any) -> Any:
    """A dataclass field that carries its `Kind` and a sentence that explains it."""
    return dataclasses.field(metadata={"kind": kind, "doc": doc}, **kwargs)


def key_without_unit(name: str) -> str:
    """The name that people write: the field's name without its unit."""
    return name.removesuffix("_m").removesuffix("_rad")


def fields_by_key(description: type[Any]) -> dict[str, dataclasses.Field[Any]]:
    """The fields of a description by the name that people write."""
    return {key_without_unit(field.name): field for field in dataclasses.fields(description)}


def field_for(description: type[Any], key: str) -> dataclasses.Field[Any]:
    """The field that people call `key`; UserError with near matches when there is none."""
    known = fields_by_key(description)
    if key not in known:
        raise UserError(key, "unknown key", remedy=suggest_matches(key, known))
    return known[key]


def validate(instance: Any) -> None:
    """Reads every field of a frozen description through its kind; call it first in `__post_init__`."""
    for key, field in fields_by_key(type(instance)).items():
        object.__setattr__(instance, field.name, field.metadata["kind"].parse(getattr(instance, field.name), key))


def from_mapping(description: type[Any], table: Mapping[str, Any]) -> Any:
    """Builds a description from people's keys and values; UserError names the key that is unknown, missing or wrong."""
    values = {field_for(description, key).name: value for key, value in table.items()}
    for key, field in fields_by_key(description).items():
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and field.name not in values:
            raise UserError(key, "is missing", expected=field.metadata["doc"])
    return description(**values)


def to_mapping(instance: Any) -> dict[str, Any]:
    """People's keys and values of a description, ready for TOML; absent options and empty text are left out."""
    written = {
        key: field.metadata["kind"].to_toml(getattr(instance, field.name))
        for key, field in fields_by_key(type(instance)).items()
    }
    return {key: value for key, value in written.items() if value is not None and value != "" and value != {}}


def with_changes(instance: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a description with some keys changed; dots reach inside ("relay1.iris_na", "modulators.0.pitch").

    All changes are applied together and checked once, so that several may depend on each other.
    """
    values: dict[str, Any] = {}
    inner: dict[str, dict[str, Any]] = {}
    for key, value in changes.items():
        head, _, rest = key.partition(".")
        field = field_for(type(instance), head)
        if rest:
            inner.setdefault(field.name, {})[rest] = value
        else:
            values[field.name] = value
    for name, nested in inner.items():
        kind, key = fields_by_key(type(instance))[key_without_unit(name)].metadata["kind"], key_without_unit(name)
        whole = kind.parse(values.get(name, getattr(instance, name)), key)
        values[name] = _edited_inside(kind, whole, nested, key)
    return dataclasses.replace(instance, **values)


def _edited_inside(kind: FieldType, value: Any, changes: Mapping[str, Any], where: str) -> Any:
    if isinstance(kind, NestedList):
        return _edited_entries(kind, value, changes, where)
    if isinstance(kind, TableType):
        return kind.with_changes(value, changes, where)
    if not isinstance(kind, Nested):
        raise UserError(f"{where}.{next(iter(changes))}", "unknown key", remedy=f"{where} has no parts")
    try:
        return with_changes(value, changes)
    except UserError as error:
        raise error.inside(f"{where}.") from error


def _edited_entries(
    kind: NestedList, value: tuple[Any, ...], changes: Mapping[str, Any], where: str
) -> tuple[Any, ...]:
    entries = list(value)
    for key, change in changes.items():
        index, _, rest = key.partition(".")
        if not rest or index not in map(str, range(len(entries))):
            expected = f"{where}.0 to {where}.{len(entries) - 1} and a key"
            raise UserError(f"{where}.{key}", "unknown key", expected=expected)
        item = Nested(kind.description)
        entries[int(index)] = _edited_inside(item, entries[int(index)], {rest: change}, f"{where}.{index}")
    return tuple(entries)


def hashable_value(value: Any) -> Any:
    """A hashable equivalent of a description, for equality and as a cache key."""
    if dataclasses.is_dataclass(value):
        return tuple(hashable_value(getattr(value, field.name)) for field in dataclasses.fields(value))
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    return tuple(hashable_value(v) for v in value) if isinstance(value, tuple) else value
