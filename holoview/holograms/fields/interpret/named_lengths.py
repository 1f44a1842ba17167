"""Pitch, wavelengths and distance by the names of variables and attributes, such as `illum_wavelen`, `pitch_um`.

A name is a stem ("wavelen"), words that don't matter ("illum") and perhaps a unit ("um"). A number whose unit nothing
states is taken in the unit that makes it usual: 532 is a wavelength in nm, 0.532 one in µm, 5.32e-7 one in m. Where
another unit would make it possible too, the value is a guess, and says so.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from holoview.util import units
from holoview.util.errors import UserError

LengthKey = Literal["pitch_m", "wavelengths_m", "distance_m"]

# fmt: off
_STEMS: dict[LengthKey, frozenset[str]] = {
    "pitch_m": frozenset({
        "pp", "pitch", "pixelpitch", "pixelsize", "pixsize", "pxsize", "psize", "ps", "dx", "dy", "dxy", "dxdy",
        "deltax", "deltay", "deltaxy", "px", "py", "samplingpitch", "samplinginterval", "samplingdistance",
        "samplingstep", "samplesize", "samplespacing", "spacing", "pixelspacing", "pixelwidth", "pixelheight",
        "pixeldimension", "physicalsize", "cellsize", "gridspacing", "pitchsize"
    }),
    "wavelengths_m": frozenset({
        "wlen", "wl", "wvl", "lam", "lamb", "lambda", "lambdas", "lamda", "lmbda", "lmb", "wave", "wavelen",
        "wavelens", "wavelength", "wavelengths", "wavelenght"
    }),
    "distance_m": frozenset({
        "z", "zrec", "zobj", "zpos", "zdist", "d", "dist", "distance", "distances", "depth", "recdist",
        "recdistance", "propdist", "propdistance", "propagationdistance", "reconstructiondistance",
        "recordingdistance", "focusdistance", "focusingdistance", "imagedistance"
    }),
}
_INDEX_STEMS = frozenset({
        "mediumindex", "refractiveindex", "indexmedium", "nmedium", "mediumn", "indexofrefraction"
    })
_QUALIFIERS = frozenset({
        "illum", "illumination", "laser", "source", "light", "beam", "slm", "sensor", "camera", "cam", "ccd",
        "cmos", "detector", "holo", "hologram", "obj", "object", "sample", "recon", "reconstruction",
        "recording", "vacuum", "the", "in", "of", "effective", "eff", "used", "value", "val", "param", "params",
        "setup"
    })
# fmt: on
_AXES = frozenset(("x", "y"))
_AXIS_STEMS = frozenset({"dx", "dy", "px", "py", "deltax", "deltay"})
_COLOURS = {"r": 0, "red": 0, "g": 1, "green": 1, "b": 2, "blue": 2}
_UNITS = {
    "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6,
    "micron": 1e-6, "microns": 1e-6, "micrometer": 1e-6, "micrometers": 1e-6, "micrometre": 1e-6, "µm": 1e-6,
    "μm": 1e-6, "nm": 1e-9, "nanometer": 1e-9, "nanometers": 1e-9, "nanometre": 1e-9, "pm": 1e-12, "angstrom": 1e-10,
}  # fmt: skip
_USUAL: dict[LengthKey, tuple[tuple[str, float, float], ...]] = {
    "pitch_m": (("m", 1e-9, 1e-3), ("mm", 1e-3, 0.05), ("um", 0.05, 200)),
    "wavelengths_m": (
        ("m", 1e-11, 2e-5), ("mm", 1.5e-4, 2e-2), ("um", 0.05, 20), ("angstrom", 3000, 11000), ("nm", 20, 20000)
    ),
    "distance_m": (("m", 0, 2), ("mm", 2, 2000), ("um", 2000, 1e7)),
}  # fmt: skip
"""Units of numbers without one, in the order in which they are tried, each with its usual numbers."""

_POSSIBLE: dict[LengthKey, tuple[float, float]] = {
    "pitch_m": (2e-8, 2e-4),
    "wavelengths_m": (1e-7, 2e-5),
    "distance_m": (1e-5, 3.0),
}
"""Lengths (m) that another unit may make of a number, so that its unit is a guess."""

_STATED: dict[LengthKey, tuple[float, float]] = {
    "pitch_m": (1e-9, 1e-2),
    "wavelengths_m": (1e-11, 1e-4),
    "distance_m": (0.0, 1e6),
}
"""Lengths (m) in a unit that the file states."""

_WORDS = re.compile(r"[A-Z]?[a-zµμ]+|[A-Z]+(?![a-z])")
_MOST_LETTERS = 80  # of a name that is looked at


@dataclass(frozen=True)
class NamedLength:
    """metres: by axis (y, x) of a pitch, by colour of wavelengths. is_sure: whether no other unit is possible."""

    metres: tuple[float, ...]
    reason: str
    is_sure: bool


@dataclass(frozen=True)
class NamedLengths:
    """All lengths by key, in the file's order, and remarks on numbers that can't be what their names say."""

    lengths: Mapping[LengthKey, tuple[NamedLength, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Name:
    """What a variable's name says: a length or the refractive index; its unit, axis and colour, "" for none."""

    key: LengthKey | Literal["index"]
    unit: str = ""
    axis: str = ""
    colour: str = ""


def find_named_lengths(numbers: Mapping[str, Sequence[float]], texts: Mapping[str, str]) -> NamedLengths:
    """The lengths that variables state.

    numbers, texts: by name, with the names of structures around it ("CGH.setup.pp"). A text NAME.units or NAME_units
    states the unit of a number.
    """
    found: dict[LengthKey, list[NamedLength]] = {}
    notes: list[str] = []
    names = {name: parsed for name in [*numbers, *texts] if (parsed := _parse(name)) is not None}
    unit = next((u for name, parsed in names.items() if (u := _unit_of_all(parsed, numbers.get(name, ())))), "")
    axes: dict[str, NamedLength] = {}
    colours: dict[int, NamedLength] = {}
    for name, parsed in names.items():
        if parsed.key == "index":
            value = numbers.get(name, (0.0,))[0]
            if 1 < value < 5:
                notes.append(f"the file's {name} = {value:g} isn't applied: --index {value:g} does")
            continue
        if name in texts:
            length = _of_text(name, parsed, texts[name])
        else:
            length = _of_numbers(name, parsed, numbers[name], texts, unit)
        if length is None:
            if name in numbers and parsed.unit:
                notes.append(
                    f"the file's {name} = {numbers[name][0]:g} can't be a length of its kind and unit: left out"
                )
            continue
        if parsed.axis:
            axes[parsed.axis] = length
        if parsed.colour:
            colours[_COLOURS[parsed.colour]] = length
        found.setdefault(parsed.key, []).append(length)
    if len(axes) == 2:
        found["pitch_m"].insert(0, _together(axes["y"], axes["x"]))
    if len(colours) > 1:
        found["wavelengths_m"].insert(0, _together(*(colours[number] for number in sorted(colours))))
    return NamedLengths({key: tuple(lengths) for key, lengths in found.items()}, tuple(notes))


def _together(*lengths: NamedLength) -> NamedLength:
    """One length of each variable."""
    reason = "; ".join(length.reason for length in lengths)
    return NamedLength(tuple(length.metres[0] for length in lengths), reason, all(length.is_sure for length in lengths))


def _parse(name: str) -> _Name | None:
    """What a name says, by its last part; None for names of anything else."""
    last = name.rpartition(".")[2][:_MOST_LETTERS]
    words = [word.lower() for word in _WORDS.findall(last)]
    unit = ""
    if len(words) > 1 and words[-1] in _UNITS:
        unit = words.pop()
    while len(words) > 1 and words[0] in _QUALIFIERS:
        words.pop(0)
    if "".join(words) in _INDEX_STEMS:
        return _Name("index")
    end = words.pop() if len(words) > 1 and words[-1] in (*_AXES, *_COLOURS) else ""
    stem = "".join(words)
    for key, stems in _STEMS.items():
        glued = next((u for u in ("um", "nm", "mm", "cm") if not unit and stem.endswith(u) and stem[:-2] in stems), "")
        plain = stem[:-2] if glued else stem
        if plain not in stems or (end in _AXES and key != "pitch_m") or (end in _COLOURS and key != "wavelengths_m"):
            continue
        axis = end if end in _AXES else plain[-1] if plain in _AXIS_STEMS else ""
        return _Name(key, unit or glued, axis, end if end in _COLOURS else "")
    return None


def _unit_of_all(parsed: _Name, values: Sequence[float]) -> str:
    """The unit of all lengths of a program as a pitch or a wavelength without a unit shows it: m or mm, else ""."""
    if parsed.unit or parsed.key not in ("pitch_m", "wavelengths_m") or not values or not min(values) > 0:
        return ""
    if max(values) < 1e-4:
        return "m"
    return "mm" if parsed.key == "wavelengths_m" and 1.5e-4 <= max(values) < 2e-2 else ""


def _of_text(name: str, parsed: _Name, text: str) -> NamedLength | None:
    """The lengths of a text such as "532 nm" or "638 nm, 520 nm"; None for other texts."""
    try:
        metres = tuple(units.parse(part.strip(), name) for part in re.split(r"[,;]", text[:_MOST_LETTERS]))
    except UserError:
        return None
    assert parsed.key != "index"
    return (
        NamedLength(metres, f'the file\'s {name} is "{text[:_MOST_LETTERS]}"', True)
        if _fits(metres, parsed.key)
        else None
    )


def _of_numbers(
    name: str, parsed: _Name, numbers: Sequence[float], texts: Mapping[str, str], unit_of_all: str
) -> NamedLength | None:
    assert parsed.key != "index"
    if not numbers or not all(math.isfinite(n) for n in numbers):
        return None
    said = next(
        (texts[key] for key in _names_of_unit(name) if texts.get(key, "").strip() in _UNITS), parsed.unit
    ).strip()
    if said:
        metres = tuple(float(n) * _UNITS[said] for n in numbers)
        return NamedLength(metres, f"the file's {name}, in {said}", True) if _fits(metres, parsed.key) else None
    if unit_of_all and parsed.key == "distance_m":
        reason = f"the file's variable {name}, taken as {unit_of_all}, as its other lengths are"
        return NamedLength(tuple(float(n) * _UNITS[unit_of_all] for n in numbers), reason, True)
    largest = max(abs(n) for n in numbers)
    positive = parsed.key == "distance_m" or min(numbers) > 0
    unit = next((u for u, low, high in _USUAL[parsed.key] if low <= largest < high), "") if positive else ""
    if not unit:
        return None
    low, high = _POSSIBLE[parsed.key]
    others = [u for u, *_ in _USUAL[parsed.key] if u not in (unit, "nm") and low <= largest * _UNITS[u] <= high]
    doubt = f"; in {others[0]} it would be {_words(largest * _UNITS[others[0]])}" if others and largest else ""
    metres = tuple(float(n) * _UNITS[unit] for n in numbers)
    return NamedLength(metres, f"the file's variable {name}, taken as {unit}{doubt}", not doubt)


def _names_of_unit(name: str) -> Iterator[str]:
    for word in ("units", "unit"):
        yield f"{name}.{word}"
        yield f"{name}_{word}"


def _fits(metres: Sequence[float], key: LengthKey) -> bool:
    low, high = _STATED[key]
    return all(math.isfinite(m) and low <= abs(m) <= high and (m > 0 or key == "distance_m") for m in metres)


def _words(length_m: float) -> str:
    unit = "nm" if length_m < 1e-6 else "um" if length_m < 1e-3 else "mm"
    return units.format_rounded(length_m, unit)
