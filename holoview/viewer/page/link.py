"""The state of a page as the end of its address, `out.html#plane=9.7mm&gap=2.1mm&laser3=off`, applied to a hologram.

plane, gap                  focal plane and gap, with a unit of length
space.NAME                  of a chain of elements the length of a space, by its name
laser3=off                  the third laser is off
power3, wavelength3         factor on its power, and its wavelength
laser2.3=off                the third laser of the second hologram, which isn't opened
pupil, pupil_x, pupil_y     diameter and place of the eye's pupil
chromatic                   off: the eye has no chromatic aberration
region                      x,y,width,height of the measured region in samples, or none
exposure, view, split       how the page shows it: no part of a hologram
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from holoview.holograms.hologram import Hologram
from holoview.light.model.elements import Space
from holoview.light.model.focus import parse_plane, required_eye
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.util import units
from holoview.util.errors import UserError

_OF_LASERS = ("laser", "power", "wavelength")
_LONGEST = 4096  # characters of a state; a page with 64 lasers, all of them changed, writes 3 000
_EXPECTED = "for example #plane=9.7mm&gap=2.1mm&laser3=off"
_SHOWN_ONLY = ("exposure", "view", "split")
_EYE_KEYS = {"pupil": "pupil", "pupil_x": "pupil_x", "pupil_y": "pupil_y"}


@dataclass(frozen=True)
class Shown:
    """A hologram as a page shows it: with its bench changed, the focal plane in m, the measured region.

    None where the link has none.
    """

    hologram: Hologram
    plane_m: float | None
    region: Region | None = None


def split_link(name: str | Path) -> tuple[Path, str]:
    """The file of a link to a page and what follows "#"; other names, and files of that very name, have nothing."""
    path, text = Path(name), str(name)
    stem, mark, state = text.partition(".html#")
    try:
        is_file = path.exists()
    except OSError:  # a name that is too long
        is_file = False
    return (Path(f"{stem}.html"), state) if mark and not is_file else (path, "")


def shown_by_link(hologram: Hologram, state: str) -> Shown:
    """A hologram with the state of a link applied. Raises UserError for what isn't understood or can't be."""
    if len(state) > _LONGEST:
        raise UserError("link", f"{len(state)} characters", expected=f"at most {_LONGEST}, {_EXPECTED}")
    system, plane_m, region = hologram.system, None, None
    amplitudes, wavelengths = system.amplitudes.copy(), system.wavelengths_m.copy()
    edits: dict[str, Any] = {}
    for part in filter(None, unquote(state).split("&")):
        key, equals, value = part.partition("=")
        name = key.rstrip("0123456789.")
        number = key[len(name) :]
        if not equals:
            raise UserError("link", f'"{part[:40]}"', expected=_EXPECTED)
        if key.startswith("space."):
            edits[f"elements.{_space(system, part, key.removeprefix('space.'))}.distance"] = value
            continue
        if name in _OF_LASERS and _is_of_another(number):
            continue
        if name in _OF_LASERS:
            column = _laser(part, number, len(wavelengths))
            if name == "laser":
                amplitudes[:, column] *= 0.0 if value == "off" else 1.0
            elif name == "power":
                amplitudes[:, column] *= _factor(part, value)
            else:
                wavelengths[column] = units.parse(value, part)
        elif name == "plane":
            plane_m = parse_plane(system, value, part)
        elif name == "region":
            region = _region(part, value)
        elif name == "gap":
            edits["gap"] = value
        elif name in _EYE_KEYS:
            required_eye(system, part)
            edits[f"eye.{_EYE_KEYS[name]}"] = value
        elif name == "chromatic":
            required_eye(system, part)
            edits["eye.chromatic"] = value != "off"
        elif name not in _SHOWN_ONLY:
            raise UserError("link", f'"{part[:40]}"', expected=_EXPECTED)
    lasers = {"wavelengths": wavelengths, "amplitudes": amplitudes}
    return Shown(Hologram(hologram.drive, system.edit(edits | lasers)), plane_m, region)


def _space(system: System, part: str, name: str) -> str:
    """The name of a space of a chain. Raises UserError for another element, and for a bench that is no chain."""
    named = dict(zip(system.element_names, system.elements, strict=True)) if system.is_chain else {}
    spaces = [known for known, e in named.items() if isinstance(e, Space) and e.distance_m is not None]
    if name not in spaces:
        raise UserError(
            "link", f'"{part[:40]}"', expected=f"a space of the bench: {', '.join(spaces) or 'it has none'}"
        )
    return name


def _is_of_another(number: str) -> bool:
    """Whether a number means a laser of another hologram than the first, such as 2.3."""
    parts = number.split(".")
    return len(parts) == 2 and all(0 < len(part) < 5 for part in parts)


def _laser(part: str, number: str, count: int) -> int:
    """The index of a laser from its number in a link."""
    if not (0 < len(number) < 5 and number.isdecimal() and 1 <= int(number) <= count):
        raise UserError("link", f'"{part[:40]}"', expected=f"a laser from 1 to {count}")
    return int(number) - 1


def _region(part: str, text: str) -> Region | None:
    """The region of a link in samples; None for "none"."""
    if text == "none":
        return None
    numbers = text.split(",")
    if len(numbers) != 4 or not all(each.isdecimal() and len(each) < 7 for each in numbers):
        raise UserError("link", f'"{part[:40]}"', expected="region=x,y,width,height in samples, or none")
    x, y, width, height = map(int, numbers)
    if min(width, height) < 1:
        raise UserError("link", f'"{part[:40]}"', expected="a region of at least one sample")
    return x, y, width, height


def _factor(part: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= 1e3:
        raise UserError("link", f'"{part[:40]}"', expected="a factor from 0 to 1000")
    return value
