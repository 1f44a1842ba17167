"""Edits of the elements of a bench, each a step of undo: add, remove, move, switch off and on, change a key.

They are the same for the short form, whose elements its modulators and relays are: a bench that is no short form any
more becomes a chain. The model judges what comes out; where it refuses, nothing has changed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from holoview.light.model.bench_parts import Relay
from holoview.light.model.chain import focal_lengths_m
from holoview.light.model.elements import (
    KINDS,
    Element,
    FieldPlane,
    Fourier,
    Lens,
    Mask,
    PhaseModulator,
    Pixels,
    Space,
)
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.viewer.document.document import Document, Parked, drive_arrays, neutral_patterns
from holoview.viewer.document.editing_session import EditingSession

ADDED_KINDS = tuple(kind for kind in KINDS if kind != FieldPlane.kind)
"""The kinds of elements that can be added; a field is alone on its bench."""
_SPACE_M = 2e-3  # length of a new space
_STROKE_M = 800e-9  # of a new element of optical path where no other has one


def change_element(session: EditingSession, name: str, key: str, value: Any) -> None:
    """Changes a key of an element, as {"distance": 3e-3}; successive changes of the same key are one step of undo."""
    session.change(f"{key} of {name}", {f"elements.{name}.{key}": value}, merge_key=(name, key))


def add_element(session: EditingSession, kind: str, behind: str) -> str:
    """Adds an element of a kind behind another, and returns its name.

    In a space it stands in the middle; behind the last element it leaves the picture where it is, since planes are
    measured from the element before it then. A new modulator passes all light. Raises UserError where it can't be.
    """
    system = session.system
    elements, names = _named(system), system.element_names
    at = names.index(behind)
    new = replace(_new_element(system, kind), name=_free_name(kind, names))
    before, chosen = elements[: at + 1], elements[at]
    if isinstance(chosen, Space) and at < len(elements) - 1 and not isinstance(new, Space):
        half_m = None if chosen.distance_m is None else chosen.distance_m / 2
        rest = Space(name=_free_name("space", (*names, new.name)), distance_m=half_m)
        elements = (*before[:-1], replace(chosen, distance_m=half_m), new, rest, *elements[at + 1 :])
    else:
        if isinstance(chosen, Space) and at == len(elements) - 1:
            before = before[:-1]
        elements = (*before, new, *elements[len(before) :])
    changes: dict[str, Any] = {"elements": elements}
    if elements[_last_solid(elements)] is new and not isinstance(new, Fourier):
        changes["planes_from"] = system.planes_from or names[_last_solid(system.elements)]
    session.edit(f"Add {new.name}", **_rearranged(session.document, changes))
    return new.name


def remove_element(session: EditingSession, name: str) -> None:
    """Takes an element away; of the last one the picture stays where it is. Raises UserError where it is needed."""
    document = session.document
    rest = tuple(parked for parked in document.parked if parked.name != name)
    is_there = name in document.system.element_names
    changes = _without(document, name)[0] if is_there else {}
    session.edit(f"Remove {name}", **(changes | {"parked": rest}))


def move_element(session: EditingSession, name: str, step: int) -> None:
    """Exchanges an element with the next (step 1) or the one before (-1) that isn't a space; spaces stay.

    Raises UserError for a space, and where there is none.
    """
    system = session.system
    elements, at = list(_named(system)), system.element_names.index(name)
    if isinstance(elements[at], Space):
        raise UserError(name, "a space", expected="an element between spaces", remedy="change its length instead")
    solid = [i for i, element in enumerate(elements) if not isinstance(element, Space)]
    place = solid.index(at) + step
    if not 0 <= place < len(solid):
        raise UserError(name, "the first" if step < 0 else "the last", expected="an element to exchange it with")
    other = solid[place]
    elements[at], elements[other] = elements[other], elements[at]
    session.edit(f"Move {name}", **_rearranged(session.document, {"elements": elements}))


def switch_element(session: EditingSession, name: str) -> None:
    """Switches an element off, or on again as it was.

    A modulator that is off passes all light through its pixels; a mask or a lens isn't there; a space has no stops.
    Raises UserError for a Fourier plane, in which others stand.
    """
    document = session.document
    found = next((parked for parked in document.parked if parked.name == name), None)
    rest = tuple(parked for parked in document.parked if parked is not found)
    if found is not None:
        session.edit(f"Switch {name} on", **(_with_parked(document, found) | {"parked": rest}))
        return
    changes, parked = _switched_off(document, name)
    session.edit(f"Switch {name} off", **(changes | {"parked": (*rest, parked)}))


def is_on(document: Document, name: str) -> bool:
    """Whether an element isn't switched off."""
    return all(parked.name != name for parked in document.parked)


def _switched_off(document: Document, name: str) -> tuple[dict[str, Any], Parked]:
    system = document.system
    element = system.elements[system.part(name)]
    if isinstance(element, FieldPlane | Fourier):
        raise UserError(name, f"a {element.kind}", expected="an element that the others don't need", remedy="remove it")
    if isinstance(element, Space):
        if element.relay.is_clear:
            raise UserError(name, "a space without stops", expected="a length", remedy="change it instead")
        clear = Space.over(element.distance_m, Relay(), name)
        return {"system": system.edit({"elements": _put(system, clear)})}, Parked(name, (element,))
    if not isinstance(element, Pixels) or not element.is_driven:
        return _without(document, name)
    named = system.edit({"elements": _named(system)})
    drives = patterns_by_name(document)
    kept, drives[name] = drives[name], neutral_patterns(named, name)
    return {"system": named, "drive": _drive_of(named, drives)}, Parked(name, drive=kept)


def _with_parked(document: Document, parked: Parked) -> dict[str, Any]:
    """The changes of a document that switch an element on again."""
    system = document.system
    if parked.drive is not None:
        drives = patterns_by_name(document)
        drives[parked.name] = parked.drive
        return {"drive": _drive_of(system, drives)}
    (element, *others) = parked.elements
    if not others and isinstance(element, Space):
        present = system.elements[system.part(parked.name)]
        assert isinstance(present, Space)
        stops = Space.over(present.distance_m, element.relay, parked.name)
        return {"system": system.edit({"elements": _put(system, stops)})}
    names, elements = system.element_names, _named(system)
    at = names.index(parked.behind) + 1 if parked.behind in names else 0
    own = [element.name for element in parked.elements]
    if elements[-1].name in own:  # a short form has a space to its planes, with a name that is free meanwhile
        elements = (*elements[:-1], replace(elements[-1], name=_free_name("space", (*names, *own))))
    new = (*elements[:at], *parked.elements, *elements[at:])
    return _moved_planes(document, new, -parked.shift_m, system.planes_from)


def _without(document: Document, name: str) -> tuple[dict[str, Any], Parked]:
    """The changes of a document that take an element away, and what brings it back."""
    system = document.system
    elements, names = _named(system), system.element_names
    first = last = names.index(name)
    shift_m = 0.0
    before, ends = elements[first - 1] if first else None, elements[-1]
    if first == _last_solid(elements) and isinstance(before, Space):  # the planes tell the length of the last space
        if not isinstance(ends, Space) or before.relay.is_clear or before.relay == ends.relay:
            first -= 1
            shift_m = before.distance_m or 0.0 if system.planes_from in ("", name) else 0.0
    elif first == 0 and len(elements) > 1 and isinstance(elements[1], Space) and elements[1].relay.is_clear:
        last = 1
    run, left = elements[first : last + 1], (*elements[:first], *elements[last + 1 :])
    planes_from = "" if system.planes_from == name else system.planes_from
    changes = _moved_planes(document, left, shift_m, planes_from)
    return changes, Parked(name, run, names[first - 1] if first else "", shift_m)


def _moved_planes(document: Document, elements: Sequence[Element], shift_m: float, planes_from: str) -> dict[str, Any]:
    """The changes of a document of other elements whose planes, and the displayed one, are farther by a length."""
    system, view = document.system, document.view_settings
    names = [element.name for element in elements]
    planes_from = planes_from if planes_from in names else ""
    moved = {"elements": elements, "planes": system.planes_m + shift_m, "planes_from": planes_from}
    return _rearranged(document, moved) | {"view_settings": view.with_(plane_m=view.plane_m + shift_m)}


def _rearranged(document: Document, changes: dict[str, Any]) -> dict[str, Any]:
    """The changes of a document whose system is edited, and whose patterns stay those of their elements' names."""
    system, patterns = document.system.edit(changes), patterns_by_name(document)
    names = list(system.drive_shapes)
    if names == list(patterns) or not all(name in patterns for name in names):
        return {"system": system}  # the document fits new patterns to them
    drive = _drive_of(system, {name: patterns[name] for name in names})
    return {"system": system, "drive": drive, "parked": document.parked}


def _named(system: System) -> tuple[Element, ...]:
    """The elements, each with the name by which it is known now: names that are made depend on the others."""
    pairs = zip(system.elements, system.element_names, strict=True)
    return tuple(element if element.name else replace(element, name=name) for element, name in pairs)


def _put(system: System, element: Element) -> tuple[Element, ...]:
    """The elements with another one in the place of that of its name."""
    return tuple(element if of.name == element.name else of for of in _named(system))


def _last_solid(elements: Sequence[Element]) -> int:
    """The index of the last element that isn't a space."""
    return max(i for i, element in enumerate(elements) if not isinstance(element, Space))


def _free_name(kind: str, names: Sequence[str]) -> str:
    return next(name for n in range(1, len(names) + 3) if (name := kind if n == 1 else f"{kind}{n}") not in names)


def patterns_by_name(document: Document) -> dict[str, Any]:
    """The patterns (frame, y, x) of a document by the names of its elements."""
    if document.system.is_chain:
        return dict(document.drive)
    (drive,) = drive_arrays(document.drive)
    return {name: drive[:, number] for number, name in enumerate(document.system.drive_shapes)}


def _drive_of(system: System, patterns: dict[str, Any]) -> Any:
    """A document's drive of patterns by name."""
    return patterns if system.is_chain else np.stack(list(patterns.values()), axis=1)


def _new_element(system: System, kind: str) -> Element:
    """An element of a kind as it is added: with pixels and stroke of the first modulator, a focal length that fits."""
    pixels = next(element for element in system.elements if isinstance(element, Pixels) and element.is_driven)
    strokes = [element.stroke_m for element in system.elements if isinstance(element, PhaseModulator)]
    own: dict[str, Any] = {}
    if issubclass(KINDS[kind], Pixels):
        own = {"pitch_m": pixels.pitch_m, "shape": pixels.shape}
    if issubclass(KINDS[kind], PhaseModulator | Mask):
        own["stroke_m"] = strokes[0] if strokes else _STROKE_M
    if issubclass(KINDS[kind], Mask):
        own["pattern"] = "random"
    if issubclass(KINDS[kind], Lens | Fourier):
        way = system.way
        least_m, most_m = focal_lengths_m(way.shape, way.sample_m, pixels.pitch_m, system.wavelengths_m)
        own["focal_length_m"] = math.ceil(1e4 * math.sqrt(least_m * max(most_m, least_m))) / 1e4
    if issubclass(KINDS[kind], Space):
        own["distance_m"] = _SPACE_M
    return KINDS[kind](**own)
