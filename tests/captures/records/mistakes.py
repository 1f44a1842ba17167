"""Wrong records made by plain numpy, for captures and for capture files: nothing here uses the code that finds them.

A mistake changes the arrays of a session in place. Each is named as a diagnosis should name it: (id, choice).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures

Arrays = dict[str, NDArray[Any]]
Name = tuple[str, str]
_COLUMNS = ("wavelength", "distance", "power", "exposure")

TURNS: dict[str, Callable[[NDArray[Any]], NDArray[Any]]] = {
    "flip_x": lambda a: np.flip(a, 2),
    "flip_y": lambda a: np.flip(a, 1),
    "rotate_180": lambda a: np.flip(a, (1, 2)),
    "transpose": lambda a: a.transpose(0, 2, 1),
    "rotate_90": lambda a: np.rot90(a, 1, (1, 2)),
    "rotate_270": lambda a: np.rot90(a, 3, (1, 2)),
    "anti_transpose": lambda a: np.flip(a.transpose(0, 2, 1), (1, 2)),
}
PLAIN_TURNS = ("flip_x", "flip_y", "rotate_180")


def names(found: Any) -> list[Name]:
    """The names of the corrections that were found."""
    return sorted((correction.effect, correction.choice) for correction in found.corrections)


def turn(array: str, how: str) -> Callable[[Arrays], None]:
    """Patterns or pictures (capture, y, x) turned one by one."""

    def change(a: Arrays) -> None:
        a[array] = TURNS[how](a[array]).copy()

    return change


def exchange(a: Arrays) -> None:
    """The patterns of the modulators change places."""
    a["slm1"], a["slm2"] = a["slm2"], a["slm1"]


def invert(array: str) -> Callable[[Arrays], None]:
    """Level 0 becomes the last one."""

    def change(a: Arrays) -> None:
        a[array] = (int(a["levels"][0]) - 1 - a[array].astype(int)).astype(a[array].dtype)

    return change


def late(steps: int, arrays: Sequence[str]) -> Callable[[Arrays], None]:
    """What belongs to picture n is recorded with picture n + steps."""

    def change(a: Arrays) -> None:
        for name in arrays:
            a[name] = np.roll(a[name], steps, axis=0)

    return change


def mix(column: str, order: Sequence[int]) -> Callable[[Arrays], None]:
    """Where the true value is the order[i]-th smallest, the i-th smallest is recorded."""

    def change(a: Arrays) -> None:
        values = np.unique(a[column])
        truth = np.searchsorted(values, a[column])
        a[column] = values[np.argsort(order)[truth]]

    return change


def scale(column: str, factor: float) -> Callable[[Arrays], None]:
    """The numbers of a column in another unit."""

    def change(a: Arrays) -> None:
        a[column] = a[column] * factor

    return change


def backwards(column: str) -> Callable[[Arrays], None]:
    """A column from the last capture to the first."""

    def change(a: Arrays) -> None:
        a[column] = a[column][::-1].copy()

    return change


def shuffle(column: str, seed: int) -> Callable[[Arrays], None]:
    """A column in a random order."""

    def change(a: Arrays) -> None:
        a[column] = np.random.default_rng(seed).permutation(a[column])

    return change


def all_mistakes(wavelengths: int, planes: int, square: bool = False) -> dict[Name, Callable[[Arrays], None]]:
    """Every mistake that a session with two modulators, so many wavelengths and planes can have."""
    found: dict[Name, Callable[[Arrays], None]] = {}
    for how in TURNS if square else PLAIN_TURNS:
        for id_, array in (("slm1", "slm1"), ("slm2", "slm2"), ("camera", "images")):
            found[f"{id_}_orientation", how] = turn(array, how)
    found["slm_exchange", ""] = exchange
    for slm in ("slm1", "slm2"):
        found[f"{slm}_inverted", ""] = invert(slm)
    for steps in (1, -1, 2, -3, 5):
        found["capture_order", f"offset:{steps:+d}"] = late(steps, ("slm1", "slm2"))
    found["capture_order", "offset:+1 of modulator 1"] = late(1, ("slm1",))
    found["capture_order", "offset:-2 of modulator 2"] = late(-2, ("slm2",))
    if wavelengths * planes > 1:
        found["capture_order", "offset:+1 with settings"] = late(1, ("slm1", "slm2", *_COLUMNS))
    for column, count in (("wavelength", wavelengths), ("distance", planes)):
        if count > 1:
            found[f"{column}_order", "reversed"] = mix(column, range(count)[::-1])
        if count > 2:
            cycle = [*range(1, count), 0]
            found[f"{column}_order", "permutation:" + ",".join(map(str, cycle))] = mix(column, cycle)
            swap = [1, 0, *range(2, count)]
            found[f"{column}_order", "permutation:" + ",".join(map(str, swap))] = mix(column, swap)
    found["distance_order", "unit:mm taken as m"] = scale("distance", 1e3)
    found["distance_order", "unit:m taken as mm"] = scale("distance", 1e-3)
    found["wavelength_order", "unit:nm taken as µm"] = scale("wavelength", 1e3)
    found["wavelength_order", "unit:nm taken as m"] = scale("wavelength", 1e9)
    found["power_order", "reversed"] = backwards("power")
    found["power_order", "offset:+1"] = late(1, ("power",))
    return found


def spoiled(captures: Captures, *mistakes: Callable[[Arrays], None]) -> Captures:
    """The captures with wrong records; the mistakes happen one after another."""
    slms = {f"slm{n + 1}": captures.levels[:, n] for n in range(len(captures.slms))}
    arrays: Arrays = {
        **slms,
        "images": captures.images,
        "wavelength": captures.wavelength_m,
        "distance": captures.distance_m,
        "power": captures.power,
        "exposure": captures.exposure_s,
        "levels": np.array([captures.slms[0].num_levels]),
    }
    for mistake in mistakes:
        mistake(arrays)
    return dataclasses.replace(
        captures,
        levels=np.stack([arrays[name] for name in slms], axis=1),
        images=arrays["images"],
        wavelength_m=arrays["wavelength"],
        distance_m=arrays["distance"],
        power=arrays["power"],
        exposure_s=arrays["exposure"],
    )


def spoil_file(path: Path, *mistakes: Callable[[Arrays], None]) -> Path:
    """The same for a capture file of two modulators."""
    places = {"slm1": "slm1/levels", "slm2": "slm2/levels", "images": "camera/images", **{n: n for n in _COLUMNS}}
    with h5py.File(path, "r+") as h5:
        arrays: Arrays = {name: h5[place][()] for name, place in places.items()}
        arrays["levels"] = np.array([h5["slm1"].attrs["num_levels"]])
        for mistake in mistakes:
            mistake(arrays)
        for name, place in places.items():
            attributes = dict(h5[place].attrs)
            del h5[place]
            h5[place] = arrays[name]
            h5[place].attrs.update(attributes)
    return path
