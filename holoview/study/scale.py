"""Problem sizes of studies: quick, middle, full."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from holoview.model.eye import PUPIL
from holoview.util.errors import UserError, suggest_matches

TARGETS = ("still-life", "night", "bright", "coffee", "resolution")
"""Names of the pictures that are part of holoview."""


@dataclass(frozen=True)
class StudyScale:
    """A problem size.

    shape: modulator pixels (y, x). iterations: of an optimisation. seeds: number of them. targets: names of pictures.
    planes: number of focal planes. eyebox: weight of the penalty on an unevenly lit eyebox, for all holograms.
    pupils_m: diameters of the pupils through which a study looks that has several; empty for its own. scores: names of
    the perceptual scores of a study that has them; None for all that are installed.
    """

    name: str
    shape: tuple[int, int]
    iterations: int
    seeds: int
    targets: tuple[str, ...]
    planes: int
    eyebox: float = 0.0
    pupils_m: tuple[float, ...] = ()
    scores: tuple[str, ...] | None = None

    def with_changes(self, **changes: Any) -> StudyScale:
        """The scale with some fields changed; None leaves one as it is. Raises UserError for impossible values."""
        changed = replace(self, **{key: value for key, value in changes.items() if value is not None})
        for key, count in (("--iterations", changed.iterations), ("--seeds", changed.seeds)):
            if count < 1:
                raise UserError(key, str(count), expected="at least 1")
        for name in changed.targets:
            if name not in TARGETS:
                remedy = suggest_matches(name, TARGETS)
                raise UserError("--targets", f'"{name}"', expected=", ".join(TARGETS), remedy=remedy)
        if not 0 <= changed.eyebox < math.inf:
            raise UserError("--eyebox", f"{changed.eyebox:g}", expected="a weight of 0 or more")
        for diameter_m in changed.pupils_m:
            PUPIL.parse(diameter_m, "--pupils")
        return changed

    @property
    def job_settings(self) -> dict[str, Any]:
        """The settings of jobs that depend on the scale."""
        eyebox = {"eyebox": self.eyebox} if self.eyebox else {}
        return {"shape": list(self.shape), "iterations": self.iterations, "planes": self.planes, **eyebox}

    @property
    def description(self) -> str:
        """The scale of an optimisation in words."""
        samples, seeds = format_size(self.shape, self.seeds)
        even = f", eyebox penalty {self.eyebox:g}" if self.eyebox else ""
        targets = "" if len(self.targets) == 1 else f", {len(self.targets)} targets"
        planes = "one focal plane" if self.planes == 1 else f"{self.planes} focal planes"
        return f"{samples}, {self.iterations} iterations, {seeds}{targets}, {planes}{even}"


def format_size(shape: tuple[int, int], seeds: int) -> tuple[str, str]:
    """The samples of a modulator of `shape` pixels (y, x), two along each side of a pixel, and the seeds, in words."""
    return " x ".join(str(2 * n) for n in reversed(shape)) + " samples", f"{seeds} seeds" if seeds > 1 else "one seed"


THREE_SCENES = ("still-life", "night", "bright")
QUICK = StudyScale("quick", (48, 64), 40, 1, ("still-life",), 3)
FULL = StudyScale("full", (384, 512), 100, 1, ("still-life",), 5)
MIDDLE = StudyScale("middle", (96, 128), 150, 3, ("still-life", "resolution"), 5)
SCALES = {scale.name: scale for scale in (QUICK, MIDDLE, FULL)}
"""quick: takes minutes; middle: a quarter of the display's sides, several seeds; full: a whole display."""

MIN_SPECKLE_SHAPE = (96, 128)


def speckle_shape(scale: StudyScale) -> tuple[int, int]:
    """Pixels (y, x) for studies of speckle: a smaller modulator would limit the angles that reach an image point."""
    return max(scale.shape, MIN_SPECKLE_SHAPE)
