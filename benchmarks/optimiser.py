"""Compares the optimiser with autograd, its own FFTs, other libraries and Adam in one run on the CPU.

    python -m benchmarks.optimiser --only speed memory

README.md explains the tables and how to install the other libraries.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from benchmarks import optimiser_convergence, optimiser_memory, optimiser_peers, optimiser_speed, optimiser_stops
from benchmarks.common import count_of
from holoview import __version__
from holoview.evidence.benchmark.time_to_quality import STEPS_RAD, QualityRun

Section = tuple[Callable[[argparse.Namespace], Any], Callable[[Any], str]]

SECTIONS: dict[str, Section] = {
    "speed": (lambda args: optimiser_speed.measure(args.size, args.repeats, args.threads), optimiser_speed.report),
    "stops": (lambda args: optimiser_stops.measure(args.size, args.repeats, args.threads), optimiser_stops.report),
    "memory": (lambda args: optimiser_memory.measure(args.size), optimiser_memory.report),
    "peers": (lambda args: optimiser_peers.measure(args.size, args.repeats, args.threads), optimiser_peers.report),
    "peer-quality": (
        lambda args: optimiser_peers.measure_quality(args.convergence_size, args.long, args.repeats),
        optimiser_peers.report_quality,
    ),
    "convergence": (
        lambda args: optimiser_convergence.measure(
            args.seeds,
            QualityRun(args.long, args.rounds, args.adam_steps),
            args.convergence_size,
            [name == "stops" for name in args.convergence],
            args.scenes,
        ),
        optimiser_convergence.report,
    ),
}


def main(arguments: list[str] | None = None) -> int:
    """Run the chosen sections and print each when it is ready."""
    args = _parser().parse_args(arguments)
    results: dict[str, Any] = {"machine": _machine(), "size": args.size, "repeats": args.repeats}
    print(", ".join(f"{name} {value}" for name, value in results["machine"].items()))
    for name in args.only:
        measure, report = SECTIONS[name]
        results[name] = measure(args)
        print(f"\n## {name}\n\n{report(results[name])}", flush=True)
    if args.curves and "convergence" in results:
        optimiser_convergence.draw_curves(results["convergence"], args.curves)
    if args.json:
        args.json.write_text(json.dumps(results, indent=2))
    return 0


def _machine() -> dict[str, Any]:
    return {
        "holoview": __version__,
        "torch": torch.__version__,
        "Python": platform.python_version(),
        "cores": os.cpu_count(),
        "load": f"{os.getloadavg()[0]:.1f}",
        "platform": platform.platform(),
    }


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.optimiser", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="+", choices=tuple(SECTIONS), default=list(SECTIONS), help="what to measure")
    parser.add_argument(
        "--size", nargs=2, type=_even, default=[768, 1024], metavar=("Y", "X"), help="simulated samples"
    )
    parser.add_argument("--repeats", type=count_of, default=7, help="iterations timed, after two that aren't")
    parser.add_argument("--threads", nargs="+", type=count_of, default=[torch.get_num_threads(), 1], help="of torch")
    parser.add_argument(
        "--seeds", nargs="+", type=_seed, default=[0, 1], metavar="SEED", help="of the first patterns (convergence)"
    )
    parser.add_argument(
        "--adam-steps", nargs="+", type=_step, default=STEPS_RAD, metavar="RAD", help="of which the best counts"
    )
    parser.add_argument("--rounds", type=count_of, default=3, help="in which runs are timed (convergence)")
    parser.add_argument("--long", type=count_of, default=1000, help="iterations of the long run (convergence)")
    parser.add_argument(
        "--convergence-size", nargs=2, type=_even, default=[192, 256], metavar=("Y", "X"), help="samples (convergence)"
    )
    parser.add_argument(
        "--convergence", nargs="+", choices=("open", "stops"), default=["open", "stops"], help="which benches"
    )
    scenes = optimiser_convergence.TARGETS
    parser.add_argument("--scenes", nargs="+", choices=scenes, default=list(scenes), help="targets (convergence)")
    parser.add_argument("--curves", type=Path, metavar="PNG", help="where to draw the curves of convergence")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where to write the numbers, unrounded")
    return parser


def _seed(text: str) -> int:
    return 0 if text == "0" else count_of(text)


def _step(text: str) -> float:
    step = float(text)
    if not 0 < step < math.inf:
        raise argparse.ArgumentTypeError(f'"{text}": expected a step above 0, rad')
    return step


def _even(text: str) -> int:
    count = count_of(text)
    if count % 2:
        raise argparse.ArgumentTypeError(f'"{text}": expected an even number, two samples a pixel')
    return count


if __name__ == "__main__":
    sys.exit(main())
