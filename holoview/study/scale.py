"""Problem sizes of studies: quick, middle, full."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class StudyScale:
    """A problem size.

    shape: modulator pixels (y, x). iterations: of an optimisation. seeds: number of them. targets: names of pictures.
    planes: number of focal planes.
    """

    name: str
    shape: tuple[int, int]
    iterations: int
    seeds: int
    targets: tuple[str, ...]
    planes: int

    @property
    def job_settings(self) -> dict[str, Any]:
        """The settings of jobs that depend on the scale."""
        return {"shape": list(self.shape), "iterations": self.iterations, "planes": self.planes}

    @property
    def description(self) -> str:
        """The scale of an optimisation in words."""
        samples, seeds = format_size(self.shape, self.seeds)
        return f"{samples}, {self.iterations} iterations, {seeds}, {self.planes} focal planes"


def format_size(shape: tuple[int, int], seeds: int) -> tuple[str, str]:
    """The samples of a modulator of `shape` pixels (y, x), two along each side of a pixel, and the seeds, in words."""
    return " x ".join(str(2 * n) for n in reversed(shape)) + " samples", f"{seeds} seeds" if seeds > 1 else "one seed"


QUICK = StudyScale("quick", (48, 64), 40, 1, ("still-life",), 3)
FULL = StudyScale("full", (384, 512), 100, 1, ("still-life",), 5)
MIDDLE = StudyScale("middle", (96, 128), 150, 3, ("still-life", "resolution"), 5)
SCALES = {scale.name: scale for scale in (QUICK, MIDDLE, FULL)}
"""quick: takes minutes; middle: a quarter of the display's sides, several seeds; full: a whole display."""

MIN_SPECKLE_SHAPE = (96, 128)


def speckle_shape(scale: StudyScale) -> tuple[int, int]:
    """Pixels (y, x) for studies of speckle: a smaller modulator would limit the angles that reach an image point."""
    return max(scale.shape, MIN_SPECKLE_SHAPE)
