"""Reads and writes Systems as TOML files with units, without losing a digit.

A preset may inherit from another one, `base = "holochrome-8"`, and state only what differs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import tomli_w

from holoview.light.model.effects.effect import FileParameter
from holoview.light.model.effects.on_element import split_id
from holoview.light.model.effects.registry import effect_or_twin
from holoview.light.model.fields import from_mapping, to_mapping
from holoview.light.model.shorthand import expand_table
from holoview.light.model.system import System
from holoview.util.errors import UserError, suggest_matches
from holoview.util.file_writer import write_file
from holoview.util.files import data_dir, read_text, require_file
from holoview.util.tables import parse_toml

_FILE, _REMEDY = "a preset's TOML file", "`holoview presets` lists names"
_MAX_BASES = 32
_LISTS = ("modulators", "elements")
_SHORT = ("modulators", "gap", "relay1", "relay2")
_TABLES = ("source", "relay1", "relay2", "eye", "sampling", "effects")


def names() -> list[str]:
    """Names of the presets that are part of holoview."""
    return sorted(path.stem for path in data_dir("presets").glob("*.toml"))


@cache
def short_form_names() -> tuple[str, ...]:
    """Names of those whose bench has one or two equal phase modulators, which the window compares others with."""
    return tuple(name for name in names() if not load(name).is_chain)


def load(preset: str | os.PathLike[str]) -> System:
    """The system of a preset.

    preset: the name of a preset that is part of holoview (`holoview presets` lists them), or the path of a TOML file.

    Returns a `System` with all values in SI units. Raises UserError for an unknown name (similar names are suggested),
    for a file that can't be read or isn't TOML, and for every wrong key or value, named with its place in the file.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8")
    >>> system.name, system.drive_shape
    ('holochrome-8', (1, 2, 384, 512))
    """
    path = _find(preset)
    try:
        table = _with_base(path, seen=())
        table.setdefault("name", path.stem)
        return from_table(table)
    except UserError as error:
        raise error if error.where.startswith(str(path)) else error.inside(f"{path}: ") from error


def loads(text: str, where: str = "preset", folder: Path | None = None) -> System:
    """The system of a TOML text, such as the metadata of a hologram file.

    where: names the text in errors. folder: from where paths of effects' files count, the present folder if None.
    """
    try:
        table = _parse(text, where)
        return from_table(table if folder is None else _map_file_paths(table, folder.resolve(), _absolute_path))
    except UserError as error:
        raise error if error.where.startswith(where) else error.inside(f"{where}: ") from error


def from_table(table: Mapping[str, Any]) -> System:
    """The system of a parsed TOML table, which may use shorthands."""
    beside = [key for key in _SHORT if key in table]
    if "elements" in table and beside:
        raise UserError(beside[0], "beside [[elements]]", expected="one of them: spaces have their distances and stops")
    if {"wavelengths", "amplitudes"} <= table.keys() and table.keys().isdisjoint(("elements", "modulators")):
        raise UserError("modulators", "is missing", expected="One or two phase modulators, or other [[elements]].")
    system: System = from_mapping(System, expand_table(table))
    return system


def dumps(system: System, folder: Path | None = None) -> str:
    """The system as TOML text with units; `loads` gives an equal system back.

    folder: to which paths of effects' files are made relative where they lie in it, and absolute elsewhere; as they
    are if None.
    """
    table = _to_table(system)
    if folder is not None:
        table = _map_file_paths(table, folder.resolve(), _relative_path)
    return tomli_w.dumps(table, multiline_strings=False)


def save(system: System, path: str | os.PathLike[str]) -> None:
    """Writes the system as a preset file, atomically. Paths of effects' files become relative to its folder."""
    write_file(path, dumps(system, Path(path).resolve().parent))


def _to_table(system: System) -> dict[str, Any]:
    """The system as a TOML table: name and description first, nested tables last, as TOML requires."""
    table = to_mapping(system)
    is_short = not system.is_chain and not any(element.name for element in system.elements)
    for key in ("elements",) if is_short else _SHORT:
        table.pop(key, None)
    head = {key: table[key] for key in ("name", "description") if key in table}
    plain = {key: value for key, value in table.items() if key not in (*_TABLES, *_LISTS, *head)}
    nested = {key: table[key] for key in (*_LISTS, *_TABLES) if key in table}
    return head | plain | nested


def _find(preset: str | os.PathLike[str]) -> Path:
    """The file of a preset's name or path."""
    path = Path(preset)
    if path.suffix == ".toml" or path.parent != Path():
        return require_file(path, _FILE, _REMEDY)
    if path.name not in names():
        raise UserError(f'preset "{preset}"', "unknown", remedy=suggest_matches(str(preset), names()))
    return data_dir("presets") / f"{path.name}.toml"


def _with_base(path: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    """The table of a file over those that it inherits from; `seen` are the files that led to it."""
    path = require_file(path, _FILE, _REMEDY).resolve()
    if path in seen:
        raise UserError(str(path), "its base leads back to itself", expected="a base that ends at a complete preset")
    if len(seen) == _MAX_BASES:
        raise UserError(str(path), f"is the base of {_MAX_BASES} presets on each other", expected="fewer")
    table = _parse(read_text(path, _FILE), str(path))
    table = _map_file_paths(table, path.parent, _absolute_path)
    base = table.pop("base", None)
    if base is None:
        return table
    if not isinstance(base, str):
        raise UserError(f"{path}: base", f"{base!r}", expected="a preset's name or path")
    beside = path.parent / f"{base}"
    inherited = _with_base(beside if beside.suffix == ".toml" else _find(base), (*seen, path))
    if "elements" in table:  # which take the place of the base's
        inherited = {key: value for key, value in inherited.items() if key not in _SHORT}
    elif any(key in table for key in _SHORT):
        inherited = {key: value for key, value in inherited.items() if key not in ("elements", "planes_from")}
    return _merged({key: value for key, value in inherited.items() if key not in ("name", "description")}, table)


def _map_file_paths(table: dict[str, Any], folder: Path, change: Callable[[Any, Path], Any]) -> dict[str, Any]:
    """The table with `change(path, folder)` applied to the paths of its masks' files and of its effects' files."""
    elements = table.get("elements")
    if isinstance(elements, list):
        table = table | {"elements": [_map_mask_file(each, folder, change) for each in elements]}
    effects = table.get("effects")
    if not isinstance(effects, dict):
        return table
    changed: dict[str, Any] = {}
    for name, values in effects.items():
        files = {p.name for p in effect_or_twin(split_id(name)[0]).parameters if isinstance(p, FileParameter)}
        has_files = isinstance(values, dict) and files
        changed[name] = {k: change(v, folder) if k in files else v for k, v in values.items()} if has_files else values
    return table | {"effects": changed}


def _map_mask_file(element: Any, folder: Path, change: Callable[[Any, Path], Any]) -> Any:
    """The table of an element with `change(path, folder)` applied to its file, if it has one."""
    has_file = isinstance(element, dict) and element.get("file")
    return element | {"file": change(element["file"], folder)} if has_file else element


def _absolute_path(file: Any, folder: Path) -> Any:
    """A path beside the preset as an absolute one; a value that isn't text stays, and is refused where it is read."""
    return str(folder / file) if isinstance(file, str) else file


def _relative_path(file: Any, folder: Path) -> Any:
    """Relative to the folder if the file lies in it, else absolute; a value that isn't text stays."""
    if not isinstance(file, str):
        return file
    path = Path(file).resolve()
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`base` with `changes`, table by table; a list or a plain value is replaced as a whole."""
    out = dict(base)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(out.get(key), dict)
        out[key] = _merged(out[key], value) if both else value
    return out


def _parse(text: str, where: str) -> dict[str, Any]:
    """The table of a TOML text."""
    return parse_toml(text, where, "a preset in TOML")
