"""The notes beside a file: what a user said about it, in FILE.holoview.toml."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

import tomli_w

from holoview.holograms.files.request import LengthPair, Notation, ReadRequest
from holoview.light.model.fields import Several, fields_by_key
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import read_text
from holoview.util.tables import check_keys, parse_toml

_SUFFIX = ".holoview.toml"
_EXPECTED = "notes on a hologram's file"
_WISHES = ("region", "aperture", "viewpoint", "most_samples", "decimate", "accept_guesses", "propagation", "window")
_NOTES = {key: field for key, field in fields_by_key(ReadRequest).items() if key not in _WISHES}
_MOST = 64  # entries of a list


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
    check_keys(table, _NOTES, where)
    try:
        return ReadRequest(**{_NOTES[key].name: _statement(key, value) for key, value in table.items()})
    except UserError as error:
        raise error.inside(where) from error


def _statement(key: str, value: Any) -> Any:
    """A note as `ReadRequest` takes it: lists of numbers with a notation of their own become text in that notation."""
    kind = _NOTES[key].metadata["kind"]
    if not isinstance(value, list):
        return [value] if isinstance(kind, Several) and isinstance(value, float) else value
    if not 1 <= len(value) <= _MOST:
        raise UserError(key, f"{len(value)} entries", expected="one or a few")
    item = getattr(kind, "item", kind)
    unit = " m" if isinstance(item, LengthPair) else ""

    def text(entry: Any) -> Any:
        is_list = isinstance(entry, list) and isinstance(item, Notation)
        return ",".join(n if isinstance(n, str) else f"{n}{unit}" for n in entry) if is_list else entry

    return [text(entry) for entry in value] if isinstance(kind, Several) else text(value)


def remember(path: str | os.PathLike[str], request: ReadRequest) -> Path:
    """Writes what a request says about a file beside it, with what is remembered already; returns the notes' name.

    What is wanted of a file (a region, decimation) isn't a property of it and isn't remembered.
    Raises UserError for notes that are wrong, WriteError where none can be written.
    """
    merged = over(request, read_notes(Path(path)))
    stated = {key: getattr(merged, field.name) for key, field in _NOTES.items()}
    written = {key: _NOTES[key].metadata["kind"].to_toml(value) for key, value in stated.items() if value != ()}
    table = {key: value for key, value in written.items() if value is not None}
    notes = notes_path(Path(path))
    write_file(notes, tomli_w.dumps(table), follows_links=False)
    return notes


def over(given: ReadRequest, remembered: ReadRequest) -> ReadRequest:
    """The given request, with what is remembered where it says nothing; steps and orders belong to their recording."""
    if given.recording not in (None, remembered.recording):
        remembered = dataclasses.replace(remembered, steps=None, orders=())
    names = [field.name for field in _NOTES.values() if getattr(given, field.name) in (None, ())]
    return dataclasses.replace(given, **{name: getattr(remembered, name) for name in names})
