"""The interface of a study: its jobs at a problem size, what each of them computes, and the analysis of all results.

A job is plain data, so that it can be sent to another process or machine. It is identified by a digest of everything
that its result depends on, so that a repeated run finds the results of an interrupted one.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.hologram import Hologram
from holoview.light.model.eye import PUPIL
from holoview.light.model.fields import (
    Choice,
    Integer,
    Maybe,
    Number,
    Several,
    Shape,
    Word,
    described_field,
    flag_of,
    validate,
    with_field_docs,
)
from holoview.util.packages import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TARGETS = ("still-life", "night", "bright", "coffee", "resolution")
"""Names of the pictures that are part of holoview."""


@with_field_docs
@dataclass(frozen=True)
class StudyScale:
    """A problem size. Raises UserError, which names the flag, for impossible values.

    Fields:
    """

    name: str = described_field(Choice(), "Of the scale.")
    shape: tuple[int, int] = described_field(Shape(), "Rows and columns of the modulators.")
    iterations: int = described_field(Integer(), "Of each optimisation, instead of the scale's.")
    seeds: int = described_field(Integer(), "Number of seeds, instead of the scale's.")
    targets: tuple[str, ...] = described_field(
        Several(Word(TARGETS)), f"Pictures, instead of the scale's: {', '.join(TARGETS)}."
    )
    planes: int = described_field(Integer(), "Number of focal planes.")
    eyebox: float = described_field(
        Number(low=0.0, high=1e9, words="a weight of 0 or more, at most 1e+09"),
        "Weight of the penalty on an unevenly lit eyebox, for all holograms; 0 for none.",
        default=0.0,
    )
    pupils_m: tuple[float, ...] = described_field(
        Several(PUPIL), "Diameters of the pupils that look, of a study that has several.", flag="pupils", default=()
    )
    scores: tuple[str, ...] | None = described_field(
        Maybe(Several(Choice())),
        "Perceptual scores, of a study that has them; all that are installed if absent.",
        default=None,
    )

    def __post_init__(self) -> None:
        validate(self, flag_of)

    def with_changes(self, **changes: Any) -> StudyScale:
        """The scale with some fields changed; None leaves one as it is. Raises UserError for impossible values."""
        return replace(self, **{key: value for key, value in changes.items() if value is not None})

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


QUICK = StudyScale("quick", (48, 64), 40, 1, ("still-life",), 3)
FULL = StudyScale("full", (384, 512), 100, 1, ("still-life",), 5)
MIDDLE = StudyScale("middle", (96, 128), 150, 3, ("still-life", "resolution"), 5)
SCALES = {scale.name: scale for scale in (QUICK, MIDDLE, FULL)}
"""quick: takes minutes; middle: a quarter of the display's sides, several seeds; full: a whole display."""

MIN_SPECKLE_SHAPE = (96, 128)


def speckle_shape(scale: StudyScale) -> tuple[int, int]:
    """Pixels (y, x) for studies of speckle: a smaller modulator would limit the angles that reach an image point."""
    return max(scale.shape, MIN_SPECKLE_SHAPE)


# --- jobs, results, findings ---


StatusCallback = Callable[[str], None]
"""Called by a running job with a short text on its progress."""


@dataclass(frozen=True, eq=False)
class StudyJob:
    """One computation of a study.

    study: the kind of computation, see `Study.kind`. label: for progress and tables. settings: JSON values, on which
    alone the result depends. revision: of the study, see `Study.revision`.
    """

    study: str
    label: str
    settings: Mapping[str, Any]
    revision: int = 1

    @cached_property
    def key(self) -> str:
        """Digest of kind, revision, settings and holoview's version: equal for jobs with equal results."""
        text = json.dumps([self.study, self.revision, self.settings, __version__], sort_keys=True)
        return blake2b(text.encode(), digest_size=10).hexdigest()


@dataclass(frozen=True)
class JobResult:
    """The result of a job: JSON values by name, pictures (y, x, 3) of 8-bit sRGB by name, and its hologram, if any."""

    numbers: dict[str, Any]
    pictures: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    hologram: Hologram | None = None


Results = Sequence[tuple[StudyJob, JobResult]]
"""The jobs of a study with their results."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper beside our measurement.

    claim: the statement. published, measured: the numbers, in words. verdict: a verdict of `claims`. reason: why the
    statement isn't reproduced.
    """

    claim: str
    published: str
    measured: str
    verdict: str
    reason: str = ""


@dataclass(frozen=True)
class StudyFigure:
    """A figure of the report; `draw` draws it into an empty matplotlib figure."""

    name: str
    caption: str
    draw: Callable[[Figure], None] = field(repr=False)


@dataclass(frozen=True)
class StudyPicture:
    """A picture (y, x, 3) of 8-bit sRGB in the report, with its caption."""

    name: str
    caption: str
    pixels: NDArray[np.uint8] = field(repr=False)


@dataclass(frozen=True)
class Findings:
    """The analysis of a study's results.

    rows: of the table of numbers, one for each job or for a mean of several, with equal keys. notes: paragraphs.
    """

    rows: Sequence[Mapping[str, Any]]
    claims: Sequence[Claim] = ()
    plots: Sequence[StudyFigure] = ()
    pictures: Sequence[StudyPicture] = ()
    notes: Sequence[str] = ()


class Study(ABC):
    """A study. Each file in `studies/` holds a subclass."""

    name: str
    title: str
    summary: str
    """The question of the study, and the figure of the paper that it reproduces, in a sentence or two."""
    quick_note: str
    """The differences at the scale "quick"."""
    revision: int = 1
    """To be increased when `run_job` computes something else, so that stored results aren't used any more."""

    options: tuple[str, ...] = ()
    """Options of a scale that only some studies take, this one among them: "pupils", "scores"."""

    kind: str = ""
    """The kind of result of `run_job`; studies of one kind can share results. Empty: a kind of this study alone."""

    def make_job(self, label: str, settings: Mapping[str, Any]) -> StudyJob:
        """A job of this study's kind and revision."""
        return StudyJob(self.kind or self.name, label, settings, self.revision)

    def describe_size(self, scale: StudyScale) -> str:
        """The size of the jobs at a scale, in words; overridden by studies that optimise nothing."""
        return scale.description

    @abstractmethod
    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        """The jobs at a scale."""

    @abstractmethod
    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        """Computes a job. The result may depend on nothing but the settings."""

    @abstractmethod
    def analyse(self, results: Results) -> Findings:
        """Table, claims and figures from the results of all jobs."""
