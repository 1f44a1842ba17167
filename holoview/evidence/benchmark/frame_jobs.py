"""Jobs that are timed: interleaved timing, the FFT strategy that is measured, a frame and its edits.

In each round every job runs once, so that other load on the machine slows all jobs alike.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import cycle
from typing import Any

from holoview.holograms.view import random_drive
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import Strategy, supported_strategies
from holoview.light.gpu.tune import FftTuner, StrategyOption, TuningResult
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.progress import ProgressCallback, no_progress

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
    jobs: Mapping[str, TimedJob],
    rounds: int,
    warm_up: int = 1,
    limit_s: float = math.inf,
    progress: ProgressCallback = no_progress,
) -> dict[str, JobTimings]:
    """Time `rounds` rounds of all jobs, after `warm_up` rounds that aren't timed.

    limit_s: no further round begins after this time, but one round is always timed. progress: counts the rounds.
    """
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in jobs}
    deadline = time.perf_counter() + limit_s
    for number in range(warm_up + rounds):
        if number > warm_up and time.perf_counter() > deadline:
            break
        for name, job in jobs.items():
            progress(number, warm_up + rounds, name)
            start, cpu_start = time.perf_counter(), time.process_time()
            job()
            if number >= warm_up:
                samples[name].append((time.perf_counter() - start, time.process_time() - cpu_start))
    return {name: JobTimings(*zip(*pairs, strict=True)) for name, pairs in samples.items()}


# --- the FFT strategy that is measured, and the times on which the choice is based ---


Shape = tuple[int, int]


@dataclass(frozen=True)
class TuningReport:
    """Times of the strategies for fields of `shape` (ny, nx), and the chosen strategy."""

    shape: Shape
    chosen: Strategy
    tuning: TuningResult

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON values."""
        tables = {name: dict(getattr(self.tuning, name)) for name in ("seconds", "compile_seconds", "refused")}
        return {"size": [self.shape[1], self.shape[0]], "chosen": self.chosen} | tables

    def format_lines(self) -> list[str]:
        """The report as lines of text."""
        lines = [f"{self.shape[1]} x {self.shape[0]}: {self.chosen}"]
        for strategy in sorted({*self.tuning.seconds, *self.tuning.compile_seconds, *self.tuning.refused}):
            parts = [f"  {strategy:<10}"]
            if strategy in self.tuning.seconds:
                parts.append(f"{1e3 * self.tuning.seconds[strategy]:8.2f} ms an FFT and its inverse")
            if strategy in self.tuning.compile_seconds:
                parts.append(f"{self.tuning.compile_seconds[strategy]:7.2f} s to compile both")
            if strategy in self.tuning.refused:
                parts.append(f"refused: {self.tuning.refused[strategy]}")
            lines.append("  ".join(parts))
        return lines


def tune(device: Device, shape: Shape, *, remeasure: bool = False) -> TuningReport:
    """The fastest strategy for fields of `shape` (ny, nx), from the cache or measured; waits for the result.

    remeasure: ignore cached times. Raises UserError for a size that can't be transformed.
    """
    with FftTuner(device, shape, remeasure=remeasure) as tuner:
        chosen = tuner.wait()
        return TuningReport(shape, chosen, tuner.tuning)


def resolve_strategy(device: Device, shape: Shape, requested: StrategyOption) -> Strategy:
    """The requested strategy, or for "auto" the fastest one."""
    if requested != "auto":
        return requested
    return tune(device, shape).chosen if len(supported_strategies(device, shape)) > 1 else "passes"


# --- a whole frame, and edits after which part of it is computed anew ---


_CHANGE = 1.01
"""Factor between the two values that an edit alternates between."""


def open_renderer(
    system: System,
    device: Device,
    half: bool = False,
    strategy: StrategyOption = "auto",
    max_wavelengths: int | None = None,
    drive: Any = None,
) -> IncrementalRenderer:
    """A renderer at the middle focal plane, with its first frame rendered. drive: a random one when None."""
    middle = middle_plane_m(system)
    chosen = resolve_strategy(device, make_plan(system, [*system.planes_m, middle]).grid.padded, strategy)
    renderer = IncrementalRenderer(
        system,
        random_drive(system) if drive is None else drive,
        device,
        plane_m=middle,
        half=half,
        strategy=chosen,
        max_wavelengths=max_wavelengths,
    )
    renderer.update()
    return renderer


def middle_plane_m(system: System) -> float:
    """The focal plane at which frames are rendered, m."""
    return float(system.planes_m[len(system.planes_m) // 2])


def full_frame(renderer: IncrementalRenderer) -> TimedJob:
    """Render everything from the light source to XYZ."""

    def job() -> None:
        renderer.invalidate()
        update_and_wait(renderer)

    return job


def frames_in_a_row(renderer: IncrementalRenderer, count: int) -> TimedJob:
    """Render `count` frames and wait once, at the end."""

    def job() -> None:
        for _ in range(count):
            renderer.invalidate()
            renderer.update(with_srgb=False)
        renderer.device.wait()

    return job


def scrub(renderer: IncrementalRenderer) -> TimedJob:
    """Alternate between two focal planes."""
    planes_m = cycle([renderer.plane_m * _CHANGE, renderer.plane_m])
    return _edit(renderer, lambda: {"plane_m": next(planes_m)})


def gap_edit(renderer: IncrementalRenderer) -> TimedJob | None:
    """Alternate between two gaps of the modulators; None for a bench with one modulator."""
    before = renderer.system
    if before.gap_m is None:
        return None
    gaps_m = cycle([before.gap_m * _CHANGE, before.gap_m])
    return _edit(renderer, lambda: {"system": renderer.system.edit({"gap": next(gaps_m)})})


def amplitude_edit(renderer: IncrementalRenderer) -> TimedJob:
    """Alternate between two amplitudes of the first laser, as while it is dragged in the viewer."""
    factors = cycle([_CHANGE, 1.0])
    amplitudes = renderer.system.amplitudes

    def change() -> dict[str, Any]:
        edited = amplitudes.copy()
        edited[:, 0] *= next(factors)
        return {"system": renderer.system.with_(amplitudes=edited)}

    return _edit(renderer, change, may_reorder=renderer.device.info.is_cpu)


def pattern_edit(renderer: IncrementalRenderer, name: str) -> TimedJob:
    """Alternate between two patterns of an element of a chain: what it shows, and the same upside down."""
    shown = renderer.drive[name]
    patterns = cycle([shown[:, ::-1].copy(), shown])
    return _edit(renderer, lambda: {"drive": renderer.drive | {name: next(patterns)}})


def _edit(
    renderer: IncrementalRenderer, change: Callable[[], dict[str, Any]], *, may_reorder: bool = False
) -> TimedJob:
    """Time from an edit to XYZ, with all earlier results up to date."""

    def job() -> None:
        renderer.edit(**change())
        update_and_wait(renderer, may_reorder=may_reorder)

    return job


def update_and_wait(renderer: IncrementalRenderer, *, may_reorder: bool = False) -> None:
    """Compute what an edit has left to compute, and wait for it."""
    renderer.update(with_srgb=False, may_reorder=may_reorder)
    renderer.device.wait()
