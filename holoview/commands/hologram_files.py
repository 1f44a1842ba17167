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
from typing import Any, get_args

from holoview.commands.arguments import (
    number,
    parse_assignment,
    parse_effects,
    parse_lengths,
    system_from_args,
    whole,
    with_changes,
)
from holoview.commands.console import print_stderr, progress_bar
from holoview.holograms.fields.field_file import FIELD_FORMAT
from holoview.holograms.fields.interpret.remembered import (
    over,
    parse_order,
    parse_shift,
    parse_steps,
    remember,
    request_of_notes,
)
from holoview.holograms.files.request import (
    MOST_UNASKED,
    Part,
    Propagation,
    Quantity,
    ReadRequest,
    RecordingKind,
    Viewpoint,
    WindowRequest,
)
from holoview.holograms.hologram import FORMAT, Hologram
from holoview.holograms.load_field import OpenedHologram, open_hologram
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.safetensors_file import format_of

_COUNT = r"(?:\d++(?:\.\d++)?|\.\d++)"
_NEGATIVE = re.compile(rf"-{_COUNT}(?:,-?{_COUNT})*+ ?[a-zµ]*+$")
NAMES_HELP = "a preset's name (see `holoview presets`) or TOML file; or a hologram's file, or files that are its parts"
_LARGE_BYTES = 1 << 28  # of files: reading them is shown
_OPTIONS = (
    "wavelength",
    "pitch",
    "distance",
    "recording",
    "quantity",
    "variable",
    "index",
    "parts",
    "conjugate",
    "file_note",
    "aperture",
    "decimate",
    "viewpoint",
    "colour_shift",
    "steps",
    "order",
    "window_centre",
    "window_size",
    "window_pitch",
)


def add_field_options(parser: argparse.ArgumentParser, *, has_plane: bool = True) -> None:
    """Adds the options that say what is known of a file of another program; see `request_from_args`.

    has_plane: whether the command has --plane, whose first one is the distance where nothing else tells it; otherwise
    it is another name of --distance.
    """
    parser._negative_number_matcher = _NEGATIVE  # so that "--plane -10cm" isn't taken for an option
    group = parser.add_argument_group("of a file of another program, what it doesn't say itself")
    several: dict[str, Any] = {"nargs": "+", "action": "extend"}
    group.add_argument("--wavelength", metavar="LENGTH", **several, help="of each colour in the file's order")
    group.add_argument("--pitch", metavar="LENGTH", nargs="+", help="between samples, e.g. 8um; two of them: y, then x")
    names = ["--distance"] if has_plane else ["--distance", "--plane"]
    group.add_argument(*names, metavar="LENGTH", help="to the image; negative where it lies before the plane")
    group.add_argument("--quantity", choices=get_args(Quantity), help="what the numbers are")
    group.add_argument("--variable", metavar="NAME", help="which array, where a file holds several")
    group.add_argument(
        "--parts", metavar="A,B", help="what each of several files is: real,imaginary; amplitude,phase; r,g,b; frame,…"
    )
    group.add_argument("--index", metavar="N", type=number(0.1, 10), help="refractive index; wavelengths are divided")
    group.add_argument(
        "--propagation",
        choices=get_args(Propagation),
        default="auto",
        help="to its distance: asm, the angular spectrum in the field's own window; one transform for far images",
    )
    group.add_argument(
        "--window-centre",
        metavar="X,Y",
        help="see its image in a window around this place beside the axis: 3,0mm; the axis if absent",
    )
    group.add_argument("--window-size", metavar="W[,H]", help="width and height of this window; the field's if absent")
    group.add_argument("--window-pitch", metavar="LENGTH", help="between its samples; the field's pitch if absent")
    group.add_argument("--conjugate", action="store_true", help="phases were written with the other sign: exp(-iφ)")
    group.add_argument(
        "--file-note",
        metavar="KEY=VALUE",
        **several,
        help="a key of the notes beside a file: phase_levels=255 colour_axis=last transposed=true …",
    )
    _add_recording_options(group)
    _add_part_options(group)
    group.add_argument("--guess", action="store_true", help="take guesses for what nothing tells, and say them")
    group.add_argument("--remember", action="store_true", help="keep these options beside the file, as TOML")


def _add_recording_options(group: argparse._ArgumentGroup) -> None:
    several: dict[str, Any] = {"nargs": "+", "action": "extend"}
    group.add_argument("--recording", choices=get_args(RecordingKind), help="how a camera recorded it; none: it didn't")
    group.add_argument(
        "--steps",
        metavar="DEGREES",
        help="of a phase-shifting set: 0,90,180,270 of the pictures' reference, equal (if absent), or unknown: found",
    )
    group.add_argument(
        "--order",
        metavar="FX,FY[,RADIUS]",
        **several,
        help="of an off-axis recording, in cycles a pixel, one for each wavelength or for all; found if absent",
    )
    group.add_argument(
        "--dark-field",
        action=argparse.BooleanOptionalAction,
        help="of an in-line recording: without its beam; if absent, where its frame's fringes hide the objects",
    )


def _add_part_options(group: argparse._ArgumentGroup) -> None:
    several: dict[str, Any] = {"nargs": "+", "action": "extend"}
    group.add_argument(
        "--aperture",
        metavar="PART",
        help="read a part: X,Y,WIDTH,HEIGHT in samples from the upper left; or a square of degrees as seen from "
        "the image, 2deg in the middle, 2deg,X,Y with its centre at X, Y degrees",
    )
    group.add_argument(
        "--viewpoint",
        metavar="X,Y,SIZE",
        action="append",
        help="see it through a square part, the rest being dark: its place from -1 (left, upper edge) to 1, and its "
        "side in samples or degrees as seen from the image: -1,0,2deg; render and compare take it several times",
    )
    group.add_argument(
        "--colour-shift",
        metavar="X,Y",
        **several,
        help="move the field of each colour by these lengths, one pair for each: 0,0um 12,-3um 5,5um",
    )
    group.add_argument(
        "--decimate", metavar="N", type=whole(1), help="the mean of N × N samples becomes one: a view of a large whole"
    )


def request_from_args(args: argparse.Namespace) -> ReadRequest:
    """The statements of the options on a file. Raises UserError for lengths and words that aren't any."""
    pitch = None if args.pitch is None else [units.parse(text, "--pitch") for text in args.pitch]
    if pitch is not None and len(pitch) > 2:
        raise UserError("--pitch", f"{len(pitch)} lengths", expected="one, or two: along y and along x")
    planes = getattr(args, "plane", None) or []
    first = planes if isinstance(planes, str) else next(iter(planes), None)
    distance = args.distance or (None if first is None or first == "all" or first.rstrip().endswith("D") else first)
    parts = tuple(part.strip() for part in args.parts.split(",")) if args.parts else ()
    for part in parts:
        if part not in get_args(Part):
            raise UserError("--parts", f'"{part}"', expected=", ".join(get_args(Part)))
    stated = ReadRequest(
        pitch_m=None if pitch is None else (pitch[0], pitch[-1]),
        wavelengths_m=tuple(units.parse(text, "--wavelength") for text in args.wavelength or ()),
        distance_m=None if distance is None else units.parse(distance, "--distance" if args.distance else "--plane"),
        quantity=args.quantity,
        variable=args.variable,
        parts=parts,
        recording=args.recording,
        steps=None if args.steps is None else parse_steps(_numbers(args.steps)),
        orders=tuple(parse_order(_numbers(text)) for text in args.order or ()),
        dark_field=args.dark_field,
        refractive_index=args.index,
        conjugated=True if args.conjugate else None,
        accept_guesses=args.guess,
        propagation=args.propagation,
        window=_window(args),
        decimate=args.decimate or 1,
        most_samples=MOST_UNASKED,
        viewpoint=None if args.viewpoint is None else _only_viewpoint(*args.viewpoint),
        colour_shifts_m=tuple(parse_shift(list(parse_lengths(t, "--colour-shift"))) for t in args.colour_shift or ()),
        **_aperture(args.aperture),
    )
    return over(stated, request_of_notes(_notes(args.file_note or ()), "--file-note ")) if args.file_note else stated


def _window(args: argparse.Namespace) -> WindowRequest | None:
    """The window that --window-centre, --window-size and --window-pitch state; None without them.

    Raises UserError for texts that aren't lengths, and for too many of them.
    """
    centre, size, pitch = args.window_centre, args.window_size, args.window_pitch
    if centre is None and size is None and pitch is None:
        return None
    place = (0.0, 0.0) if centre is None else tuple(parse_lengths(centre, "--window-centre"))
    sides = None if size is None else tuple(parse_lengths(size, "--window-size"))
    if len(place) != 2:
        raise UserError("--window-centre", f'"{centre}"', expected="x,y with a unit, such as 3,0mm")
    if sides is not None and len(sides) > 2:
        raise UserError("--window-size", f'"{size}"', expected="a width and a height, or one length for both")
    pitch_m = None if pitch is None else units.parse(pitch, "--window-pitch")
    return WindowRequest((place[1], place[0]), None if sides is None else (sides[-1], sides[0]), pitch_m)


def _numbers(text: str) -> Any:
    """The numbers of a text with commas, also with the unit deg; the text itself where it holds anything else."""
    try:
        return [float(part.removesuffix("deg")) for part in text.replace(" ", "").split(",")]
    except ValueError:
        return text


def _only_viewpoint(text: str, *others: str) -> Viewpoint:
    """The viewpoint that --viewpoint states. Raises UserError for other texts, and for several."""
    if others:
        raise UserError("--viewpoint", f"{1 + len(others)} times", expected="once; several times with render, compare")
    return parse_viewpoint(text)


def parse_viewpoint(text: str) -> Viewpoint:
    """The viewpoint that a text such as -1,0,2deg states. Raises UserError for other texts."""
    numbers = _numbers(text)
    if isinstance(numbers, str) or len(numbers) != 3:
        expected = "x,y,size: places from -1 to 1, and a side of samples or degrees, such as -1,0,2deg"
        raise UserError("--viewpoint", f'"{text}"', expected=expected)
    return Viewpoint((numbers[0], numbers[1]), numbers[2], text.strip().endswith("deg"))


def _aperture(text: str | None) -> dict[str, Any]:
    """The part of a file that --aperture states, as a field of a request. Raises UserError for other texts."""
    if text is None:
        return {}
    size, *centre = text.replace(" ", "").split(",")
    try:
        if size.endswith("deg") and len(centre) in (0, 2):
            x, y = (float(part.removesuffix("deg")) for part in centre or ("0", "0"))
            return {"aperture_deg": (float(size.removesuffix("deg")), x, y)}
        x0, y0, width, height = map(int, (size, *centre))
        return {"region": (x0, y0, width, height)}
    except ValueError:
        expected = "x,y,width,height in whole samples, or degrees such as 2deg or 2deg,1,0"
        raise UserError("--aperture", f'"{text}"', expected=expected) from None


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
    for name in _OPTIONS:
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
