"""Patterns that are sent to the modulators of a rig: the document's, random ones, flat ones, those of a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.captures.patterns import random_levels
from holoview.io.hologram import load_hologram
from holoview.rig.description import RigDescription
from holoview.rig.devices import Levels
from holoview.util.errors import UserError
from holoview.util.text import printable

_REMEDY = "take the bench of the rig (menu Rig), then find patterns for it"


@dataclass(frozen=True, eq=False)
class SentPattern:
    """Grey levels (modulator, y, x), and where they come from, in words."""

    levels: Levels
    label: str


def drive_pattern(rig: RigDescription, drive: NDArray[np.floating], label: str) -> SentPattern:
    """A drive (modulator, y, x) in 0…1, rounded to the nearest levels of the rig's modulators.

    Raises UserError where it has another shape.
    """
    shape = (len(rig.bench.slms), *rig.slm_shape)
    if drive.shape != shape:
        found, wanted = (" × ".join(map(str, s)) for s in (drive.shape, shape))
        expected = f"{wanted} (modulator, y, x) as the rig has"
        raise UserError(label, f"patterns of {found}", expected=expected, remedy=_REMEDY)
    highest = np.array([slm.num_levels - 1 for slm in rig.bench.slms])[:, None, None]
    levels = np.rint(np.clip(np.asarray(drive, np.float64), 0.0, 1.0) * highest)
    return SentPattern(levels.astype(_levels_type(rig)), label)


def random_pattern(rig: RigDescription, sigma_px: float, seed: int) -> SentPattern:
    """Random levels, blurred by a Gaussian of `sigma_px` modulator pixels."""
    rng = np.random.default_rng(seed)
    own = [random_levels(rng, rig.slm_shape, slm.num_levels, sigma_px) for slm in rig.bench.slms]
    return SentPattern(np.stack(own).astype(_levels_type(rig)), f"random, smooth over {sigma_px:g} px")


def flat_pattern(rig: RigDescription, share: float) -> SentPattern:
    """The same level everywhere, `share` of the highest one."""
    drive = np.full((len(rig.bench.slms), *rig.slm_shape), share)
    return drive_pattern(rig, drive, f"flat, {share:.2f} of the stroke")


def file_pattern(rig: RigDescription, path: Path, frame: int = 0) -> SentPattern:
    """A frame of a hologram file; the last one if it has fewer. Raises UserError."""
    drive = load_hologram(path).drive
    return drive_pattern(rig, drive[min(frame, len(drive) - 1)], printable(path.name))


def _levels_type(rig: RigDescription) -> type[np.unsignedinteger]:
    return np.uint8 if max(slm.num_levels for slm in rig.bench.slms) <= 256 else np.uint16
