"""Arguments that several subcommands share: the bench that they describe, numbers as values, the file to write."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from holoview.commands.console import print_stderr
from holoview.commands.output_files import add_input, add_output
from holoview.holograms.files.pictures import png_texts
from holoview.holograms.hologram import system_name_of
from holoview.holograms.targets.framing import FILL, Framing
from holoview.light.model import preset
from holoview.light.model.effects.registry import (
    NO_EFFECTS,
    ActiveEffects,
    EffectTable,
    EffectValues,
    load_user_effects,
)
from holoview.light.model.fields import (
    Duration,
    FileContent,
    Integer,
    Maybe,
    Number,
    Several,
    Shape,
    Span,
    Truth,
    Word,
    WrittenFile,
    fields_by_key,
    flag_of,
    key_without_unit,
)
from holoview.light.model.scheme import with_scheme
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.light.observers import load_observer, parse_observer
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.tables import parse_toml_value
from holoview.util.text import plain_name, printable


def add_system(parser: argparse.ArgumentParser, *, optional: bool = False, effects: bool = True) -> None:
    """Adds PRESET (which may be absent if `optional`), --scheme, --set and, with `effects`, --effects.

    `system_from_args` makes the System.
    """
    add_input(
        parser,
        "preset",
        nargs="?" if optional else None,
        help="a preset's name (see `holoview presets`) or a TOML file",
    )
    add_changes(parser)
    if effects:
        add_effects(parser, dest="switched_on")


def add_changes(parser: argparse.ArgumentParser) -> None:
    """Adds --scheme, --set KEY=VALUE, and --observer, a change of the bench like those of --set."""
    parser.add_argument(
        "--scheme",
        metavar="NAME",
        help="drive the bench by a colour scheme: simultaneous, time-sequential, multiplexed, holochrome-8x3, and "
        "+multisource-3x3, +1slm; before --set",
    )
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="changes",
        help='change the bench, e.g. --set gap="3 mm" --set relay2.iris_na=0.02; several may be given',
    )
    parser.add_argument(
        "--observer",
        metavar="WHO",
        action="append",
        dest="changes",
        type=_observer_change,
        help='who looks: eye, cie1931, cie1964, mono, "age 60, field 4", "person 17" (of 100), or a CSV file of the '
        "responses of three cones or of a camera",
    )


def _observer_change(text: str) -> str:
    """An argparse type: the change of a bench that an observer is; a file is read when the change is made."""
    try:
        who = text if _is_table(text) else parse_observer(text).text
    except UserError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return f"observer={json.dumps(who)}"


def _is_table(value: Any) -> bool:
    return isinstance(value, str) and value.lower().endswith(".csv")


def add_framing(parser: argparse._ActionsContainer) -> None:
    """Adds --framing, a `Framing`."""
    parser.add_argument(
        "--framing",
        metavar="HOW",
        type=_framing,
        default=FILL,
        help="how a picture of another aspect is placed: fill (cut off, the default), fit (black beside it), crop, or "
        "crop:X,Y,SHARE: a part by its centre and its share of the largest one, in fractions of the picture",
    )


def _framing(text: str) -> Framing:
    try:
        return Framing.parse(text)
    except UserError as error:
        raise argparse.ArgumentTypeError(f"{error.found}; expected {error.expected}") from None


def add_effects(parser: argparse.ArgumentParser, dest: str = "effects") -> None:
    """Adds --effects, for values of effects and Python files with the user's own effects; see `parse_effects`."""
    add_input(
        parser,
        "--effects",
        dest=dest,
        metavar="NAME.KEY=VALUE|FILE.py",
        nargs="+",
        action="extend",
        default=[],
        help='e.g. gap.gap_error="0.1 mm" crosstalk.sigma=0.4; a Python file that defines effects of your own is run',
    )


def add_backend(parser: argparse.ArgumentParser) -> None:
    """Adds --backend and --adapter; see `check_adapter_applies`."""
    parser.add_argument(
        "--backend", default="auto", help="wgpu (WGSL shaders), torch, torch64, or auto: wgpu where an adapter is found"
    )
    parser.add_argument("--adapter", metavar="NAME", help="part of the name of the WebGPU adapter to use")


def check_adapter_applies(args: argparse.Namespace) -> None:
    """Raises UserError for --adapter with a backend that uses none, which would ignore it."""
    if args.adapter is not None and args.backend.startswith("torch"):
        raise UserError("--adapter", f"with --backend {args.backend}", expected="--backend wgpu or auto")


_MOST_DIGITS = 9  # of a number of samples; Python refuses to convert thousands of them


def parse_region(text: str) -> Region:
    """The region that --region gives as X,Y,W,H. Raises UserError unless these are four whole numbers from 0."""
    expected = "x,y,width,height in whole samples, e.g. 100,80,64,64"
    x, y, width, height = parse_samples(text, 4, "--region", expected)
    return x, y, width, height


def checked_region(region: Region, shape: tuple[int, ...], flag: str) -> Region:
    """A region that lies inside an image of (rows, columns). Raises UserError, with the flag, for another."""
    x, y, width, height = region
    rows, columns = shape[0], shape[1]
    if width < 1 or height < 1 or x + width > columns or y + height > rows:
        found = ",".join(map(str, region))
        raise UserError(flag, found, expected=f"one sample or more, inside {columns} × {rows} of them (width × height)")
    return region


def parse_samples(text: str, count: int, flag: str, expected: str, between: str = ",") -> list[int]:
    """So many whole numbers from 0, with `between` between them. Raises UserError for other texts, with the flag."""
    parts = [part.strip() for part in text.split(between)]
    if len(parts) != count or not all(part.isdecimal() and len(part) <= _MOST_DIGITS for part in parts):
        raise UserError(flag, f'"{text}"', expected=expected)
    return [int(part) for part in parts]


def parse_range(text: str, flag: str) -> tuple[float, float]:
    """Two distances (m), the smaller first, as `units.parse_several` takes them. Raises UserError for any others."""
    lengths = units.parse_several(text, flag)
    if len(lengths) != 2 or not lengths[0] < lengths[1]:
        raise UserError(flag, f'"{text}"', expected="two distances, the smaller first, such as 5,40cm")
    return lengths[0], lengths[1]


def parse_duration(text: str) -> float:
    """An argparse type: seconds from text as a `Duration` takes it."""
    return _parsed(Duration().parse, text)


def parse_effects(texts: list[str]) -> dict[str, dict[str, float]]:
    """The values that --effects states, {effect id: {parameter: value in SI units}}.

    Python files among the texts are run first, with a message, so that values can be of the effects they define.
    """
    files = [text for text in texts if text.endswith(".py") and "=" not in text]
    for file in files:
        print_stderr(f"running {file} for its effects")
        load_user_effects(file)
    changes = dict(parse_assignment(text, "--effects", "gap.gap_error=0.1mm") for text in texts if text not in files)
    table = EffectTable().with_changes((), changes, "--effects")
    return {name: dict(values) for name, values in table}


def system_from_args(args: argparse.Namespace, base: System | None = None) -> System:
    """The preset with the effects of --effects, driven by --scheme, with the changes of --set.

    base: takes the place of the preset.
    """
    effects = parse_effects(getattr(args, "switched_on", []))  # first: the preset may name effects of the user's files
    system = base or preset.load(args.preset)
    return with_changes(system if args.scheme is None else with_scheme(system, args.scheme), args.changes, effects)


def with_changes(system: System, changes: list[str], effects: EffectValues = NO_EFFECTS) -> System:
    """A system with KEY=VALUE texts, and effects beside those that it has, applied together: an effect may act on what
    is changed. A value is read as TOML, or as plain text if it isn't TOML."""
    switched = {f"effects.{name}.{key}": value for name, table in effects.items() for key, value in table.items()}
    stated = dict(parse_assignment(change) for change in changes)
    if (observer := stated_observer(changes)) is not None:
        stated["observer"] = observer
    return system.edit({**switched, **stated}) if switched or stated else system


def stated_observer(changes: list[str]) -> Any:
    """The observer among KEY=VALUE texts, a table's being read; None without one."""
    found: Any = dict(parse_assignment(change) for change in changes).get("observer")
    return load_observer(found) if _is_table(found) else found


def warn_of_camera_effects(system: System) -> None:
    """Prints a note that names effects of the camera, which change captures but nothing that an observer sees."""
    if not system.effects:
        return
    if camera := [effect.id for effect in ActiveEffects(system.effect_values).camera_effects()]:
        belong = "belongs" if len(camera) == 1 else "belong"
        print_stderr(f"note: {', '.join(camera)} {belong} to the camera that took captures; eyes don't look through it")


def warn_of_limits(notes: Iterable[str]) -> None:
    """Prints where the model isn't true of what was computed, a note a line."""
    for note in notes:
        print_stderr(f"note: {note}")


def parse_assignment(text: str, flag: str = "--set", example: str = 'gap="3 mm"') -> tuple[str, Any]:
    """Key and value of KEY=VALUE; the value is read as TOML, or as plain text if it isn't TOML. Raises UserError."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise UserError(f"{flag} {text}", "isn't KEY=VALUE", expected=f"e.g. {flag} {example}")
    return key.strip(), parse_toml_value(value, f"{flag} {key.strip()}")


# --- numbers as values of options: finite and in range before a command begins ---
#
# Every option that takes a number has one of these types; options with a unit are parsed by `util.units`.


_LONGEST = 40  # characters; Python takes the square of the time for integers of many


def number(low: float = -1e30, high: float = 1e30) -> Callable[[str], float]:
    """An argparse type: a real number from `low` to `high`, both included, never NaN or infinite."""

    def parse(text: str) -> float:
        try:
            value = float(text) if len(text) <= _LONGEST else math.nan
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            expected = "a finite number" if (low, high) == (-1e30, 1e30) else f"a number from {low:g} to {high:g}"
            raise argparse.ArgumentTypeError(f"{_short(text)}; expected {expected}")
        return value

    return parse


def whole(low: int, high: int = 1_000_000) -> Callable[[str], int]:
    """An argparse type: a whole number from `low` to `high`, both included."""

    def parse(text: str) -> int:
        try:
            value = int(text) if len(text) <= _LONGEST else high + 1
        except ValueError:
            value = high + 1
        if not low <= value <= high:
            range = f"of at least {low}, at most {high}" if low else f"from 0 to {high}"
            raise argparse.ArgumentTypeError(f"{_short(text)}; expected a whole number {range}")
        return value

    return parse


parse_seed = whole(0, 2**63 - 1)
"""An argparse type: the seed of a random generator."""


def _short(text: str) -> str:
    return repr(text) if len(text) <= _LONGEST else f"{text[:20]!r}… of {len(text)} characters"


# --- flags of a description's fields: their types, sentences and defaults stand there ---


def add_fields(
    group: argparse._ActionsContainer,
    description: type[Any],
    *keys: str,
    more_words: tuple[str, ...] = (),
    notes: Mapping[str, str] | None = None,
    defaults: Mapping[str, Any] | None = None,
    states_units: bool = False,
) -> None:
    """Adds a flag for each of some fields; its value is None where it isn't given. `given_fields` makes the values.

    more_words: that a flag takes beside those of its field. notes: for the end of a flag's help. defaults: values of
    flags that aren't given, in place of None. states_units: a length is text such as "8 um", in place of a number in
    the field's unit.
    """
    known, defaults = fields_by_key(description), defaults or {}
    for key in keys:
        field = known[key]
        kind, item = _kinds(field)
        add: Callable[..., Any] = group.add_argument
        if isinstance(item, FileContent | WrittenFile):
            add = partial(add_input if isinstance(item, FileContent) else add_output, group)
        options = _flag_options(field, more_words, states_units)
        if key in defaults:
            options["default"] = defaults[key]
        unit = getattr(getattr(item, "item", item), "unit", "")
        default = _default_text(defaults.get(key, field.default), kind, unit)
        text = f"{field.metadata['doc']} {default}{(notes or {}).get(key, '')}".strip()
        add(flag_of(field), **options, help=text.replace("%", "%%"))


def _kinds(field: Field[Any]) -> tuple[Any, Any]:
    """The type of a field's value where there is one, and that of each of several values."""
    kind: Any = field.metadata["kind"]
    kind = kind.item if isinstance(kind, Maybe) else kind
    return kind, kind.item if isinstance(kind, Several) else kind


def _flag_options(field: Field[Any], more_words: tuple[str, ...], states_units: bool) -> dict[str, Any]:
    """What argparse is told of a field's type; the arguments are those of `add_fields`."""
    kind, item = _kinds(field)
    unit, notation = getattr(item, "unit", ""), getattr(item, "metavar", "")
    is_several = isinstance(kind, Several)
    many: dict[str, Any] = {"nargs": "+", "action": "extend"} if is_several else {}
    if notation:
        return {"metavar": notation} | ({"action": "append"} if item.is_appended else many)
    if isinstance(item, FileContent):
        return {"metavar": "FILE", "type": Path} | many
    if is_several and unit:
        stated = {"metavar": "LENGTH"} | many
        return stated if states_units else {"nargs": kind.count, "type": _in_unit(unit), "metavar": unit.upper()}
    if isinstance(kind, Span):
        return {"nargs": 2, "type": number(), "metavar": ("LOW", "HIGH")}
    if is_several:
        return {"metavar": "A,B,…"}
    if isinstance(kind, Word):
        return {"choices": (*kind.options, *more_words)}
    if isinstance(kind, Integer):
        parse, named = whole(kind.low, kind.high), dict(kind.named)
        return {
            "type": lambda text: named[text] if text in named else parse(text),
            "metavar": "|".join(["N", *named]),
        }
    if isinstance(kind, Number):
        name = unit or field.name[len(key_without_unit(field.name)) + 1 :] or dest_of(field)
        parse_text = number() if not unit else _length if states_units else _in_unit(unit)
        return {"type": parse_text, "metavar": "LENGTH" if states_units and unit else name.upper()}
    if isinstance(kind, Shape):
        return {"type": whole(2, kind.most), "nargs": 2, "metavar": "N"}
    if isinstance(kind, Duration):
        return {"type": parse_duration, "metavar": "TIME"}
    if isinstance(kind, Truth):
        is_open = isinstance(field.metadata["kind"], Maybe)
        return {"action": argparse.BooleanOptionalAction} if is_open else {"action": "store_true", "default": None}
    return {"metavar": "FILE", "suffix": kind.suffix} if isinstance(kind, WrittenFile) else {"metavar": "TEXT"}


def _in_unit(unit: str) -> Callable[[str], float]:
    """An argparse type: a number of some unit, in SI units."""
    scale, parse = units.parse(f"1 {unit}", "unit", units.quantity_of(unit)), number()
    return lambda text: parse(text) * scale


def _length(text: str) -> float:
    """An argparse type: metres from text such as "8 um"."""
    return _parsed(units.parse, text)


def _parsed(parse: Callable[[str, str], float], text: str) -> float:
    """What a function that raises UserError makes of text, as argparse wants it."""
    try:
        return parse(text, "")
    except UserError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _default_text(default: Any, kind: Any, unit: str) -> str:
    """A default in parentheses; "" for none, no limit and what isn't switched on."""
    values = default if isinstance(default, tuple) else (default,)
    values = tuple(
        value for value in values if value not in (None, "", math.inf, math.nan, MISSING) and value is not False
    )
    if isinstance(kind, Duration):
        shown = [units.format_duration(value) for value in values]
    else:
        shown = [units.format_rounded(value, unit) if unit else str(value) for value in values]
    return f"(default {', '.join(shown)})" if shown else ""


def dest_of(field: Field[Any]) -> str:
    """The name of a field's flag among the parsed arguments."""
    return flag_of(field)[2:].replace("-", "_")


def given_fields(
    args: argparse.Namespace, description: type[Any], instead: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """The values of the flags of `add_fields` that were given, by the names of their fields.

    instead: values by the names of their fields, in place of those in `args`; None for one that isn't given. Raises
    UserError, which names the flag, for a value out of its field's range.
    """
    fields = fields_by_key(description).values()
    values = {field: instead.get(field.name, getattr(args, dest_of(field), None)) for field in fields}
    return {
        field.name: field.metadata["kind"].parse(value, flag_of(field))
        for field, value in values.items()
        if value is not None
    }


# --- the file that a command writes when none is named; its name comes from a bench, which may be a stranger's ---


def default_output(system_name: str, target: str, suffix: str) -> Path:
    """A file in the present folder: SYSTEM.png, or SYSTEM-TARGET.safetensors.

    A file of that name is overwritten only if holoview wrote it for a bench of this name. Raises UserError otherwise.
    """
    name = plain_name(system_name, "hologram" if target else "holoview")
    path = Path(f"{name}-{plain_name(target, 'target')}{suffix}" if target else f"{name}{suffix}")
    if path.exists() and _system_name(path) != system_name:
        raise UserError(
            str(path),
            f'is there already, and holoview didn\'t write it for "{printable(system_name)}"',
            remedy="name the file to write with -o",
        )
    return path


def _system_name(path: Path) -> str | None:
    """The name of the bench for which holoview wrote a picture or hologram file; None for any other file."""
    if path.suffix == ".png":
        return png_texts(path).get("holoview.preset")
    return system_name_of(path)
