"""The manifest of exported patterns, patterns.json: what each file is, what its grey levels mean, when it is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from holoview.light.model.bench_parts import Modulator
from holoview.light.model.elements import AmplitudeModulator, PhaseModulator
from holoview.light.model.system import System
from holoview.util.packages import __version__

MANIFEST = "patterns.json"
"""Name of the file in the folder of the patterns."""

FORMAT, VERSION = "holoview-patterns", 1
_ORIENTATION = (
    "the first row is at the top and the first column on the left of the picture that the observer sees; "
    "modulators stand in the order in which light meets them"
)

Driven = Modulator | PhaseModulator | AmplitudeModulator
"""What shows patterns of real numbers: a modulator, or an element of a chain."""


@dataclass(frozen=True)
class PatternFile:
    """A file that was written. shown_by: modulator, from 1, or an element's name; 0 of none. frame: from 0; None where
    all show it. shape: rows and columns of its pixels.
    """

    name: str
    shown_by: int | str
    frame: int | None
    shape: tuple[int, ...]
    sha256: str

    def as_json(self) -> dict[str, Any]:
        """Its name, size and checksum, and what shows it."""
        known = {"file": self.name, "rows": self.shape[0], "columns": self.shape[1], "sha256": self.sha256}
        return known if self.shown_by == 0 else _identity(self.shown_by) | known


def pattern_manifest(
    system: System,
    driven: Mapping[int | str, Driven],
    meaning: str,
    bits: int,
    files: Sequence[PatternFile],
    test: PatternFile | None,
) -> dict[str, Any]:
    """The manifest as JSON values; lengths in metres.

    driven: what shows patterns, by number or name. meaning: of a pixel, "path", which is the amplitude of an amplitude
    modulator, "level number" or "memory cells of DEVICE". bits: of a grey level with "path". test: the test pattern,
    if there is one.

    Frames are shown one after another for equal times; `begins` and `ends` are shares of the time of one image.
    """
    wavelengths_m = system.wavelengths_m.tolist()
    return {
        "format": FORMAT,
        "version": VERSION,
        "software": f"holoview {__version__}",
        "preset": system.name,
        "orientation": _ORIENTATION,
        "pixel": meaning,
        "modulators": [
            _identity(key) | {"pitch_m": shown.pitch_m} | _stroke(shown) | _levels(shown, meaning, bits)
            for key, shown in driven.items()
        ],
        "wavelengths_m": wavelengths_m,
        "frames": [
            {
                "frame": frame,
                "begins": frame / system.frames,
                "ends": (frame + 1) / system.frames,
                "powers": powers.tolist(),
                "files": [file.as_json() for file in files if file.frame in (None, frame)],
            }
            for frame, powers in enumerate(system.amplitudes)
        ],
        "test_pattern": None if test is None else test.as_json(),
    }


def _identity(key: int | str) -> dict[str, Any]:
    return {"modulator": key} if isinstance(key, int) else {"element": key}


def _stroke(shown: Driven) -> dict[str, Any]:
    if isinstance(shown, Modulator):
        return {"stroke_m": shown.stroke_m}
    return {"kind": shown.kind} | ({"stroke_m": shown.stroke_m} if isinstance(shown, PhaseModulator) else {})


def _levels(shown: Driven, meaning: str, bits: int) -> dict[str, Any]:
    """Which optical path, or amplitude, a pixel's number stands for."""
    if isinstance(shown, AmplitudeModulator):
        what, (least, most) = "amplitude", shown.range
    else:
        what, least, most = "path_m", 0.0, shown.stroke_m
    if meaning == "path":
        return {"grey": [0, 2**bits - 1], what: [least, most], "between": "linear"}
    assert shown.levels is not None
    values = (least + (most - least) * shown.levels).tolist()
    if meaning == "level number":
        return {"grey": list(range(len(values))), what: values, "between": "none"}
    return {"grey": [0, 255], what: values, "between": f"black 0 and white 1 in the {meaning}"}
