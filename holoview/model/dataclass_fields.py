"""Frozen dataclasses whose fields have a `FieldType`: built from tables, written to tables, and edited by dotted keys.

Such a dataclass is called a description here. In tables its fields are named without their unit: `gap` for `gap_m`.
Errors name the key from the outermost table inwards, for example `modulators.0.pitch`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from holoview.model.field_types import FieldType, TableType
from holoview.util.errors import UserError
from holoview.util.tables import check_keys, is_required


class Description:
    """Equality and hash of a frozen dataclass by value, arrays included."""

    @cached_property
    def _hashable_value(self) -> Any:
        return hashable_value(self)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        return type(other) is type(self) and self._hashable_value == other._hashable_value

    def __hash__(self) -> int:
        return hash(self._hashable_value)


@dataclasses.dataclass(frozen=True)
class Nested:
    """Field type of a nested description, given as an instance or as a table of its keys.

    optional: whether there may be none, None or the text "none", with which a preset takes away that of its base.
    """

    description: type[Any]
    optional: bool = False

    def parse(self, value: Any, where: str) -> Any:
        if self.optional and (value is None or (isinstance(value, str) and value == "none")):
            return None
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

    def to_toml(self, value: Any) -> dict[str, Any] | None:
        return None if value is None else to_mapping(value)


@dataclasses.dataclass(frozen=True)
class NestedList:
    """Field type of a tuple of nested descriptions."""

    description: type[Any]

    def parse(self, value: Any, where: str) -> tuple[Any, ...]:
        if isinstance(value, Mapping | str) or not isinstance(value, Iterable):
            raise UserError(where, f"{value!r}", expected=f"a list of tables, one [[{where}]] each")
        return tuple(Nested(self.description).parse(entry, f"{where}[{i}]") for i, entry in enumerate(value))

    def to_toml(self, value: tuple[Any, ...]) -> list[dict[str, Any]]:
        return [to_mapping(entry) for entry in value]


def described_field(field_type: FieldType, doc: str, **kwargs: Any) -> Any:
    """`dataclasses.field` with the field's type and a sentence that explains it, as metadata "kind" and "doc"."""
    return dataclasses.field(metadata={"kind": field_type, "doc": doc}, **kwargs)


def key_without_unit(name: str) -> str:
    """A field's key in tables: its name without the unit."""
    return name.removesuffix("_m").removesuffix("_rad").removesuffix("_dpt").removesuffix("_deg")


def fields_by_key(description: type[Any]) -> dict[str, dataclasses.Field[Any]]:
    """The fields of a description by their keys in tables."""
    return {key_without_unit(field.name): field for field in dataclasses.fields(description)}


def field_for(description: type[Any], key: str) -> dataclasses.Field[Any]:
    """The field of a key. Raises UserError, which suggests similar keys, when there is none."""
    known = fields_by_key(description)
    check_keys([key], known)
    return known[key]


def validate(instance: Any) -> None:
    """Replaces every field of a frozen description by what its type parses from it; called first in `__post_init__`."""
    for key, field in fields_by_key(type(instance)).items():
        object.__setattr__(instance, field.name, field.metadata["kind"].parse(getattr(instance, field.name), key))


def from_mapping(description: type[Any], table: Mapping[str, Any]) -> Any:
    """Builds a description from a table. Raises UserError that names a key that is unknown, missing or wrong."""
    values = {field_for(description, key).name: value for key, value in table.items()}
    for key, field in fields_by_key(description).items():
        if is_required(field) and field.name not in values:
            raise UserError(key, "is missing", expected=field.metadata["doc"])
    return description(**values)


def to_mapping(instance: Any) -> dict[str, Any]:
    """The table of a description, ready for TOML, without options that are None and texts and tables that are empty."""
    written = {
        key: field.metadata["kind"].to_toml(getattr(instance, field.name))
        for key, field in fields_by_key(type(instance)).items()
    }
    return {key: value for key, value in written.items() if value is not None and value != "" and value != {}}


def with_changes(instance: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a description with some keys changed; dots reach nested ones ("relay1.iris_na", "modulators.0.pitch").

    All changes are applied before the copy is checked, so that several may depend on each other. Raises UserError for
    unknown keys and wrong values.
    """
    values: dict[str, Any] = {}
    nested_changes: dict[str, dict[str, Any]] = {}
    for key, value in changes.items():
        head, _, rest = key.partition(".")
        field = field_for(type(instance), head)
        if rest:
            nested_changes.setdefault(field.name, {})[rest] = value
        else:
            values[field.name] = value
    for name, inner in nested_changes.items():
        key = key_without_unit(name)
        field_type = fields_by_key(type(instance))[key].metadata["kind"]
        before = field_type.parse(values.get(name, getattr(instance, name)), key)
        values[name] = _change_nested(field_type, before, inner, key)
    return dataclasses.replace(instance, **values)


def _change_nested(field_type: FieldType, value: Any, changes: Mapping[str, Any], where: str) -> Any:
    """The value of a field with changes inside it."""
    if isinstance(field_type, NestedList):
        return _change_entries(field_type, value, changes, where)
    if isinstance(field_type, TableType):
        return field_type.with_changes(value, changes, where)
    if not isinstance(field_type, Nested):
        raise UserError(f"{where}.{next(iter(changes))}", "unknown key", remedy=f"{where} has no parts")
    try:
        return with_changes(field_type.description() if value is None else value, changes)
    except UserError as error:
        raise error.inside(f"{where}.") from error


def _change_entries(
    field_type: NestedList, value: tuple[Any, ...], changes: Mapping[str, Any], where: str
) -> tuple[Any, ...]:
    """The tuple of a `NestedList` with changes in some entries: {"0.pitch": …}."""
    entries = list(value)
    for key, change in changes.items():
        index, _, rest = key.partition(".")
        if not rest or index not in map(str, range(len(entries))):
            expected = f"{where}.0 to {where}.{len(entries) - 1} and a key"
            raise UserError(f"{where}.{key}", "unknown key", expected=expected)
        entry_type = Nested(field_type.description)
        entries[int(index)] = _change_nested(entry_type, entries[int(index)], {rest: change}, f"{where}.{index}")
    return tuple(entries)


def hashable_value(value: Any) -> Any:
    """A hashable equivalent of a description, for equality and as a cache key."""
    if dataclasses.is_dataclass(value):
        return tuple(hashable_value(getattr(value, field.name)) for field in dataclasses.fields(value))
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    return tuple(hashable_value(v) for v in value) if isinstance(value, tuple) else value
