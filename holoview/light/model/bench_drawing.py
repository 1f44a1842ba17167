"""The bench as a drawing: its parts in the order in which light passes them, and where they are put on the page.

Only `parts_of_bench` knows a `System`; the layout knows parts. Every part has a column as wide as its texts, so that no
two texts overlap. Distances are written; the room between parts grows with the logarithm of the distance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.elements import Fourier, Lens, Pixels, Space
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.drawing import Box, Drawing, DrawnLine, Label, Place, text_width

_NAME, _DETAIL = 13.0, 11.0  # sizes of fonts, in points
_LINE = 16.0  # from line to line of text
_GUTTER, _MARGIN, _EDGE = 14.0, 18.0, 4.0  # between columns; beside them, and above and below
_HALF = 42.0  # height of a beam's half
_TOP, _BELOW = 46.0, 22.0  # above the beam, for distances; from the beam to the names
_LEAST, _DECADE = 46.0, 34.0  # room for a short distance, and for each factor of ten above 0.1 mm
_MOST_PLANES, _ARROW = 7, 4.0
_WIDTHS = {"laser": 44.0, "relay": 92.0, "plane": 30.0, "eye": 100.0, "observer": 100.0}


@dataclass(frozen=True)
class Part:
    """A part of a bench.

    kind: "laser", "modulator", "field", "relay" (two lenses with stops between them), "image" (of a modulator, by the
    relay before it), "plane", "lens", "eye" or "observer". name, details: in words. key: of what it is in a preset.
    distance_m: from the part before it, where that is known; several of planes. distance_key: of it in a preset.
    """

    kind: str
    name: str
    details: tuple[str, ...] = ()
    key: str = ""
    distance_m: tuple[float, ...] = ()
    distance_key: str = ""


def parts_of_bench(system: System) -> tuple[Part, ...]:
    """The parts of a bench in the order of the light."""
    parts = [_lasers(system), *(_parts_of_chain(system) if system.is_chain else _parts_of_modulators(system))]
    behind_m = system.way.behind_m if system.is_chain else 0.0
    planes_m = tuple(sorted(float(plane_m) - behind_m for plane_m in system.planes_m))
    name = "focal plane" if len(planes_m) == 1 else f"{len(planes_m)} focal planes"
    details = (f"{units.format_rounded(behind_m, 'mm')} more from {system.planes_from}",) if behind_m else ()
    parts.append(Part("plane", name, details, "planes", planes_m, "planes"))
    return (*parts, *_observing_parts(system))


def _parts_of_modulators(system: System) -> list[Part]:
    parts: list[Part] = []
    count = len(system.modulators)
    for place, modulator in enumerate(system.modulators):
        gap = () if place == 0 or system.gap_m is None else (system.gap_m,)
        parts.append(_modulator(modulator, place, count, gap))
        relay, key = (system.relay2, "relay2") if place == count - 1 else (system.relay1, "relay1")
        if not relay.is_clear:
            parts.append(Part("relay", f"relay {key[-1]}", _stops(relay), key))
            what = "the field" if modulator.is_field else f"modulator {place + 1}" if count > 1 else "the modulator"
            parts.append(Part("image", "image", (f"of {what}",), f"modulators.{place}"))
    return parts


def _parts_of_chain(system: System) -> list[Part]:
    """A part for each element that isn't a space, with the distance to it, and for each space's stops."""
    parts: list[Part] = []
    distance_m, of = 0.0, ""
    for place, element in enumerate(system.elements):
        key, before = f"elements.{place}", ((distance_m,) if distance_m else ())
        name, of = element.name or element.kind, of if before else ""
        if isinstance(element, Space):
            if not element.relay.is_clear:
                parts.append(Part("relay", element.name or "relay", _stops(element.relay), key))
            distance_m, of = distance_m + (element.distance_m or 0.0), key
            continue
        if isinstance(element, Lens | Fourier):
            focal_length = f"f = {units.format_rounded(element.focal_length_m, 'mm')}"
            what = ("Fourier plane behind",) if isinstance(element, Fourier) else ()
            parts.append(Part("lens", name, (focal_length, *what), key, before, of))
        elif isinstance(element, Pixels):
            size = () if element.shape is None else (f"{element.shape[1]} × {element.shape[0]}",)
            beside = (f"beside {element.beside}",) if element.beside else ()
            details = (element.kind, *beside, *size, _pitch(element.pitch_m))
            parts.append(Part("modulator", name, details, key, before, of))
        distance_m, of = 0.0, ""
    return parts


def _observing_parts(system: System) -> tuple[Part, ...]:
    """Who sees the planes, and through what."""
    eye = system.eye
    if eye is None:
        return (Part("observer", "observer", (system.observer,), "observer"),)
    eyepiece = Part("lens", "eyepiece", (f"f = {units.format_rounded(eye.eyepiece_m, 'mm')}",), "eye.eyepiece")
    pupil = eye.pupil_m if isinstance(eye.pupil_m, str) else units.format_rounded(eye.pupil_m, "mm")
    places = [f"{units.format_rounded(place_m, 'mm')} {way}" for place_m, way in (
        (eye.pupil_x_m, "to the right"), (eye.pupil_y_m, "down")) if place_m]  # fmt: skip
    who = [] if system.observer == "eye" else [system.observer]
    return (eyepiece, Part("eye", "eye", (f"pupil {pupil}", *places, *who), "eye"))


def _lasers(system: System) -> Part:
    nm = [λ * 1e9 for λ in system.wavelengths_m]
    what = "laser" if len(nm) == 1 else f"{len(nm)} lasers"
    range_nm = f"{min(nm):.4g} nm" if len(nm) == 1 else f"{min(nm):.4g} to {max(nm):.4g} nm"
    directions = len(system.source.directions_rad)
    details = [range_nm, "1 frame" if system.frames == 1 else f"{system.frames} frames"]
    return Part("laser", what, (*details, *([f"{directions} directions"] if directions > 1 else [])), "wavelengths")


def _modulator(modulator: Modulator, place: int, count: int, distance_m: tuple[float, ...]) -> Part:
    rows, columns = modulator.shape
    details = [f"{columns} × {rows}", _pitch(modulator.pitch_m)]
    if not modulator.is_field:
        details.append("continuous" if modulator.levels is None else f"{len(modulator.levels)} levels")
    name = "field" if modulator.is_field else "modulator" if count == 1 else f"modulator {place + 1}"
    kind = "field" if modulator.is_field else "modulator"
    return Part(kind, name, tuple(details), f"modulators.{place}", distance_m, "gap" if distance_m else "")


def _stops(relay: Relay) -> tuple[str, ...]:
    """What stands in the Fourier plane of a relay."""
    lines = [] if relay.iris_na is None else [f"iris NA {relay.iris_na:.4g}"]
    if relay.square is not None:
        side = relay.square.half_side_na
        lines.append("square stop" if side is None else f"square NA {side:.4g}")
        lines += ["at the first order"] if side is None else []
    lines += [] if relay.dc_block_na is None else [f"block NA {relay.dc_block_na:.4g}"]
    lines += [] if relay.apodisation_na is None else ["apodised"]
    lines += ["aberrated"] if relay.aberration_m else []
    return tuple(lines)


# --- the layout -------------------------------------------------------------------------------------------------------


def draw_bench(system: System) -> Drawing:
    """The drawing of a bench, in points."""
    return draw_parts(parts_of_bench(system), system.name or "a bench")


def draw_parts(parts: Sequence[Part], title: str) -> Drawing:
    """The drawing of parts in the order of the light, from left to right. title: in words."""
    columns = _columns(parts)
    width = columns[-1][2] + _MARGIN
    axis = _EDGE + _TOP + _HALF
    lines = max(len(part.details) for part in parts)
    height = axis + _HALF + _BELOW + _LINE * (lines + 1) + _EDGE
    strokes = [DrawnLine(((columns[0][1], axis), (columns[-1][1], axis)), "axis"), *_beam(parts, columns, axis)]
    labels: list[Label] = []
    areas: list[tuple[str, Box]] = []
    for number, (part, (left, x, right)) in enumerate(zip(parts, columns, strict=True)):
        strokes += _symbol(part, x, axis)
        below = axis + _HALF + _BELOW
        labels.append(Label(part.name, x, below, _NAME, "name", part.key))
        for line, text in enumerate(part.details, start=1):
            labels.append(Label(text, x, below + line * _LINE, _DETAIL, "detail", part.key))
        if part.distance_m:
            before = columns[number - 1][1]
            ends = (before, x + (_spread(part) if len(part.distance_m) > 1 else 0.0))
            strokes += _dimension(*ends, _EDGE + 26, part.distance_key)
            labels.append(Label(_distance(part), sum(ends) / 2, _EDGE + 10, _DETAIL, "distance", part.distance_key))
            areas.append((part.distance_key, (*_corner(ends, _EDGE), ends[1], _EDGE + 34)))
        areas.append((part.key, (left, _EDGE + 36, right, height - _EDGE)))
    return Drawing(width, height, tuple(strokes), tuple(labels), tuple(areas), f"the bench {title}")


def _corner(ends: Place, top: float) -> Place:
    return ends[0], top


def _pitch(pitch_m: float) -> str:
    return units.with_symbols(f"{units.format_rounded(pitch_m, 'um')} pitch")


def _distance(part: Part) -> str:
    """The distances before a part in words."""
    first, last = part.distance_m[0], part.distance_m[-1]
    if first == last:
        return units.format_rounded(first, "mm")
    return f"{first * 1e3:.4g} to {units.format_rounded(last, 'mm')}"


def _columns(parts: Sequence[Part]) -> list[tuple[float, float, float]]:
    """The left edge, the axis' place and the right edge of each part."""
    columns: list[tuple[float, float, float]] = []
    for part in parts:
        texts = [text_width(part.name, _NAME), *(text_width(text, _DETAIL) for text in part.details)]
        half = max([_WIDTHS.get(part.kind, 20.0), *texts]) / 2
        x = _MARGIN + half
        if columns:
            _, before, edge = columns[-1]
            x = max(edge + _GUTTER + half, before + _room(part))
        columns.append((x - half, x, x + half))
    return columns


def _room(part: Part) -> float:
    """The least distance on the page from the part before: of the text and for the length that it stands for."""
    if not part.distance_m:
        return 0.0
    longest_mm = 1e3 * max(abs(distance_m) for distance_m in part.distance_m)
    return max(
        _LEAST + _DECADE * max(0.0, math.log10(max(longest_mm, 1e-3) / 0.1)), text_width(_distance(part), _DETAIL) + 8
    )


def _spread(part: Part) -> float:
    return _WIDTHS["plane"] / 2


def _beam(parts: Sequence[Part], columns: Sequence[tuple[float, float, float]], axis: float) -> list[DrawnLine]:
    """The light's edges: parallel, through the middle of each relay's stop, from the eyepiece to the pupil."""
    half, sign = 0.8 * _HALF, 1.0
    edge: list[Place] = []
    for part, (_, x, _) in zip(parts, columns, strict=True):
        if part.kind == "relay":
            lens = _WIDTHS["relay"] / 2 - 6
            edge += [(x - lens, sign * half), (x, 0.0), (x + lens, -sign * half)]
            sign = -sign
        elif part.kind == "eye":
            edge.append((x, sign * 0.25 * _HALF))
        elif part.kind != "observer":  # who sees the planes themselves, through no lens
            edge.append((x + (_WIDTHS["laser"] / 2 if part.kind == "laser" else 0.0), sign * half))
    upper = [(x, axis - y) for x, y in edge]
    lower = [(x, axis + y) for x, y in edge]
    return [
        DrawnLine((*upper, *reversed(lower)), "light", is_filled=True),
        DrawnLine(tuple(upper), "ray"),
        DrawnLine(tuple(lower), "ray"),
    ]


def _symbol(part: Part, x: float, axis: float) -> list[DrawnLine]:
    """The strokes of a part on the axis at x."""
    upper, lower = axis - _HALF, axis + _HALF
    if part.kind == "laser":
        side, high = _WIDTHS["laser"] / 2, 0.9 * _HALF
        box = ((x - side, axis - high), (x + side, axis - high), (x + side, axis + high), (x - side, axis + high))
        return [DrawnLine(box, "device", part.key, is_filled=True)]
    if part.kind in ("modulator", "field"):
        marks = [DrawnLine(((x - 4, y), (x + 4, y)), "device", part.key) for y in _between(upper, lower, 8)]
        return [DrawnLine(((x, upper), (x, lower)), "device", part.key), *marks]
    if part.kind == "image":
        return [DrawnLine(((x, upper), (x, lower)), "image", part.key)]
    if part.kind == "relay":
        reach = _WIDTHS["relay"] / 2 - 6
        open_half = 0.25 * _HALF
        stop = [DrawnLine(((x, upper), (x, axis - open_half)), "stop", part.key)]
        stop += [DrawnLine(((x, axis + open_half), (x, lower)), "stop", part.key)]
        return [_lens(x - reach, axis, part.key), *stop, _lens(x + reach, axis, part.key)]
    if part.kind == "lens":
        return [_lens(x, axis, part.key)]
    if part.kind == "plane":
        count = min(len(part.distance_m), _MOST_PLANES)
        places = [x] if count == 1 else _between(x - _spread(part), x + _spread(part), count)
        return [DrawnLine(((place, upper), (place, lower)), "plane", part.key) for place in places]
    radius, open_half = 0.55 * _HALF, 0.25 * _HALF
    centre = x + radius
    angles = [math.radians(degrees) for degrees in range(-150, 151, 10)]
    arc = tuple((centre - radius * math.cos(math.pi - a), axis + radius * math.sin(a)) for a in angles)
    lids = [DrawnLine(((x, axis + s * open_half), (x, axis + s * radius)), "stop", part.key) for s in (-1, 1)]
    return [DrawnLine(arc, "device", part.key), *lids]


def _lens(x: float, axis: float, key: str) -> DrawnLine:
    """A lens: two arcs that meet above and below."""
    ys = _between(-_HALF, _HALF, 13)
    bulge = [6.0 * (1 - (y / _HALF) ** 2) for y in ys]
    right = [(x + b, axis + y) for y, b in zip(ys, bulge, strict=True)]
    left = [(x - b, axis + y) for y, b in zip(ys, bulge, strict=True)]
    return DrawnLine((*right, *reversed(left)), "glass", key, is_filled=True)


def _dimension(left: float, right: float, y: float, key: str) -> list[DrawnLine]:
    """A line with arrows from one place to another."""
    arrows = [((x + s * _ARROW, y - _ARROW), (x, y), (x + s * _ARROW, y + _ARROW)) for x, s in ((left, 1), (right, -1))]
    return [
        DrawnLine(((left, y), (right, y)), "distance", key),
        *(DrawnLine(arrow, "distance", key) for arrow in arrows),
    ]


def _between(first: float, last: float, count: int) -> list[float]:
    """So many evenly spaced numbers, the ends among them."""
    return [first + (last - first) * n / (count - 1) for n in range(count)]
