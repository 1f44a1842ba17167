"""`holoview bench --optimiser` for several scenes and seeds, with stops and without, on one thread."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.common import markdown_table
from benchmarks.optimiser_work import STOPS, colour_work
from holoview.evidence.benchmark.autograd_loop import Work
from holoview.evidence.benchmark.time_to_quality import QualityRun, time_to_quality
from holoview.holograms.optimise.parallel import torch_threads
from holoview.util.figures import png_figure

TARGETS = ("still-life", "night", "resolution")


def measure(
    seeds: Sequence[int], scope: QualityRun, size: Sequence[int], stops: Sequence[bool], targets: Sequence[str]
) -> list[dict[str, Any]]:
    """A row for each target, seed and choice of stops (those of the first order, or none); prints it when it is ready.

    size: (y, x) samples.
    """
    rows = []
    for has_stops in stops:
        for target in targets:
            for seed in seeds:
                work = colour_work(size, target, seed)
                if has_stops:
                    work = Work(work.system.edit(STOPS), work.stack, work.drive)
                with torch_threads(1):
                    found = time_to_quality(work, scope)
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


def draw_curves(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """A picture of PSNR over processor time: a chart for each choice of stops, a colour for each target."""
    choices = list(dict.fromkeys(row["stops"] for row in rows))
    targets = list(dict.fromkeys(row["target"] for row in rows))
    with png_figure(path, (4.5 * len(choices), 3.6)) as figure:
        charts = figure.subplots(1, len(choices), squeeze=False)[0]
        for chart, has_stops in zip(charts, choices, strict=True):
            chart.set_title("first order" if has_stops else "no stops")
            chart.set_xlabel("processor time ÷ Adam's to the goal")
            chart.set_ylabel("PSNR − goal, dB")
            chart.set(xlim=(0, 1.1), ylim=(-3, 0.4))
            chart.axhline(0, color="0.5", linewidth=0.8)
        for row in (row for row in rows if row["seed"] == rows[0]["seed"]):
            chart, colour = charts[choices.index(row["stops"])], f"C{targets.index(row['target'])}"
            for prefix, style in (("", "-"), ("adam_", ":")):
                made, psnr_db = zip(*row[f"{prefix}curve"], strict=True)
                end = row[f"{prefix}iterations"] or row["long"]
                spent = [n / end * row[f"{prefix}cpu_seconds"] / row["adam_cpu_seconds"] for n in made]
                below = [one - row["goal_db"] for one in psnr_db]
                name = f"{row['target']}, {'Adam' if prefix else 'holoview'}"
                chart.plot(spent, below, style, color=colour, label=name)
        charts[0].legend(fontsize=7)
