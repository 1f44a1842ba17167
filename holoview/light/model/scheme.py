"""The colour schemes of the HoloChrome paper: which lasers are on in which frame, and what else changes on the bench.

    simultaneous            3 lasers at once
    time-sequential         3 lasers in turn, 3 frames
    multiplexed[-T]         3 lasers at once in each of T frames (3)
    holochrome-N[xT]        N lasers at once in each of T frames (1)
    multisource-RxC         R × C source directions, 8.6 mrad apart
    1slm                    only the first modulator

Parts are joined by "+": "holochrome-9x3+multisource-3x3+1slm". The powers of the lasers are balanced to white; an
optimiser may then change the amplitudes of the lasers that are on in each frame.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from holoview.light.colour import observer_weights, white_amplitudes
from holoview.light.model.system import System
from holoview.util.errors import UserError, suggest_matches

_RGB_M = (460e-9, 532e-9, 638e-9)
_NARROW_RANGE_M, _WIDE_RANGE_M = (460e-9, 650e-9), (440e-9, 660e-9)  # up to 9 lasers, and more: the paper's ranges
_MAX_LASERS_IN_NARROW_RANGE = 9
_SOURCE_SPACING_RAD = 8.6e-3
_MAX_NUMBER = 64
_SHOWN = 80  # letters of a wrong name in its message
_FORMS = {
    "simultaneous": r"simultaneous",
    "time-sequential": r"time-sequential",
    "multiplexed": r"multiplexed(?:-(?P<frames>[0-9]{1,9}))?",
    "holochrome": r"holochrome-(?P<count>[0-9]{1,9})(?:x(?P<frames>[0-9]{1,9}))?",
    "multisource": r"multisource-(?P<rows>[0-9]{1,9})x(?P<columns>[0-9]{1,9})",
    "1slm": r"1slm",
}


def with_scheme(system: System, scheme: str) -> System:
    """The system with a colour scheme such as "holochrome-8x3". Raises UserError for text that isn't a scheme."""
    for part in scheme.split("+"):
        name, numbers = _parse(part.strip(), scheme)
        system = system.edit(_changes(system, name, numbers))
    return system


def _parse(part: str, scheme: str) -> tuple[str, dict[str, int]]:
    """The form of a part, a key of `_FORMS`, and the numbers in it."""
    for name, form in _FORMS.items():
        match = re.fullmatch(form, part)
        if match:
            numbers = {key: int(text) for key, text in match.groupdict().items() if text is not None}
            if not all(1 <= number <= _MAX_NUMBER for number in numbers.values()):
                raise UserError("scheme", f'"{part}"', expected=f"numbers from 1 to {_MAX_NUMBER}")
            return name, numbers
    expected = "simultaneous, time-sequential, multiplexed-T, holochrome-NxT, multisource-RxC, 1slm, or several with +"
    raise UserError(
        "scheme", f'"{scheme[:_SHOWN]}"', expected=expected, remedy=suggest_matches(part.split("-")[0], _FORMS)
    )


def _changes(system: System, name: str, numbers: dict[str, int]) -> dict[str, Any]:
    """The changes of a part of a scheme, as keys of `System.edit`."""
    if name == "1slm":
        return {"modulators": system.modulators[:1], "gap": None}
    if name == "multisource":
        grid = [numbers["rows"], numbers["columns"]]
        return {"source": {"grid": grid, "spacing": _SOURCE_SPACING_RAD}}
    wavelengths = np.array(_RGB_M)
    if name == "holochrome":
        count = numbers["count"]
        first, last = _NARROW_RANGE_M if count <= _MAX_LASERS_IN_NARROW_RANGE else _WIDE_RANGE_M
        wavelengths = np.linspace(first, last, count) if count > 1 else np.array([550e-9])
    frames = numbers.get("frames", 3 if name == "multiplexed" else 1)
    lasers_on = np.eye(3) if name == "time-sequential" else np.ones((frames, len(wavelengths)))
    amplitudes = white_amplitudes(observer_weights(system.observer, wavelengths), lasers_on)
    changes: dict[str, Any] = {"wavelengths": wavelengths, "amplitudes": amplitudes}
    return changes | ({} if system.source.tilts_rad is None else {"source.tilts": None})
