"""Holograms of published test sets, known by their files' names: pitch, wavelengths, distances, reference wave."""

from __future__ import annotations

from dataclasses import dataclass, field
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from typing import Any

from holoview.holograms.files.readers.contents import Facts
from holoview.util import units
from holoview.util.files import read_text
from holoview.util.tables import parse_toml

_TABLE = Path(__file__).with_name("jpeg_pleno.toml")


@dataclass(frozen=True)
class KnownFile:
    """The published facts about a hologram. name: in the test set. method: of the published reconstruction.

    distances_m: all published distances, m. facts: what is taken, the first distance among them.
    is_name_inferred: whether the file's name is published nowhere, so that the match is a guess.
    is_tiled: whether the file is one of many tiles of the hologram.
    """

    name: str
    facts: Facts
    distances_m: tuple[float, ...]
    method: str
    is_name_inferred: bool
    is_tiled: bool = False

    @property
    def reason(self) -> str:
        """Why the facts are taken, in words."""
        return f'the file\'s name is that of the JPEG Pleno hologram "{self.name}"'

    @property
    def note(self) -> str:
        """All distances and the method, for the user."""
        distances = ", ".join(units.format_rounded(d, "mm") for d in self.distances_m) or "none"
        doubt = "; its file's name is published nowhere, so that this may be another hologram" * self.is_name_inferred
        return f"JPEG Pleno, {self.name}: published distances {distances}, by {self.method}{doubt}"


_PLAIN_NAMES = ("data", "h", "hol")  # of arrays, which tell nothing without a size


@dataclass(frozen=True)
class AlikeFiles:
    """The properties that agree in all published holograms whose array has the name and the sizes of a file's."""

    facts: Facts = field(default_factory=Facts)
    reason: str = ""


def find_alike(variable: str, colours: int, shape: tuple[int, int]) -> AlikeFiles:
    """The facts that all holograms of the test set share whose array is like this one; none where no array is.

    variable: name of the array. shape: its rows and columns, in either order, because files differ in it.
    """
    found = [entry for entry in _entries() if _is_alike(entry, variable.lower(), colours, shape)]
    if not found:
        return AlikeFiles()
    pitches, lasers = {e["pitch_um"] for e in found}, {tuple(e["wavelengths_nm"]) for e in found}
    pitch_m = next(iter(pitches)) * 1e-6
    names = ", ".join(entry["name"] for entry in found[:3]) + " …" * (len(found) > 3)
    facts = Facts(
        pitch_m=(pitch_m, pitch_m) if len(pitches) == 1 else None,
        wavelengths_m=tuple(nm * 1e-9 for nm in next(iter(lasers))) if len(lasers) == 1 else (),
    )
    return AlikeFiles(facts, f'its array "{variable}" is like that of the JPEG Pleno holograms {names}')


def _is_alike(entry: dict[str, Any], variable: str, colours: int, shape: tuple[int, int]) -> bool:
    if variable not in (name.lower() for name in entry.get("variables", ())):
        return False
    has_sizes = sorted(entry["shape"]) == sorted(shape) if "shape" in entry else variable not in _PLAIN_NAMES
    return has_sizes and len(entry["wavelengths_nm"]) == colours


def find_known_file(name: str) -> KnownFile | None:
    """The published facts about a file of this name, None for other files."""
    for entry in _entries():
        if any(fnmatch(name.lower(), pattern) for pattern in entry["files"]):
            distances = tuple(entry.get("distances_m", ()))
            facts = Facts(
                pitch_m=(entry["pitch_um"] * 1e-6, entry["pitch_um"] * 1e-6),
                wavelengths_m=tuple(w * 1e-9 for w in entry["wavelengths_nm"]),
                distance_m=distances[0] if distances else None,
                reference_radius_m=entry.get("reference_radius_m"),
            )
            flags = entry.get("is_name_inferred", False), entry.get("is_tiled", False)
            return KnownFile(entry["name"], facts, distances, entry["method"], *flags)
    return None


@cache
def _entries() -> list[dict[str, Any]]:
    table = parse_toml(read_text(_TABLE, "the table of the JPEG Pleno set"), _TABLE.name, "a table of holograms")
    return list(table["hologram"])
