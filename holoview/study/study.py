"""The interface of a study: its jobs, what each of them computes, and the analysis of all results.

A job is plain data, so that it can be sent to another process or machine. It is identified by a digest of everything
that its result depends on, so that a repeated run finds the results of an interrupted one.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.study.scale import StudyScale
from holoview.util.packages import __version__

if TYPE_CHECKING:  # importing matplotlib takes long, and studies are listed without drawing
    from matplotlib.figure import Figure

StatusCallback = Callable[[str], None]
"""Called by a running job with a short text on its progress."""


@dataclass(frozen=True, eq=False)
class StudyJob:
    """One computation of a study.

    study: what is computed, see `Study.kind`. label: for progress and tables. settings: JSON values, on which alone the
    result depends. revision: of the study, see `Study.revision`.
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
    """The result of a job: JSON values by name, and pictures (y, x, 3) of 8-bit sRGB by name."""

    numbers: dict[str, Any]
    pictures: dict[str, NDArray[np.uint8]] = field(default_factory=dict)


Results = Sequence[tuple[StudyJob, JobResult]]
"""The jobs of a study with their results."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper beside our measurement.

    claim: the statement. published, measured: the numbers, in words. verdict: one of those in `claims`. reason: why the
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
    """What the study shows, and which figure of the paper it reproduces, in a sentence or two."""
    quick_note: str
    """What is different at the scale "quick"."""
    revision: int = 1
    """To be increased when `run_job` computes something else, so that stored results aren't used any more."""

    options: tuple[str, ...] = ()
    """What of a scale only some studies have, and this one does: "pupils", "scores"."""

    kind: str = ""
    """What `run_job` computes; studies of one kind can share results. Empty: something of this study's own."""

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
