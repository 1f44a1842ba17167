"""`holoview bench --optimiser` for several scenes and seeds, with stops and without, on one thread."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from benchmarks.common import markdown_table
from benchmarks.optimiser_work import STOPS, colour_work
from holoview.benchmark.autograd_loop import Work
from holoview.benchmark.frame_benchmark import torch_threads
from holoview.benchmark.time_to_quality import QualityRun, time_to_quality

TARGETS = ("still-life", "night", "resolution")


def measure(
    seeds: int, long: int, size: Sequence[int], stops: Sequence[bool], targets: Sequence[str]
) -> list[dict[str, Any]]:
    """A row for each target, seed and choice of stops (those of the first order, or none); prints it when it is ready.

    long: iterations of the long runs. size: (y, x) samples.
    """
    rows = []
    for has_stops in stops:
        for target in targets:
            for seed in range(seeds):
                work = colour_work(size, target, seed)
                if has_stops:
                    work = Work(work.system.edit(STOPS), work.stack, work.drive)
                with torch_threads(1):
                    found = time_to_quality(work, QualityRun(long))
                assert found is not None
                rows.append(found | {"target": target, "seed": seed, "stops": has_stops})
                print(report(rows[-1:]), file=sys.stderr, flush=True)
    return rows


def report(rows: Sequence[dict[str, Any]]) -> str:
    """The results as a table."""
    header = ["target, seed, stops", "long run, dB", "Adam's, dB", "step, rad", "iterations", "Adam's"]
    header += ["s", "Adam's", "ratio", "of processor time"]
    cells = []
    for row in rows:
        less = "" if row["adam_iterations"] else "< "
        ratios = [f"{less}{row[key]:.2f}" if row["iterations"] else "not reached" for key in ("ratio", "cpu_ratio")]
        cells.append(
            [
                f"{row['target']}, {row['seed']}, {'first order' if row['stops'] else 'none'}",
                *(f"{row[key]:.2f}" for key in ("long_db", "adam_long_db", "adam_step_rad")),
                *(str(row[key] or "not reached") for key in ("iterations", "adam_iterations")),
                *(f"{row[key]:.1f}" for key in ("seconds", "adam_seconds")),
                *ratios,
            ]
        )
    return markdown_table(header, cells)
