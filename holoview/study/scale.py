"""How large a study is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class StudyScale:
    """Modulator pixels (y, x), iterations of an optimisation, number of seeds, targets, focal planes."""

    name: str
    shape: tuple[int, int]
    iterations: int
    seeds: int
    targets: tuple[str, ...]
    planes: int

    @property
    def job_settings(self) -> dict[str, Any]:
        """What jobs depend on."""
        return {"shape": list(self.shape), "iterations": self.iterations, "planes": self.planes}

    @property
    def description(self) -> str:
        """The scale of an optimisation as a sentence."""
        samples, seeds = format_size(self.shape, self.seeds)
        return f"{samples}, {self.iterations} iterations, {seeds}, {self.planes} focal planes"


def format_size(shape: tuple[int, int], seeds: int) -> tuple[str, str]:
    """How many samples as many pixels (y, x) have, and how many seeds, in words."""
    return " x ".join(str(2 * n) for n in reversed(shape)) + " samples", f"{seeds} seeds" if seeds > 1 else "one seed"


QUICK = StudyScale("quick", (48, 64), 40, 1, ("still-life",), 3)
FULL = StudyScale("full", (384, 512), 100, 1, ("still-life",), 5)
MIDDLE = StudyScale("middle", (96, 128), 150, 3, ("still-life", "resolution"), 5)
SCALES = {scale.name: scale for scale in (QUICK, MIDDLE, FULL)}
"""quick: a look within minutes; middle: a quarter of a display a side, several seeds; full: a whole display."""

_MIN_SPECKLE_SHAPE = (96, 128)


def speckle_shape(scale: StudyScale) -> tuple[int, int]:
    """Pixels for studies of speckle itself: a smaller field would limit the angles that reach a point of the image."""
    return max(scale.shape, _MIN_SPECKLE_SHAPE)
