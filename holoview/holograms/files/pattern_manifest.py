"""The manifest of exported patterns, patterns.json: what each file is, what its grey levels mean, when it is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from holoview.light.model.bench_parts import Modulator
from holoview.light.model.system import System
from holoview.util.packages import __version__

MANIFEST = "patterns.json"
"""Name of the file in the folder of the patterns."""

FORMAT, VERSION = "holoview-patterns", 1
_ORIENTATION = (
    "the first row is at the top and the first column on the left of the picture that the observer sees; "
    "modulator 1 is the one that light meets first"
)


@dataclass(frozen=True)
class PatternFile:
    """A file that was written. modulator: from 1. frame: from 0. shape: rows and columns of its pixels."""

    name: str
    modulator: int
    frame: int
    shape: tuple[int, ...]
    sha256: str

    def as_json(self) -> dict[str, Any]:
        """Its name, size and checksum."""
        return {"file": self.name, "rows": self.shape[0], "columns": self.shape[1], "sha256": self.sha256}


def pattern_manifest(
    system: System, meaning: str, bits: int, files: Sequence[PatternFile], test: PatternFile | None
) -> dict[str, Any]:
    """The manifest as JSON values; lengths in metres.

    meaning: of a pixel, "path", "level number" or "memory cells of DEVICE". bits: of a grey level with "path". test:
    the test pattern, if there is one.

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
            {"modulator": number, "pitch_m": modulator.pitch_m, "stroke_m": modulator.stroke_m}
            | _levels(modulator, meaning, bits)
            for number, modulator in enumerate(system.modulators, start=1)
        ],
        "wavelengths_m": wavelengths_m,
        "frames": [
            {
                "frame": frame,
                "begins": frame / system.frames,
                "ends": (frame + 1) / system.frames,
                "powers": powers.tolist(),
                "files": [{"modulator": f.modulator} | f.as_json() for f in files if f.frame == frame],
            }
            for frame, powers in enumerate(system.amplitudes)
        ],
        "test_pattern": None if test is None else test.as_json(),
    }


def _levels(modulator: Modulator, meaning: str, bits: int) -> dict[str, Any]:
    """Which optical path a pixel's number stands for."""
    if meaning == "path":
        top = 2**bits - 1
        return {"grey": [0, top], "path_m": [0.0, modulator.stroke_m], "between": "linear"}
    assert modulator.levels is not None
    paths_m = (modulator.levels * modulator.stroke_m).tolist()
    if meaning == "level number":
        return {"grey": list(range(len(paths_m))), "path_m": paths_m, "between": "none"}
    return {"grey": [0, 255], "path_m": paths_m, "between": f"black 0 and white 1 in the {meaning}"}
