"""Timing side by side: every round runs each job once, so that a busy machine slows all alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

TimedJob = Callable[[], None]


@dataclass(frozen=True)
class JobTimings:
    """Wall times of one job, seconds, in the order of the rounds, and the processor time that all its threads took."""

    seconds: tuple[float, ...]
    cpu_seconds: tuple[float, ...] = ()

    @property
    def median_ms(self) -> float:
        """Of all rounds."""
        return 1e3 * statistics.median(self.seconds)

    @property
    def minimum_ms(self) -> float:
        """The steadier figure on a busy machine."""
        return 1e3 * min(self.seconds)

    @property
    def cpu_ms(self) -> float:
        """Least processor time: what is left to compare when other programs keep all cores busy."""
        return 1e3 * min(self.cpu_seconds, default=0.0)


def time_interleaved(jobs: Mapping[str, TimedJob], rounds: int, warm_up: int = 1) -> dict[str, JobTimings]:
    """Wall time of each job in each round, after rounds that aren't timed."""
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in jobs}
    for number in range(warm_up + rounds):
        for name, job in jobs.items():
            start, cpu_start = time.perf_counter(), time.process_time()
            job()
            if number >= warm_up:
                taken[name].append((time.perf_counter() - start, time.process_time() - cpu_start))
    return {name: JobTimings(*zip(*samples, strict=True)) for name, samples in taken.items()}
