"""Mistakes in the class of an effect, found before any of its hooks is called: unknown places, misspelt hooks, ranges.

An effect whose hook is misspelt, or acts on a place that doesn't exist, would change nothing without a word.
"""

from __future__ import annotations

import inspect
import math
import re
import string
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from types import CodeType
from typing import Any

from holoview.light.model.effects.effect import (
    HOOKS,
    MODULATOR_HOOKS,
    PLACES,
    Effect,
    ListParameter,
    Needs,
    Parameter,
    StartKind,
)
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches

_REQUIRED = ("id", "cause", "finding", "parameters", "acts_on")
_NAME = re.compile(r"[\w-]+")
_MOST_SCANNED = 10_000  # values of one parameter, each a prediction of every screened capture
_WHOLE = 1e-3  # by how much the number of steps of a scan may miss a whole number
_START_PARAMETERS = {
    StartKind.GHOST: ("strength", "shift_y", "shift_x"),
    StartKind.SMEAR: ("length_y", "length_x"),
    StartKind.CAMERA_FRINGES: ("path_y", "path_x", "cos1", "sin1"),
    StartKind.MODULATOR_FRINGES: ("path_y", "path_x", "cos1", "sin1"),
    StartKind.PLANES: ("distances", "errors"),
}
CALLED_FOR: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(MODULATOR_HOOKS, ("modulator 1", "modulator 2", "source")),
    "slm2_pose": ("modulator 2",),
    "pupil": ("relay 1", "relay 2"),
}
"""The places that an effect must act on, at least one of them, for these hooks to be called."""


def check_definition(effect: Effect, where: str, ids: frozenset[str]) -> None:
    """Raises UserError for the first mistake in an effect's class. where: its file. ids: of all other effects."""
    for mistake in mistakes_in_definition(effect, where, ids):
        raise mistake


def mistakes_in_definition(effect: Effect, where: str, ids: frozenset[str]) -> Iterator[UserError]:
    """All mistakes in an effect's class, those first on which others depend."""
    where = f"{where}: {type(effect).__name__}"
    missing = [name for name in _REQUIRED if not getattr(effect, name, None)]
    for name in missing:
        own = get_close_matches(name, [n for n in vars(type(effect)) if n not in vars(Effect)], n=1, cutoff=0.6)
        found = f"has no `{name}`" + (f", but `{own[0]}`" if own else "")
        yield UserError(where, found, expected="every field that Effect lists")
    yield from _unknown_names(effect, where)
    if missing:
        return
    for name in ("id", "cause", "finding"):
        if not isinstance(text := getattr(effect, name), str) or not text.strip():
            yield UserError(f"{where}.{name}", f"{text!r}", expected="text")
            return
    if not _NAME.fullmatch(effect.id):
        yield UserError(f"{where}.id", f'"{effect.id}"', expected="letters, digits and _")
    wrong = [*_wrong_tuple(effect, where, "parameters", Parameter), *_wrong_tuple(effect, where, "acts_on", str)]
    if wrong:
        yield from wrong
        return
    for place in effect.acts_on:
        if place not in PLACES:
            meant = re.sub(r"[\s_-]*(\d)$", r" \1", place.lower().replace("slm", "modulator"))
            yield UserError(f"{where}.acts_on", f'"{place}" is no place', remedy=suggest_matches(meant, PLACES))
    yield from _wrong_hooks(effect, where)
    names = [p.name for p in effect.parameters]
    for p in effect.parameters:
        if names.count(p.name) > 1:
            yield UserError(f"{where}.parameters", f'two are called "{p.name}"', expected="names of their own")
            return
        yield from _wrong_parameter(p, f"{where}.{p.name}")
    yield from _wrong_finding(effect, f"{where}.finding")
    yield from _wrong_settings(effect, where, ids)


# --- names and hooks --------------------------------------------------------------------------------------------------


def _unknown_names(effect: Effect, where: str) -> Iterator[UserError]:
    """Members that Effect doesn't have, that look like its own, and that nothing in the class uses."""
    own = {name: m for c in reversed(_own_classes(effect)) for name, m in vars(c).items() if not name.startswith("_")}
    used = {name for c in _own_classes(effect) for m in vars(c).values() for name in _names_used(m)}
    known = {name for name in (*vars(Effect), *Effect.__annotations__) if not name.startswith("_")}
    methods = {name for name in known if callable(getattr(Effect, name, None))}
    for name, member in own.items():
        if name in known or name in used:
            continue
        is_method = callable(member) or isinstance(member, staticmethod | classmethod)
        among, cutoff = (methods, 0.6) if is_method else (known - methods, 0.75)
        if near := get_close_matches(name, among, n=3, cutoff=cutoff):
            remedy = f"did you mean {' or '.join(near)}?"
            yield UserError(where, f"has `{name}`, which nothing calls or reads", remedy=remedy)
        elif is_method and {"v", "context"} & set(_parameter_names(member)):
            expected = f"a hook ({', '.join(HOOKS)}), or a helper that begins with _"
            yield UserError(where, f"has the method `{name}`, which nothing calls", expected=expected)


def _wrong_hooks(effect: Effect, where: str) -> Iterator[UserError]:
    """Overridden methods that can't be called as holoview calls them, and hooks that never would be."""
    for name, plain in vars(Effect).items():
        if not inspect.isfunction(plain) or name.startswith("_") or not effect.overrides(name):
            continue
        own, wanted = getattr(effect, name), [*inspect.signature(plain).parameters][1:]
        call = f"{name}(self, {', '.join(wanted)})"
        if not callable(own):
            yield UserError(f"{where}.{name}", "isn't a method", expected=call)
            continue
        given = [*inspect.signature(own).parameters]
        if not _takes(own, len(wanted)) or (given != wanted and sorted(given) == sorted(wanted)):
            yield UserError(f"{where}.{name}", f"takes ({', '.join(['self', *given])})", expected=call)
    if not effect.hooks:
        yield UserError(where, "overrides no hook, so that it changes nothing", expected=f"one of {', '.join(HOOKS)}")
    for hook in effect.hooks:
        places = CALLED_FOR.get(hook, PLACES)
        if effect.element_kinds and not effect.acts_on:  # it acts on an element that its table states
            continue
        if not set(places) & set(effect.acts_on) and set(effect.acts_on) <= set(PLACES):
            found = f"names {', '.join(effect.acts_on)}, so that its {hook} is never called"
            yield UserError(f"{where}.acts_on", found, expected=" or ".join(places))


def _takes(method: Callable[..., Any], count: int) -> bool:
    try:
        inspect.signature(method).bind(*[None] * count)
    except TypeError:
        return False
    return True


def _own_classes(effect: Effect) -> list[type]:
    """The class of an effect and those that it derives from, up to Effect."""
    classes = type(effect).__mro__
    return list(classes[: classes.index(Effect)])


def _parameter_names(member: Any) -> list[str]:
    function = member.__func__ if isinstance(member, staticmethod | classmethod) else member
    return [*inspect.signature(function).parameters] if inspect.isfunction(function) else []


def _names_used(member: Any) -> set[str]:
    """The names of attributes and globals in a function's code, and in that of functions inside it."""
    function = getattr(member, "__func__", getattr(member, "fget", member))
    found, codes = set[str](), [code] if (code := getattr(function, "__code__", None)) else []
    while codes:
        code = codes.pop()
        found |= set(code.co_names)
        codes += [inner for inner in code.co_consts if isinstance(inner, CodeType)]
    return found


# --- parameters and sentences -----------------------------------------------------------------------------------------


def _wrong_tuple(effect: Effect, where: str, name: str, kind: type) -> Iterator[UserError]:
    """A single thing where a tuple belongs: the comma is missing."""
    value = getattr(effect, name)
    if isinstance(value, kind):
        shown = f'("{value}",)' if isinstance(value, str) else f"({type(value).__name__}(…),)"
        yield UserError(f"{where}.{name}", f"a single {kind.__name__}", expected=f"a tuple, with a comma: {shown}")
    elif not isinstance(value, tuple | list) or not all(isinstance(one, kind) for one in value):
        yield UserError(f"{where}.{name}", f"{value!r}", expected=f"a tuple of {kind.__name__}")


def _wrong_parameter(p: Parameter, where: str) -> Iterator[UserError]:
    if not isinstance(p.name, str) or not _NAME.fullmatch(p.name):
        yield UserError(where, f"the name {p.name!r}", expected="letters, digits and _")
        return
    if p.acts_on and p.acts_on not in PLACES:
        yield UserError(f"{where}.acts_on", f'"{p.acts_on}" is no place', remedy=suggest_matches(p.acts_on, PLACES))
    if p.display_unit and not p.is_quantity and (si := _known_unit(p.display_unit)):
        yield UserError(f"{where}.display_unit", f'"{p.display_unit}"', expected=f"{si}, which are converted")
    try:
        is_sound = p.has_sound_bounds and math.isfinite(p.prior)
    except TypeError:
        is_sound = False
    if not is_sound:
        bounds = "low ≤ high" if isinstance(p, ListParameter) else "low ≤ identity ≤ high"
        found = f"low {p.low!r}, identity {p.identity!r}, high {p.high!r}, prior {p.prior!r}"
        yield UserError(where, found, expected=f"numbers with {bounds} and prior > 0")
    elif p.scan is not None:
        yield from _wrong_scan(p, f"{where}.scan")


def _known_unit(unit: str) -> str:
    """The units that a parameter converts, if `unit` is another one of the same quantity; else nothing."""
    try:
        units.parse(f"1 {unit}", "", quantity := units.quantity_of("m" if unit.endswith("m") else "rad"))
    except UserError:
        return ""
    return "pm, nm, um, mm or cm" if quantity == "length" else "urad or mrad"


def _wrong_scan(p: Parameter, where: str) -> Iterator[UserError]:
    scan: Any = p.scan
    if not isinstance(scan, tuple | list) or len(scan) != 3 or not all(isinstance(n, int | float) for n in scan):
        yield UserError(where, f"{scan!r}", expected="(first, last, step)")
        return
    first, last, step = (float(n) for n in scan)
    if not (math.isfinite(first + last + step) and first <= last and step > 0):
        yield UserError(where, f"{scan!r}", expected="(first, last, step) with first ≤ last and step > 0")
    elif not p.low <= first <= last <= p.high:
        yield UserError(where, f"{first:g} to {last:g}", expected=f"values from low to high, {p.low:g} to {p.high:g}")
    elif (count := (last - first) / step) > _MOST_SCANNED:
        yield UserError(where, f"{count:.3g} steps", expected=f"at most {_MOST_SCANNED}")
    elif abs(count - round(count)) > _WHOLE:
        found = f"steps of {step:g} from {first:g} don't end at {last:g}"
        yield UserError(where, found, expected=f"e.g. {first + round(count) * step:g} as the last value")
    elif not any(True for _ in p.scan_values()):
        yield UserError(where, "has no value but the identity", expected="values to try")


def _wrong_finding(effect: Effect, where: str) -> Iterator[UserError]:
    """Placeholders that nothing fills in. Those of `finding_fields` are known once there is a bench."""
    names = {p.name for p in effect.parameters}
    try:
        fields = [field for _, field, _, _ in string.Formatter().parse(effect.finding) if field is not None]
    except ValueError as error:
        yield UserError(where, f'"{effect.finding}" ({error})', expected="text with {parameter} for values")
        return
    unknown = [] if effect.overrides("finding_fields") else [field for field in fields if field not in names]
    for field in unknown:
        yield UserError(where, f"{{{field}}} isn't a parameter", remedy=suggest_matches(field, names))
    if not unknown and not effect.overrides("finding_fields"):
        try:
            effect.finding.format(**dict.fromkeys(names, "1"))
        except (ValueError, LookupError) as error:
            yield UserError(where, f'"{effect.finding}" ({error})', expected="{parameter}, which is text already")


def _wrong_settings(effect: Effect, where: str, ids: frozenset[str]) -> Iterator[UserError]:
    """Class variables that say something of the search."""
    needs: Any = effect.needs
    if not isinstance(needs, Needs):
        yield UserError(f"{where}.needs", f"{needs!r}", expected="Needs(…)")
    for name in ("degenerate_with", "degenerate_limit"):
        if isinstance(stated := getattr(effect, name), str):
            yield UserError(f"{where}.{name}", "a single str", expected=f'a tuple, with a comma: ("{stated}",)')
            continue
        for other in stated:
            if other not in ids and (near := get_close_matches(str(other), ids, n=3, cutoff=0.6)):
                remedy = f"did you mean {' or '.join(near)}?"
                yield UserError(f"{where}.{name}", f'"{other}" is no effect', remedy=remedy)
    names = {p.name for p in effect.parameters}
    kinds: tuple[Any, ...] = effect.start_kinds
    for kind in kinds:
        if not isinstance(kind, StartKind):
            yield UserError(f"{where}.start_kinds", f"{kind!r}", expected=f"of {', '.join(StartKind.__members__)}")
        elif lacking := [name for name in _START_PARAMETERS.get(kind, ()) if name not in names]:
            yield UserError(f"{where}.start_kinds", f"{kind.name} without the parameter {lacking[0]}")
