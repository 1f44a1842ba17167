"""What the optimiser's benchmarks work on, and how they time it."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch

import holoview as hv
from benchmarks.baselines import Work
from holoview.optimise.iteration_state import IterationState
from holoview.util.files import data_dir

Seconds = dict[str, list[float]]
Run = Callable[[], Any]

ENDLESS = 1_000_000
"""Iterations that no benchmark comes to the end of."""


def colour_work(size: Sequence[int], target: str = "still-life", seed: int = 0) -> Work:
    """8 wavelengths, 5 planes, two modulators, periodic; `size` (y, x) samples, half as many pixels."""
    system = hv.load("holochrome-8").with_(shape=tuple(n // 2 for n in size), propagation="periodic")
    return _work(system, target, seed)


def mono_work(size: Sequence[int], propagation: str = "periodic") -> Work:
    """What every library can do: one wavelength, one modulator, 3 planes, mean squared error of intensity."""
    system = hv.load("holochrome-8-1slm").with_(
        shape=tuple(n // 2 for n in size),
        propagation=propagation,
        wavelengths=["550 nm"],
        amplitudes=[[1.0]],
        planes=["9 mm", "10 mm", "11 mm"],
        observer="mono",
    )
    work = _work(system, "still-life", 0)
    grey = np.repeat(work.stack.mean(axis=-1, keepdims=True), 3, axis=-1)
    return Work(system, grey, work.drive)


def ours(work: Work, **settings: Any) -> Iterator[IterationState]:
    """The optimiser at work: an iteration each time it is asked for the next state."""
    options = {"iterations": ENDLESS, "free": ("patterns",)} | settings
    return hv.iterate(work.system, work.stack, hv.Settings(**options), start=work.drive)


def interleaved(runs: dict[str, Run], repeats: int) -> Seconds:
    """Seconds of each run, taken in turns, so that other work slows all alike; the first two rounds don't count."""
    taken: Seconds = {name: [] for name in runs}
    for round_ in range(repeats + 2):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            if round_ >= 2:
                taken[name].append(time.perf_counter() - start)
    return taken


def summary(taken: Seconds, own: str) -> dict[str, dict[str, float]]:
    """Median and minimum (ms), and by how much of either `own` is the time of each."""
    ms = {name: (1e3 * statistics.median(s), 1e3 * min(s)) for name, s in taken.items()}
    return {
        name: {
            "median_ms": median,
            "minimum_ms": least,
            "ratio_of_medians": ms[own][0] / median,
            "ratio_of_minima": ms[own][1] / least,
        }
        for name, (median, least) in ms.items()
    }


@contextmanager
def threads(count: int) -> Iterator[None]:
    """So many torch threads inside the block."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def times_table(where: str, thread_count: str, rows: dict[str, dict[str, float]], names: Sequence[str]) -> str:
    """Rows of `summary` as a table; those of `names` that weren't measured say so."""
    title = f"{where}{thread_count} thread{'' if thread_count == '1' else 's'}"
    cells = []
    for name in names:
        row = rows.get(name)
        ms = [f"{row[key]:.0f}" for key in ("median_ms", "minimum_ms")] if row else ["not installed", ""]
        ratios = [f"{row[key]:.3f}" for key in ("ratio_of_medians", "ratio_of_minima")] if row else ["", ""]
        cells.append([name, *ms, *ratios])
    return markdown([title, "median ms", "min ms", "holoview ÷ it, medians", "minima"], cells)


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table: text first, numbers to the right."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))


def _work(system: hv.System, target: str, seed: int) -> Work:
    stack = hv.target_for(system, data_dir("assets") / f"{target}.png").stack
    return Work(system, np.asarray(stack, dtype=np.float32), np.asarray(hv.random_drive(system, seed=seed), np.float32))
