"""The nominal stops of relays as attributes of a capture file's geometry and as keys of bench.toml.

    iris1_na, iris2_na       Relay.iris_na of relay 1, of relay 2
    square1, square2         Relay.square: half the side as an aperture, or text such as "first order at 550 nm"
    centre1_na, centre2_na   Relay.centre_na, [y, x]

A program that knows none but the irises reads these files too, without the others.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.model.bench_parts import Relay
from holoview.model.dataclass_fields import fields_by_key, to_mapping
from holoview.model.field_types import FieldType
from holoview.util.errors import UserError

_NAMES = {"iris_na": "iris{}_na", "square": "square{}", "centre_na": "centre{}_na"}

STOP_KEYS: Mapping[str, FieldType] = {
    name.format(number): fields_by_key(Relay)[field].metadata["kind"]
    for number in (1, 2)
    for field, name in _NAMES.items()
}
"""The field type of each attribute."""


def stops_from_attributes(attributes: Mapping[str, Any], number: int, where: str) -> Relay:
    """The stops of relay `number` (1 or 2) from attributes, others of which are ignored.

    where: what comes before an attribute's name in an error. Values may be those of HDF5: numpy numbers, arrays, bytes.
    Raises UserError, which names the attribute, for values that are no stops.
    """
    names = {field: name.format(number) for field, name in _NAMES.items()}
    values = {field: _plain(attributes[name]) for field, name in names.items() if name in attributes}
    try:
        return Relay(**values)
    except UserError as error:
        found_in, remedy = (_with_attribute_names(text, names) for text in (error.where, error.remedy))
        raise UserError(where + found_in, error.found, expected=error.expected, remedy=remedy) from error


def stop_attributes(relay: Relay, number: int) -> dict[str, Any]:
    """The attributes of the stops of relay `number`; without those of stops that it doesn't have."""
    stated = stated_keys(relay)
    return {name.format(number): stated[field] for field, name in _NAMES.items() if field in stated}


def has_only_stops(relay: Relay) -> bool:
    """Whether attributes can hold all of a relay: it has neither a DC block, nor apodisation, nor aberrations."""
    return stated_keys(relay).keys() <= _NAMES.keys()


def stated_keys(relay: Relay) -> dict[str, Any]:
    """The keys of a relay in presets whose values differ from those of a relay without anything, with their values."""
    clear = to_mapping(Relay())
    return {key: value for key, value in to_mapping(relay).items() if value != clear.get(key)}


def describe_stops(relay: Relay) -> str:
    """The iris and the square stop in words, for example "iris NA 0.03, square first order, centre [0, 0.002]"."""
    texts = [] if relay.iris_na is None else [f"iris NA {relay.iris_na:g}"]
    if relay.square is not None:
        texts.append(f"square {relay.square}")
    if any(relay.centre_na):
        texts.append("centre [{:g}, {:g}]".format(*relay.centre_na))
    return ", ".join(texts) or "none"


def _plain(value: Any) -> Any:
    """A number, a text or a list of numbers from an attribute's value as HDF5 libraries write it."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.item() if value.size == 1 else value.ravel().tolist()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _with_attribute_names(text: str, names: Mapping[str, str]) -> str:
    """A text about a relay with its keys replaced by the attributes' names."""
    return re.sub(rf"\b({'|'.join(names)})\b", lambda found: names[found[0]], text)
