"""Test cases of the optimiser's benchmarks, and timing of their iterations."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import torch

import holoview as hv
from benchmarks.common import markdown_table
from holoview.evidence.benchmark.autograd_loop import Work
from holoview.evidence.benchmark.frame_jobs import time_interleaved
from holoview.holograms.optimise.checkpoint import IterationState
from holoview.light.model.system import System
from holoview.util.files import data_dir

Seconds = dict[str, list[float]]
Run = Callable[[], Any]

STOPS = {"relay1.square": "first order", "relay2.square": "first order"}
ENDLESS = 1_000_000
"""More iterations than any benchmark runs."""


def colour_work(size: Sequence[int], target: str = "still-life", seed: int = 0) -> Work:
    """8 wavelengths, 5 planes, two modulators, no padding; `size` (y, x) samples, and half as many pixels."""
    system = hv.load("holochrome-8-open").with_(shape=tuple(n // 2 for n in size), propagation="periodic")
    return _work(system, target, seed)


def full_work(shape: Sequence[int], target: str = "still-life", seed: int = 0) -> Work:
    """All that `holochrome-8` is, with its stops and padding, for a modulator of `shape` (y, x) pixels."""
    return _work(hv.load("holochrome-8").with_(shape=tuple(shape)), target, seed)


def mono_work(size: Sequence[int], propagation: str = "periodic") -> Work:
    """A case for all libraries: one wavelength, one modulator, 3 planes, mean squared error of intensity."""
    system = hv.load("holochrome-8-1slm-open").with_(
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
    """An iterator over the optimiser's states, which makes one iteration for each, of all planes as the baselines'."""
    options = {"iterations": ENDLESS, "free": ("patterns",), "drawn_planes": 0} | settings
    return hv.iterate(work.system, work.stack, hv.Settings(**options), start=work.drive)


def interleaved(runs: dict[str, Run], repeats: int) -> Seconds:
    """Wall time (s) of each run in each round, after two rounds that aren't timed."""
    return {name: list(job.seconds) for name, job in time_interleaved(runs, repeats, warm_up=2).items()}


def summary(taken: Seconds, own: str) -> dict[str, dict[str, float]]:
    """Median and minimum (ms) of each run, and the ratios of the run `own` to them."""
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


def times_table(where: str, thread_count: str, rows: dict[str, dict[str, float]], names: Sequence[str]) -> str:
    """Rows of `summary` as a table; names without a row are marked "not installed"."""
    title = f"{where}{thread_count} thread{'' if thread_count == '1' else 's'}"
    cells = []
    for name in names:
        row = rows.get(name)
        ms = [f"{row[key]:.0f}" for key in ("median_ms", "minimum_ms")] if row else ["not installed", ""]
        ratios = [f"{row[key]:.3f}" for key in ("ratio_of_medians", "ratio_of_minima")] if row else ["", ""]
        cells.append([name, *ms, *ratios])
    return markdown_table([title, "median ms", "min ms", "holoview ÷ it, medians", "minima"], cells)


def _work(system: hv.System, target: str, seed: int) -> Work:
    stack = hv.target_for(system, data_dir("assets") / f"{target}.png").stack
    return Work(system, np.asarray(stack, dtype=np.float32), np.asarray(hv.random_drive(system, seed=seed), np.float32))


# --- the FFTs of an iteration: their number, and their time alone, which is a lower limit ---


def iteration_ffts(system: System) -> float:
    """Number of full-size FFTs for loss and gradient.

    For each wavelength, forward and backward: one of the modulator's pixels (1/upsample² of the samples), one for each
    plane, and with a second modulator two more.
    """
    one_way = 1 / system.sampling.upsample**2 + len(system.planes_m) + (2 if system.gap_m is not None else 0)
    return 2 * one_way * len(system.wavelengths_m)


class Floor:
    """Computes the FFTs of one iteration and nothing else, in memory that is already allocated."""

    def __init__(self, system: System) -> None:
        rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)
        self._fields = [torch.randn(rows, columns, dtype=torch.complex64) for _ in range(2)]
        self._pixels = [torch.randn(system.modulators[0].shape, dtype=torch.complex64) for _ in range(2)]
        self._wavelengths, self._planes = len(system.wavelengths_m), len(system.planes_m)
        self._two = system.gap_m is not None

    def step(self) -> None:
        """Forward and backward, wavelength by wavelength."""
        forward, inverse = torch.fft.fft2, torch.fft.ifft2
        for _ in range(self._wavelengths):
            forward(self._pixels[0], out=self._pixels[1])
            if self._two:
                inverse(self._fields[0], out=self._fields[1])
                forward(self._fields[0], out=self._fields[1])
            for _ in range(2 * self._planes):
                inverse(self._fields[0], out=self._fields[1])
            if self._two:
                forward(self._fields[0], out=self._fields[1])
                inverse(self._fields[0], out=self._fields[1])
            forward(self._pixels[0], out=self._pixels[1])
