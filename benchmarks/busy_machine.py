"""How optimiser, calibration and renderer share the processor with other programs: alone, and beside busy loops.

    python -m benchmarks.busy_machine --rounds 3
    python -m benchmarks.busy_machine --work frames --loops 4

In each round some iterations run alone and beside two loops that never rest. After each iteration a reference takes as
much processor time as it did, in as many threads as there are processors, which never wait for each other: the time
that takes is the fair share of the machine at that moment, whatever else runs on it. A ratio of 1.3 means 1.3 times the
fair share.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median

import holoview as hv
from benchmarks.optimiser_work import full_work, ours
from holoview.bench.calibrate.train import CalibrationSettings, map_layout_for, split_captures, train
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.evidence.benchmark.frame_jobs import full_frame, open_renderer
from holoview.light.gpu.device import open_device
from holoview.util.processes import process_cpu_count, share_the_machine

_BLOCK = bytes(1 << 18)  # hashing it takes a fraction of a millisecond, without Python's lock
_LOOP = "while True: pass"


def optimiser(shape: tuple[int, int]) -> Iterator[object]:
    """Iterations of an optimisation of `holochrome-8`."""
    return ours(full_work(shape))


def calibration(shape: tuple[int, int]) -> Iterator[object]:
    """Epochs of a calibration from twelve captures of two wavelengths, of a modulator of `shape` (y, x) pixels."""
    system = hv.load("simultaneous").with_(
        shape=shape, wavelengths=["520 nm", "638 nm"], amplitudes="white", planes=["9 mm"], frames=1
    )
    captures = make_captures(system, {}, AcquisitionSettings(captures_per_condition=6))
    split = split_captures(captures)
    return train(captures, {}, split, map_layout_for(captures, split.train), CalibrationSettings(epochs=10_000))


def frames(shape: tuple[int, int]) -> Iterator[object]:
    """Frames of `holochrome-8` as the viewer computes them, on the default adapter."""
    render = full_frame(open_renderer(hv.load("holochrome-8").with_(shape=shape), open_device()))
    while True:
        yield render()


WORK = {"optimiser": optimiser, "calibration": calibration, "frames": frames}


@dataclass(frozen=True)
class Spent:
    """Seconds of some iterations, processor seconds, and seconds of the reference with the same processor time."""

    wall_s: float
    cpu_s: float
    reference_s: float

    @property
    def ratio(self) -> float:
        """How many times the fair share of the machine it took."""
        return self.wall_s / self.reference_s


@contextmanager
def busy_loops(count: int) -> Iterator[None]:
    """Processes that never rest, while the block runs."""
    loops = [subprocess.Popen([sys.executable, "-c", _LOOP]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def reference_s(cpu_s: float, threads: int) -> float:
    """Seconds that so many processor seconds take in threads that don't wait for each other."""

    def spend(cpu_s: float) -> None:
        until = time.thread_time() + cpu_s
        while time.thread_time() < until:
            hashlib.sha256(_BLOCK)

    with ThreadPoolExecutor(threads) as pool:
        started = time.perf_counter()
        list(pool.map(spend, [cpu_s / threads] * threads))
        return time.perf_counter() - started


def spend_iterations(states: Iterator[object], count: int) -> Spent:
    """Some iterations, each followed by its reference."""
    wall_s = cpu_s = fair_s = 0.0
    for _ in range(count):
        started, before = time.perf_counter(), time.process_time()
        next(states)
        taken, used = time.perf_counter() - started, time.process_time() - before
        wall_s, cpu_s, fair_s = wall_s + taken, cpu_s + used, fair_s + reference_s(used, process_cpu_count())
    return Spent(wall_s, cpu_s, fair_s)


def main() -> None:
    """Prints a line for each round and condition, and the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", choices=WORK, default="optimiser")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--iterations", type=int, default=15)
    parser.add_argument("--loops", type=int, default=2, help="that never rest (2)")
    parser.add_argument("--shape", type=int, nargs=2, default=(192, 256), metavar=("ROWS", "COLUMNS"))
    args = parser.parse_args()
    states = WORK[args.work](tuple(args.shape))
    next(states)
    found: dict[int, list[Spent]] = {0: [], args.loops: []}
    print(f"{'busy loops':>10} {'seconds':>8} {'processor':>10} {'fair share':>11} {'ratio':>6} {'load':>5}")
    for _ in range(args.rounds):
        for loops, rounds in found.items():
            with busy_loops(loops):
                next(states)
                spent = spend_iterations(states, args.iterations)
            figures = f"{spent.wall_s:>8.2f} {spent.cpu_s:>10.2f} {spent.reference_s:>11.2f} {spent.ratio:>6.2f}"
            print(f"{loops:>10} {figures} {os.getloadavg()[0]:>5.1f}", flush=True)
            rounds.append(spent)
    alone, beside = (median(spent.wall_s for spent in rounds) for rounds in found.values())
    print(f"beside {args.loops} busy loops: {beside / alone:.2f} times as long")
    for loops, rounds in found.items():
        print(f"beside {loops}: {median(spent.ratio for spent in rounds):.2f} times the fair share")


if __name__ == "__main__":
    if os.environ.get("GOMP_SPINCOUNT") is None:  # read when torch is loaded, so that this begins anew
        share_the_machine()
        os.execv(sys.executable, [sys.executable, "-m", "benchmarks.busy_machine", *sys.argv[1:]])
    main()
