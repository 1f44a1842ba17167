"""Timing side by side: every round runs each job once, so that a busy machine slows all alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

Job = Callable[[], None]


@dataclass(frozen=True)
class Sample:
    """Wall times of one job, seconds, in the order of the rounds."""

    seconds: tuple[float, ...]

    @property
    def median_ms(self) -> float:
        """Of all rounds."""
        return 1e3 * statistics.median(self.seconds)

    @property
    def minimum_ms(self) -> float:
        """The steadier figure on a busy machine."""
        return 1e3 * min(self.seconds)


def interleaved(jobs: Mapping[str, Job], rounds: int, warm_up: int = 1) -> dict[str, Sample]:
    """Wall time of each job in each round, after rounds that aren't timed."""
    taken: dict[str, list[float]] = {name: [] for name in jobs}
    for number in range(warm_up + rounds):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            if number >= warm_up:
                taken[name].append(time.perf_counter() - start)
    return {name: Sample(tuple(seconds)) for name, seconds in taken.items()}
