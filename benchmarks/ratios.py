"""Ratios of processor times that tell whether a change made something slower, beside those kept for this processor.

    python -m benchmarks.ratios             measure, and compare with ratios.json
    python -m benchmarks.ratios --keep      measure, and keep the result there as this processor's

Each ratio divides a job by another of the same run, in turn with it: median processor times of all threads. Seconds
depend on the machine and on what else it does; these ratios do so much less. Each is measured several times; one is
called slower or faster if it differs by more than 5 %, and by more than either scatters.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.common import count_of, markdown_table, shape_of
from benchmarks.optimiser_work import colour_work, full_work, ours
from holoview.evidence.benchmark.autograd_loop import StoredLoop
from holoview.evidence.benchmark.frame_benchmark import (
    AMPLITUDE,
    FFT,
    FULL,
    PADDED,
    SCRUB,
    SINGLE,
    TORCH,
    TORCH_FFT,
    TORCH_PRUNED,
    TORCH_SINGLE,
    benchmark_frame,
)
from holoview.evidence.benchmark.frame_jobs import JobTimings, time_interleaved
from holoview.evidence.benchmark.machine import processor_name, versions
from holoview.light.gpu.device import open_device
from holoview.light.model import preset
from holoview.util.file_writer import write_file

KEPT = Path(__file__).with_name("ratios.json")
MOST = 0.05
"""A relative change that has to be explained in the changelog."""
Samples = dict[str, list[float]]


def measure(size: tuple[int, int], rounds: int, runs: int) -> Samples:
    """Each ratio in each run. size (y, x): samples of a frame; an iteration has a quarter of them along each side."""
    system = preset.load("holochrome-8")
    upsample = system.sampling.upsample
    bench = system.edit({"shape": [n // upsample for n in size]})
    samples: Samples = {}
    for _ in range(runs):
        frame, iteration, start = _frame_ratios(bench, rounds), _iteration_ratios(size, rounds), _start_ratios(rounds)
        for name, value in (*frame, *iteration, *start):
            samples.setdefault(name, []).append(value)
    return samples


def _frame_ratios(bench: Any, rounds: int) -> Iterator[tuple[str, float]]:
    ms = _medians(benchmark_frame(bench, open_device(), rounds).timings)

    def best(loop: str) -> float:
        return min(time_ms for name, time_ms in ms.items() if name.startswith(f"{loop}:"))

    yield "frame, 8 λ / best torch loop", ms[FULL] / best(TORCH)
    yield "frame, 8 λ / best pruned torch loop", ms[FULL] / best(TORCH_PRUNED)
    yield "frame, 1 λ / best torch loop", ms[SINGLE] / best(TORCH_SINGLE)
    yield "padded / periodic frame", ms[PADDED] / ms[FULL]
    yield "focal plane / frame", ms[SCRUB] / ms[FULL]
    yield "amplitude / frame", ms[AMPLITUDE] / ms[FULL]
    yield "FFT2 / torch.fft2", ms[FFT] / ms[TORCH_FFT]


def _iteration_ratios(size: tuple[int, int], rounds: int) -> Iterator[tuple[str, float]]:
    plain = colour_work([n // 4 for n in size])
    stops = full_work(tuple(n // 8 for n in size))
    loop = StoredLoop(plain)
    steps = {
        "plain": partial(next, ours(plain)),
        "stops": partial(next, ours(stops)),
        "solving": partial(next, ours(plain, free=("patterns", "amplitudes"))),
        "autograd": loop.step,
    }
    ms = _medians(time_interleaved({name: partial(_repeat, step) for name, step in steps.items()}, rounds))
    yield "iteration / autograd with H stored", ms["plain"] / ms["autograd"]
    yield "iteration behind stops, padded / autograd with H stored", ms["stops"] / ms["autograd"]
    yield "iteration that solves amplitudes / one that doesn't", ms["solving"] / ms["plain"]


def _repeat(step: Callable[[], Any]) -> None:
    """Two turns of an optimiser that solves for amplitudes each fifth time: long enough for the processor's clock."""
    for _ in range(10):
        step()


def _medians(timings: Mapping[str, JobTimings]) -> dict[str, float]:
    return {name: statistics.median(timing.cpu_seconds) for name, timing in timings.items()}


def _start_ratios(rounds: int) -> Iterator[tuple[str, float]]:
    """Whole processes, without the rest of the machine: what a command takes before it does anything."""
    words = {
        "torch": ("-c", "import torch"),
        "presets": ("-m", "holoview", "presets"),
        "info": ("-m", "holoview", "info", "holochrome-8"),
    }
    jobs = {name: partial(_process_s, command) for name, command in words.items()}
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            seconds[name].append(job())
    middle = {name: statistics.median(values) for name, values in seconds.items()}
    yield "`holoview presets` / `import torch`", middle["presets"] / middle["torch"]
    yield "`holoview info` / `import torch`", middle["info"] / middle["torch"]


def _process_s(arguments: tuple[str, ...]) -> float:
    """Processor time (s) of a Python process."""
    before = os.times()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


# --- beside what was kept --------------------------------------------------------------------------------------------


def change(now: list[float], kept: list[float]) -> float | None:
    """The relative change of a ratio; None if it is within `MOST` or if the two ranges overlap."""
    found = statistics.median(now) / statistics.median(kept) - 1
    apart = min(now) > max(kept) or max(now) < min(kept)
    return found if abs(found) > MOST and apart else None


def table(samples: Samples, kept: Mapping[str, list[float]]) -> str:
    """Each ratio now and as it was kept, medians with ranges, and what became of it."""
    rows = []
    for name, now in samples.items():
        before = kept.get(name)
        found = None if before is None else change(now, before)
        verdict = "" if found is None else f"{'slower' if found > 0 else 'faster'}: {found:+.0%}"
        rows.append([name, _shown(now), "" if before is None else _shown(before), verdict])
    return markdown_table(("ratio of processor times", "now", "kept", ""), rows)


def _shown(values: list[float]) -> str:
    return f"{statistics.median(values):.3g} ({min(values):.3g} … {max(values):.3g})"


def main(arguments: list[str] | None = None) -> int:
    """Measure, compare, keep; 1 if something became slower."""
    args = _parser().parse_args(arguments)
    processor = processor_name()
    kept_file = json.loads(args.file.read_text(encoding="utf-8")) if args.file.exists() else {}
    kept: dict[str, list[float]] = kept_file.get(processor, {}).get("ratios", {})
    samples = measure(args.size, args.rounds, args.runs)
    print(f"{processor}\n\n{table(samples, kept)}")
    if not kept:
        print(f"\n{args.file.name} has nothing of this processor yet; --keep enters it")
    if args.keep:
        entry = {"versions": versions(), "ratios": {name: [round(v, 4) for v in vs] for name, vs in samples.items()}}
        content = json.dumps(kept_file | {processor: entry}, indent=1, ensure_ascii=False, sort_keys=True)
        write_file(args.file, content + "\n")
        return 0
    changes = [change(now, kept[name]) for name, now in samples.items() if name in kept]
    return int(any(found is not None and found > 0 for found in changes))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ratios", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--size", type=shape_of, default=(768, 1024), metavar="1024x768", help="samples, x by y")
    parser.add_argument("--rounds", type=count_of, default=5, help="of the jobs in a run; the medians count")
    parser.add_argument("--runs", type=count_of, default=3, help="how often each ratio is measured")
    parser.add_argument("--keep", action="store_true", help="keep the result as this processor's")
    parser.add_argument("--file", type=Path, default=KEPT, help="where results are kept")
    return parser


if __name__ == "__main__":
    sys.exit(main())
