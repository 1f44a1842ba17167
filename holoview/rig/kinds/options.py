"""A device's own keys in rig.toml: types, unknown and missing ones, and the class that one of them names."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from holoview.model.fields import Choice
from holoview.rig.description import DeviceSpec, RigDescription
from holoview.util.errors import UserError, suggest_matches

Parse = Callable[[Any, str], Any]
"""Checks a value that stands in the place of the second argument; `FieldType.parse` is one."""


def option_place(rig: RigDescription, spec: DeviceSpec) -> str:
    """How errors name a device's table."""
    return f"{rig.path}: {spec.name}"


def parse_options(
    rig: RigDescription, spec: DeviceSpec, types: Mapping[str, Parse], required: Iterable[str] = ()
) -> dict[str, Any]:
    """The checked values of a device's options. Raises UserError for unknown, missing and wrong ones."""
    where = option_place(rig, spec)
    for key in spec.options:
        if key not in types:
            found = f'unknown option of device = "{spec.kind}"'
            raise UserError(f"{where}.{key}", found, remedy=suggest_matches(key, types))
    for key in required:
        if key not in spec.options:
            raise UserError(f"{where}.{key}", "is missing", expected=f'an option of device = "{spec.kind}"')
    return {key: types[key](value, f"{where}.{key}") for key, value in spec.options.items()}


def require_device(rig: RigDescription, spec: DeviceSpec, offered: Mapping[str, Any]) -> Any:
    """What is offered for this device. offered: by its table in rig.toml. Raises UserError if there is nothing."""
    name = "slm" if spec.name in ("slm1", "slm2") else spec.name
    if name not in offered:
        where, expected = f"{option_place(rig, spec)}.device", ", ".join(offered)
        raise UserError(where, f'"{spec.kind}" has no {name}', expected=f"this kind for: {expected}")
    return offered[name]


def text(value: Any, where: str) -> str:
    """A text."""
    return Choice().parse(value, where)


def texts(value: Any, where: str) -> tuple[str, ...]:
    """One text, or several in a list."""
    if isinstance(value, list):
        return tuple(text(item, f"{where}[{number}]") for number, item in enumerate(value))
    return (text(value, where),)


def table(value: Any, where: str) -> dict[str, Any]:
    """A table of arguments."""
    if not isinstance(value, Mapping):
        raise UserError(where, f"{value!r}", expected="a table such as { serial = 3 }")
    return dict(value)


def find_class(path: str, where: str) -> Any:
    """The class of a dotted path. Raises UserError where a module or the class is missing or can't be loaded.

    What libraries warn of while they are imported, mostly that other makers' hardware isn't there, isn't shown.
    """
    module_name, _, name = path.rpartition(".")
    if not module_name:
        raise UserError(where, f'"{path}"', expected="the dotted path of a class")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            module = importlib.import_module(module_name)
        except Exception as error:  # the module's own code runs
            found = f'"{module_name}" can\'t be imported: {type(error).__name__}: {error}'
            raise UserError(where, found, expected="the dotted path of a class") from error
    if not callable(found_class := getattr(module, name, None)):
        known = [key for key, value in vars(module).items() if isinstance(value, type)]
        raise UserError(where, f'"{module_name}" has no class "{name}"', remedy=suggest_matches(name, known))
    return found_class
