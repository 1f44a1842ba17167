"""Scores of how an image looks to a person, by name: which there are, and whether they can be had here.

`holoview.holograms.metrics.perceptual` computes them, which takes longer to import.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

from holoview.light.model.eye import Eye, sample_degrees
from holoview.util.errors import UserError
from holoview.util.packages import import_optional


@dataclass(frozen=True)
class PerceptualScore:
    """A score of an image beside its target.

    title: its usual name. unit: "" for none. digits: behind the point when it is printed. summary: the meaning of its
    values. module: of the optional library that computes it; "" for none.
    """

    title: str
    unit: str
    digits: int
    summary: str
    module: str

    def format(self, value: float) -> str:
        """Title, value and unit."""
        return f"{self.title} {value:.{self.digits}f}{self.unit and ' '}{self.unit}"


PERCEPTUAL_SCORES = {
    "ms_ssim": PerceptualScore("MS-SSIM", "", 3, "1 for equal images; structure in up to five sizes", ""),
    "flip": PerceptualScore(
        "FLIP", "", 3, "an error: 0 for equal images; what is noticed by flipping between them", "flip_evaluator"
    ),
    "jod": PerceptualScore(
        "ColorVideoVDP", "JOD", 2, "10 for equal images; of two that are 1 apart, 75 % prefer the better one", "pycvvdp"
    ),
}
"""The scores by the names that options, tables and files have for them."""

OPTIONAL_SCORES = tuple(name for name, score in PERCEPTUAL_SCORES.items() if score.module)
"""The scores that need a library of the extra `perceptual`."""


def samples_per_degree(pitch_m: float, eye: Eye | None) -> float:
    """Samples a degree of visual angle, of a distance between samples; without an eye, as the default one sees them."""
    return 1 / sample_degrees(pitch_m, (eye or Eye()).eyepiece_m)


def installed_scores() -> tuple[str, ...]:
    """The names of the scores whose libraries are installed."""
    return tuple(
        name for name, score in PERCEPTUAL_SCORES.items() if not score.module or find_spec(score.module) is not None
    )


def usable_scores(report: Callable[[str], object]) -> tuple[str, ...]:
    """The names of the scores whose libraries are installed and load; loading takes seconds.

    report: given a line for each library that is installed but can't be loaded.
    """
    names = []
    for name in installed_scores():
        try:
            require_scores([name])
            names.append(name)
        except UserError as error:
            report(str(error))
    return tuple(names)


def require_scores(names: Sequence[str]) -> None:
    """Raises UserError, which names the extra, if the library of one of the scores isn't installed or doesn't load."""
    for score in (PERCEPTUAL_SCORES[name] for name in names):
        if score.module:
            import_optional(score.module, score.title)
