"""Interleaved timing: each round runs every job once, so that other load on the machine slows all jobs alike."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

TimedJob = Callable[[], None]
"""Runs what is timed, and returns when it has finished."""


@dataclass(frozen=True)
class JobTimings:
    """Wall time (s) of a job in each round, and the CPU time (s) of all its threads."""

    seconds: tuple[float, ...]
    cpu_seconds: tuple[float, ...] = ()

    @property
    def median_ms(self) -> float:
        """Median wall time, ms."""
        return 1e3 * statistics.median(self.seconds)

    @property
    def minimum_ms(self) -> float:
        """Least wall time, ms: less sensitive to other load than the median."""
        return 1e3 * min(self.seconds)

    @property
    def cpu_ms(self) -> float:
        """Least CPU time, ms: comparable even if other programs keep all cores busy."""
        return 1e3 * min(self.cpu_seconds, default=0.0)

    def as_dict(self) -> dict[str, float]:
        """The three times as JSON values."""
        return {"median_ms": self.median_ms, "minimum_ms": self.minimum_ms, "cpu_ms": self.cpu_ms}


def time_interleaved(
    jobs: Mapping[str, TimedJob], rounds: int, warm_up: int = 1, limit_s: float = math.inf
) -> dict[str, JobTimings]:
    """Time `rounds` rounds of all jobs, after `warm_up` rounds that aren't timed.

    limit_s: no further round begins after this time, but one round is always timed.
    """
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in jobs}
    deadline = time.perf_counter() + limit_s
    for number in range(warm_up + rounds):
        if number > warm_up and time.perf_counter() > deadline:
            break
        for name, job in jobs.items():
            start, cpu_start = time.perf_counter(), time.process_time()
            job()
            if number >= warm_up:
                samples[name].append((time.perf_counter() - start, time.process_time() - cpu_start))
    return {name: JobTimings(*zip(*pairs, strict=True)) for name, pairs in samples.items()}
