"""What a study is: independent, seeded jobs, what each of them does, and what is found in their results.

A job is plain data, so that it can be sent to another process or machine, and is named by a digest of all that its
result depends on, so that a result is found again when a run that was killed is repeated.
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
from holoview.util.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

StatusCallback = Callable[[str], None]
"""Called by a job now and then, with a few words on how far it is."""


@dataclass(frozen=True, eq=False)
class StudyJob:
    """One piece of work of a study. `settings` hold numbers, texts, None, and lists and tables of these."""

    study: str
    label: str
    settings: Mapping[str, Any]
    revision: int = 1

    @cached_property
    def key(self) -> str:
        """Equal for jobs whose results are equal: same settings, revision of the study, and version of holoview."""
        text = json.dumps([self.study, self.revision, self.settings, __version__], sort_keys=True)
        return blake2b(text.encode(), digest_size=10).hexdigest()


@dataclass(frozen=True)
class JobResult:
    """What came out of a job: numbers (JSON), and pictures (y, x, 3) of 8-bit sRGB by name."""

    numbers: dict[str, Any]
    pictures: dict[str, NDArray[np.uint8]] = field(default_factory=dict)


@dataclass(frozen=True)
class Claim:
    """A number of the paper beside ours. verdict: "reproduces", "direction only", "doesn't reproduce", or "shown"."""

    claim: str
    published: str
    measured: str
    verdict: str
    reason: str = ""


@dataclass(frozen=True)
class StudyFigure:
    """A figure: `draw` fills an empty one."""

    name: str
    caption: str
    draw: Callable[[Figure], None] = field(repr=False)


@dataclass(frozen=True)
class StudyPicture:
    """A picture of a result, with its caption."""

    name: str
    caption: str
    pixels: NDArray[np.uint8] = field(repr=False)


@dataclass(frozen=True)
class Findings:
    """What a study found. rows: one a job or a mean of several, equal keys in each; they become the raw table."""

    rows: Sequence[Mapping[str, Any]]
    claims: Sequence[Claim] = ()
    plots: Sequence[StudyFigure] = ()
    pictures: Sequence[StudyPicture] = ()
    notes: Sequence[str] = ()


class Study(ABC):
    """A study; a subclass is one file in `studies/`."""

    name: str
    title: str
    summary: str
    """What it shows, and the figure of the paper, in a sentence or two."""
    quick_note: str
    """What --quick changes, beside the size."""
    revision: int = 1
    """Raised when what a job computes is changed: results of before are then not found again."""

    def make_job(self, label: str, settings: Mapping[str, Any]) -> StudyJob:
        """A job of this study."""
        return StudyJob(self.name, label, settings, self.revision)

    def describe_size(self, scale: StudyScale) -> str:
        """How large its jobs are at a scale, in words; overridden where nothing is optimised."""
        return scale.description

    @abstractmethod
    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        """The jobs at a scale."""

    @abstractmethod
    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        """Does a job. Depends on nothing but its settings."""

    @abstractmethod
    def analyse(self, results: Sequence[tuple[StudyJob, JobResult]]) -> Findings:
        """What the results of all jobs show."""
