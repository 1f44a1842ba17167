"""The notes beside a file: what a user said about it, in FILE.holoview.toml."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from holoview.holograms.files.request import BinaryLayout, Order, ReadRequest, Steps
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import read_text
from holoview.util.tables import check_keys, parse_toml

_SUFFIX = ".holoview.toml"
_EXPECTED = "notes on a hologram's file"
_LENGTHS = {
    "pitch_m": ("pitch", "um"),
    "wavelengths_m": ("wavelengths", "nm"),
    "distance_m": ("distance", "mm"),
    "reference_radius_m": ("reference_radius", "mm"),
}
_PLAIN: dict[str, type | tuple[type, ...]] = {
    "quantity": str,
    "variable": str,
    "parts": list,
    "recording": str,
    "steps": (list, str),
    "orders": list,
    "dark_field": bool,
    "colour_shifts_m": list,
    "refractive_index": (int, float),
    "conjugated": bool,
    "checkerboard": bool,
    "phase_levels": (int, float),
    "colour_axis": str,
    "transposed": bool,
}
_BINARY: dict[str, type] = {
    "dtype": str, "shape": list, "offset": int, "order": str, "parts": list, "interleaved": bool
}  # fmt: skip


def notes_path(path: Path) -> Path:
    """The name of the notes beside a file."""
    return path.with_name(path.name + _SUFFIX)


def read_notes(path: Path) -> ReadRequest:
    """The remembered statements about a file, none without notes. Raises UserError for notes that are wrong."""
    notes = notes_path(path)
    if not notes.exists():
        return ReadRequest()
    return request_of_notes(parse_toml(read_text(notes, _EXPECTED), str(notes), _EXPECTED), f"{notes}: ")


def request_of_notes(table: dict[str, Any], where: str) -> ReadRequest:
    """The statements in a table of notes; `where` names the table in errors. Raises UserError for wrong notes."""
    names = {name: key for key, (name, _) in _LENGTHS.items()} | {
        key.removesuffix("_m"): key for key in (*_PLAIN, "binary")
    }
    check_keys(table, names, where)
    try:
        return ReadRequest(**{names[name]: _parse(names[name], value) for name, value in table.items()})
    except UserError as error:
        raise error.inside(where) from error


def remember(path: str | os.PathLike[str], request: ReadRequest) -> Path:
    """Writes what a request says about a file beside it, with what is remembered already; returns the notes' name.

    What is wanted of a file (a region, decimation) isn't a property of it and isn't remembered.
    Raises UserError for notes that are wrong, WriteError where none can be written.
    """
    merged = over(request, read_notes(Path(path)))
    table: dict[str, Any] = {}
    for key, (name, unit) in _LENGTHS.items():
        value = getattr(merged, key)
        if isinstance(value, tuple) and value:
            table[name] = [units.format_exact(length, unit) for length in value]
        elif isinstance(value, float | int):
            table[name] = units.format_exact(value, unit)
    for key in _PLAIN:
        value = getattr(merged, key)
        if value is not None and value != ():
            table[key.removesuffix("_m")] = _TO_NOTES.get(key, _plain)(value)
    if merged.binary is not None:
        entries = dataclasses.asdict(merged.binary).items()
        table["binary"] = {k: list(v) if isinstance(v, tuple) else v for k, v in entries if v is not None}
    notes = notes_path(Path(path))
    write_file(notes, tomli_w.dumps(table), follows_links=False)
    return notes


def over(given: ReadRequest, remembered: ReadRequest) -> ReadRequest:
    """The given request, with what is remembered where it says nothing; steps and orders belong to their recording."""
    if given.recording not in (None, remembered.recording):
        remembered = dataclasses.replace(remembered, steps=None, orders=())
    found = {key: getattr(remembered, key) for key in (*_LENGTHS, *_PLAIN, "binary")}
    return dataclasses.replace(
        given, **{key: value for key, value in found.items() if getattr(given, key) in (None, ())}
    )


def _parse(key: str, value: Any) -> Any:
    if key in _LENGTHS:
        name = _LENGTHS[key][0]
        values = value if isinstance(value, list) else [value]
        if not 1 <= len(values) <= 64:
            raise UserError(name, f"{len(values)} lengths", expected="one or a few")
        lengths = tuple(units.parse(v, name) for v in values)
        if key == "pitch_m":
            return (lengths[0], lengths[-1])
        return lengths if key == "wavelengths_m" else lengths[0]
    if key == "binary":
        return _parse_binary(value)
    if key == "steps":
        return parse_steps(value)
    if key == "orders":
        return tuple(parse_order(order) for order in _each(key, value))
    if key == "colour_shifts_m":
        return tuple(parse_shift(shift) for shift in _each(key, value))
    return _typed(key, value, _PLAIN[key])


def _each(key: str, value: Any) -> list[Any]:
    if not isinstance(value, list) or not 1 <= len(value) <= 64:
        raise UserError(key, f"{value!r}", expected="a list")
    return value


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _steps_in_degrees(steps: Steps) -> Any:
    return steps if isinstance(steps, str) else [round(math.degrees(step), 9) for step in steps]


def _orders_as_numbers(orders: tuple[Order, ...]) -> list[list[float]]:
    return [[order.carrier[1], order.carrier[0], order.radius] for order in orders]


def _shifts_as_lengths(shifts_m: tuple[tuple[float, float], ...]) -> list[list[str]]:
    return [[units.format_exact(length, "um") for length in (x, y)] for y, x in shifts_m]


_TO_NOTES: dict[str, Callable[[Any], Any]] = {
    "steps": _steps_in_degrees,
    "orders": _orders_as_numbers,
    "colour_shifts_m": _shifts_as_lengths,
}


def parse_steps(value: Any) -> Steps:
    """The steps that "equal", "unknown" or a list of degrees states. Raises UserError for anything else."""
    if value in ("equal", "unknown"):
        return value
    if isinstance(value, str) or not _are_numbers(value, 3, 64):
        raise UserError("steps", f"{value!r}", expected="degrees, one a picture, such as 0,90,180,270; or unknown")
    return tuple(math.radians(step) for step in value)


def parse_order(value: Any) -> Order:
    """The order that a list of f_x, f_y and a radius states, half its distance from the middle if there is no radius.

    Raises UserError for anything else.
    """
    if not _are_numbers(value, 2, 3):
        raise UserError("order", f"{value!r}", expected="f_x,f_y or f_x,f_y,radius in cycles a pixel: 0.25,0.2")
    x, y, *radius = value
    return Order((float(y), float(x)), float(radius[0]) if radius else math.hypot(x, y) / 2)


def parse_shift(value: Any) -> tuple[float, float]:
    """The shift (y, x), m, that a list of lengths along x and y states. Raises UserError for anything else."""
    if not isinstance(value, list) or len(value) != 2:
        raise UserError("colour shift", f"{value!r}", expected="two lengths, along x and y, such as 12,-3um")
    x, y = (units.parse(length, "colour shift") for length in value)
    return y, x


def _are_numbers(value: Any, least: int, most: int) -> bool:
    is_list = isinstance(value, list) and least <= len(value) <= most
    return is_list and all(isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n) for n in value)


def _typed(key: str, value: Any, kind: type | tuple[type, ...]) -> Any:
    is_flag = isinstance(value, bool)
    if not isinstance(value, kind) or (is_flag and kind is not bool):
        raise UserError(key, f"{value!r}", expected=_WORDS.get(kind, "a number"))
    if isinstance(value, list):
        if not all(isinstance(v, str | int) and not isinstance(v, bool) for v in value) or len(value) > 64:
            raise UserError(key, f"{value!r}", expected="a short list of words or whole numbers")
        return tuple(value)
    return value


_WORDS: dict[Any, str] = {str: "text", bool: "true or false", list: "a list", int: "a whole number"}


def _parse_binary(value: Any) -> BinaryLayout:
    if not isinstance(value, dict):
        raise UserError("binary", f"{value!r}", expected="a table with dtype and shape")
    check_keys(value, _BINARY, "binary.", required=("dtype", "shape"), expected="the layout of the numbers")
    return BinaryLayout(**{k: _typed(f"binary.{k}", v, _BINARY[k]) for k, v in value.items()})
