"""FILE… of the commands that show a hologram: whose it is, what the user knows of it, and what was read and why.

A preset's name or TOML file stands for a bench, any other name for a hologram's file: a file of holoview, or a complex
field of another program, whose parts may be in several files.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from holoview.commands.arguments import (
    add_fields,
    dest_of,
    given_fields,
    parse_assignment,
    parse_effects,
    system_from_args,
    with_changes,
)
from holoview.commands.console import print_stderr, progress_bar
from holoview.holograms.fields.field_file import FIELD_FORMAT
from holoview.holograms.fields.interpret.remembered import (
    over,
    remember,
    request_of_notes,
)
from holoview.holograms.files.request import (
    MOST_UNASKED,
    ReadRequest,
    WindowRequest,
)
from holoview.holograms.hologram import FORMAT, Hologram
from holoview.holograms.load_field import OpenedHologram, open_hologram
from holoview.light.model import preset
from holoview.light.model.fields import fields_by_key
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.safetensors_file import format_of

_COUNT = r"(?:\d++(?:\.\d++)?|\.\d++)"
_NEGATIVE = re.compile(rf"-{_COUNT}(?:,-?{_COUNT})*+ ?[a-zµ]*+$")
NAMES_HELP = "a preset's name (see `holoview presets`) or TOML file; or a hologram's file, or files that are its parts"
_LARGE_BYTES = 1 << 28  # of files: reading them is shown
_FLAGGED = {key: field for key, field in fields_by_key(ReadRequest).items() if field.metadata["flag"]}
_WINDOW = fields_by_key(WindowRequest)


_OPTIONS = {"file_note", *map(dest_of, (*_FLAGGED.values(), *_WINDOW.values()))} - {"guess", "propagation"}


def add_field_options(parser: argparse.ArgumentParser, *, has_plane: bool = True) -> None:
    """Adds the options that say what is known of a file of another program; see `request_from_args`.

    has_plane: whether the command has --plane, whose first one is the distance where nothing else tells it; otherwise
    it is another name of --distance.
    """
    parser._negative_number_matcher = _NEGATIVE  # so that "--plane -10cm" isn't taken for an option
    group = parser.add_argument_group("of a file of another program, what it doesn't say itself")
    degrees = {"region": _FLAGGED["aperture"].metadata["doc"]}  # which the same flag takes
    keys = [key for key in _FLAGGED if key != "aperture"]
    add_fields(group, ReadRequest, *keys, notes=degrees, defaults={"propagation": "auto"}, states_units=True)
    add_fields(group, WindowRequest, *_WINDOW, states_units=True)
    if not has_plane:
        group.add_argument("--plane", dest="distance", metavar="LENGTH", help="the same as --distance")
    group.add_argument(
        "--file-note",
        metavar="KEY=VALUE",
        nargs="+",
        action="extend",
        help="a key of the notes beside a file: phase_levels=255 colour_axis=last transposed=true …",
    )
    group.add_argument("--remember", action="store_true", help="keep these options beside the file, as TOML")


def request_from_args(args: argparse.Namespace) -> ReadRequest:
    """The statements of the options on a file. Raises UserError for lengths and words that aren't any."""
    is_angle = args.aperture is not None and "deg" in args.aperture.partition(",")[0]
    read: dict[str, Any] = {"region" if is_angle else "aperture_deg": None}
    if args.viewpoint is not None:
        if len(args.viewpoint) > 1:
            found = f"{len(args.viewpoint)} times"
            raise UserError("--viewpoint", found, expected="once; several times with render, compare")
        read["viewpoint"] = args.viewpoint[0]
    planes = getattr(args, "plane", None) or []
    first = planes if isinstance(planes, str) else next(iter(planes), None)
    if args.distance is None and first is not None and first != "all" and not first.rstrip().endswith("D"):
        read["distance_m"] = units.parse(first, "--plane")
    window = given_fields(args, WindowRequest)
    read["window"] = WindowRequest(**window) if window else None
    stated = ReadRequest(**given_fields(args, ReadRequest, read), most_samples=MOST_UNASKED)
    return over(stated, request_of_notes(_notes(args.file_note or ()), "--file-note ")) if args.file_note else stated


def _notes(texts: Sequence[str]) -> dict[str, Any]:
    """The table of notes that KEY=VALUE texts make; dots lead into the table "binary"."""
    table: dict[str, Any] = {}
    for text in texts:
        key, value = parse_assignment(text, "--file-note", "phase_levels=255")
        outer, dot, inner = key.partition(".")
        if dot:
            nested = table.setdefault(outer, {})
            if not isinstance(nested, dict):
                raise UserError(f"--file-note {key}", f"beside {outer}", expected="one of them")
            nested[inner] = value
        else:
            table[key] = value
    return table


def has_field_options(args: argparse.Namespace) -> bool:
    """Whether an option says something of a file of another program."""
    return any(getattr(args, name) not in (None, False) for name in _OPTIONS)


def check_no_field_options(args: argparse.Namespace, where: str) -> None:
    """Raises UserError if an option says something of a file, beside `where`, which isn't one."""
    for name in sorted(_OPTIONS):
        if getattr(args, name) not in (None, False):
            raise UserError(f"--{name.replace('_', '-')}", f"with {where}", expected="a file of another program")


def is_preset(name: str) -> bool:
    """Whether a name stands for a bench: it names a preset or a TOML file.

    Raises UserError, with similar names, for a name that is neither a preset's nor a file's.
    """
    if Path(name).suffix == ".toml" or (name in preset.names() and not Path(name).exists()):
        return True
    if Path(name).exists():
        return False
    if Path(name).suffix or Path(name).parent != Path():
        raise UserError(name, "there is no such file", expected="a file of a hologram")
    raise UserError(f'preset "{name}"', "unknown", remedy=suggest_matches(name, preset.names()))


def open_files(names: Sequence[str], args: argparse.Namespace) -> OpenedHologram:
    """The hologram of files with what the options say of them; prints what was guessed.

    Raises UserError as `open_hologram` does.
    """
    request = request_from_args(args)
    if args.distance is None and len(names) == 1 and format_of(names[0]) in (FORMAT, FIELD_FORMAT):
        request = replace(request, distance_m=None)  # --plane chooses one of its own planes, or another one
    size = sum(Path(name).stat().st_size for name in names if Path(name).is_file())
    with progress_bar("reading") if size > _LARGE_BYTES else nullcontext() as progress:
        opened = open_hologram(names, request, None if progress is None else lambda n, of: progress(n, of, "rows"))
    for note in opened.notes:
        print_stderr(f"note: {note}")
    if opened.moved_m and getattr(args, "plane", None):
        args.plane = _from_image(args.plane, opened.moved_m)
    if args.remember and opened.provenance:
        print_stderr(f"note: {remember(names[0], request)} remembers these options")
    return opened


def _from_image(planes: str | list[str], moved_m: float) -> str | list[str]:
    """The planes of --plane, counted from the image that a field was brought to."""
    if isinstance(planes, list):
        return [text for plane in planes for text in [_from_image(plane, moved_m)] if isinstance(text, str)]
    if planes == "all" or planes.rstrip().endswith("D"):
        return planes
    return units.format_exact(round(units.parse(planes, "--plane") - moved_m, 12), "mm")


@dataclass(frozen=True)
class ShownSystem:
    """A system and the drive that it shows; None of a preset.

    read: the properties that were read of files, for JSON; else empty. other_side: the system and the drive of the
    conjugate field, where its image is clearly sharper. light: the share of a field's light that its window holds.
    guesses: the properties that were guessed, for JSON; guess_notes: those that no note has told, as sentences.
    """

    system: System
    drive: Any
    read: dict[str, Any] = field(default_factory=dict)
    other_side: tuple[System, Any] | None = None
    light: float = 1.0
    guesses: list[dict[str, str]] = field(default_factory=list)
    guess_notes: tuple[str, ...] = ()


def shown_by_args(args: argparse.Namespace) -> ShownSystem:
    """The bench or the hologram that PRESET|FILE… of `args.names` names, with the changes of --set, --scheme and
    --effects.

    The name of a preset becomes `args.preset`. Raises UserError as `open_files` and `system_from_args` do.
    """
    names = args.names
    if len(names) == 1 and is_preset(names[0]):
        args.preset = names[0]
        check_no_field_options(args, f"the preset {names[0]}")
        return ShownSystem(system_from_args(args), None)
    if args.scheme is not None:
        raise UserError("--scheme", "with a hologram", expected="the lasers and frames that it was made for")
    effects = parse_effects(getattr(args, "switched_on", []))  # first: a bench may name effects of the user's files
    opened = open_files(names, args)

    def changed(hologram: Hologram) -> tuple[System, Any]:
        system = with_changes(hologram.system, args.changes, effects)
        return system, Hologram(hologram.drive, system).drive

    other = None if opened.other_side is None else changed(opened.other_side)
    guesses = [{"name": known.key, "value": known.value, "reason": known.reason} for known in opened.guesses]
    read = reading_as_json(opened, names)
    return ShownSystem(*changed(opened.hologram), read, other, opened.light, guesses, opened.guess_notes)


def reading_as_json(opened: OpenedHologram, names: Sequence[str]) -> dict[str, Any]:
    """The properties that were read or guessed, and the reasons, for --json."""
    system = opened.hologram.system
    return {
        "files": list(names),
        "kind": "field" if system.is_field else "patterns",
        "what": opened.hologram.field().describe() if system.is_field else system.description,
        "properties": [
            {"name": known.key, "value": known.value, "origin": known.origin, "reason": known.reason}
            for known in opened.provenance
        ],
        "notes": list(opened.notes),
    }
