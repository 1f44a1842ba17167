"""How many iterations and how much time a good hologram takes: the optimiser, and torch's Adam at a constant 0.1 rad.

A long run of each shows which quality can be reached; the goal is 0.2 dB below the better of the two. Both start from
the same random patterns and solve the amplitudes in closed form each tenth iteration. The optimiser's steps shrink over
the planned number of iterations, so its result is the smallest plan that reaches the goal at its end, found by
bisection. Adam's result is the first iteration that reaches the goal.

The time is the processor time on one thread: of the whole run, with all that it prepares, and of Adam's iterations
alone. It is measured in turn: a run and ten iterations of Adam, with one solution of the amplitudes, in some rounds.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls

import holoview as hv
from benchmarks.baselines import Autograd, Cached, Work
from benchmarks.common import markdown_table
from benchmarks.optimiser_stops import STOPS, Masked
from benchmarks.optimiser_work import colour_work
from holoview.benchmark.frame_benchmark import torch_threads

TARGETS = ("still-life", "night", "resolution")
MARGIN_DB = 0.2
_RATE_RAD, _BETAS = 0.1, (0.9, 0.999)
_EVERY = 10  # iterations between two solutions of the amplitudes
_ROUNDS = 3  # in which times are measured
_SHORTEST, _RATIO = 10, 1.05  # of the bisection: fewest iterations, and the ratio at which it stops

Curve = list[tuple[int, float]]
"""Number of iterations and PSNR (dB)."""


def measure(
    seeds: int, long: int, size: Sequence[int], stops: Sequence[bool], targets: Sequence[str], drawn_planes: int
) -> list[dict[str, Any]]:
    """A row for each target, seed and choice of stops (those of the first order, or none); prints it when it is ready.

    long: iterations of the long runs. size: (y, x) samples. drawn_planes: of `Settings`, for all runs but the long one.
    """
    rows = []
    for has_stops in stops:
        for target in targets:
            for seed in range(seeds):
                work = colour_work(size, target, seed)
                if has_stops:
                    work = Work(work.system.edit(STOPS), work.stack, work.drive)
                with torch_threads(1):
                    rows.append(_compare(work, Masked if has_stops else Cached, long, drawn_planes))
                rows[-1] |= {"target": target, "seed": seed, "size": list(size), "stops": has_stops}
                print(report(rows[-1:]), file=sys.stderr, flush=True)
    return rows


def _compare(work: Work, baseline: type[Cached], long: int, drawn_planes: int) -> dict[str, Any]:
    best_db = planned(work, long)[-1][1]
    curve = adam_curve(baseline(work, _RATE_RAD, _BETAS), long)
    adam_db = max(psnr_db for _, psnr_db in curve)
    goal_db = max(best_db, adam_db) - MARGIN_DB
    reached = best_db >= goal_db
    iterations = shortest_plan(work, goal_db, long, drawn_planes) if reached else None
    adam = next((made for made, psnr_db in curve if psnr_db >= goal_db), None)
    own_s, adam_s = seconds(work, baseline, iterations or long, drawn_planes)
    return {
        "seconds": own_s,
        "adam_seconds": adam_s * (long if adam is None else adam),
        "adam_iteration_seconds": adam_s,
        "long_db": best_db,
        "adam_long_db": adam_db,
        "goal_db": goal_db,
        "iterations": iterations,
        "adam_iterations": adam,
        "curve": planned(work, iterations or long, drawn_planes),
        "adam_curve": curve,
    }


def seconds(work: Work, baseline: type[Cached], iterations: int, drawn_planes: int) -> tuple[float, float]:
    """Median processor time (s) of a run of the optimiser, and of an iteration of Adam with stored H, in turn."""
    adam = baseline(work, _RATE_RAD, _BETAS)

    def own_steps() -> None:
        planned(work, iterations, drawn_planes)

    def adam_steps() -> None:
        for made in range(_EVERY):
            intensities = adam.intensities(adam.drive)
            if made == 0:
                adam.amplitudes = solved_amplitudes(intensities.detach(), adam.colours, adam.target)
            adam.move(torch.nn.functional.mse_loss(adam.image(intensities), adam.target))

    taken: dict[str, list[float]] = {"own": [], "adam": []}
    for turn in range(_ROUNDS + 1):  # the first one isn't counted
        for name, steps in (("own", own_steps), ("adam", adam_steps)):
            started = time.process_time()
            steps()
            if turn:
                taken[name].append(time.process_time() - started)
    return statistics.median(taken["own"]), statistics.median(taken["adam"]) / _EVERY


def planned(work: Work, iterations: int, drawn_planes: int = 0) -> Curve:
    """The curve of a run that is planned for so many iterations."""
    settings = hv.Settings(iterations=iterations, drawn_planes=drawn_planes)
    states = hv.iterate(work.system, work.stack, settings, start=work.drive)
    return [(state.iteration, state.psnr_db) for state in states]


def shortest_plan(work: Work, goal_db: float, longest: int, drawn_planes: int) -> int:
    """The fewest iterations (to 5 %) whose run reaches the goal, as one of `longest` iterations does."""
    low, high = _SHORTEST, longest
    while high > max(low + 1, _RATIO * low):
        middle = round(math.sqrt(low * high))
        if planned(work, middle, drawn_planes)[-1][1] >= goal_db:
            high = middle
        else:
            low = middle
    return high


def adam_curve(adam: Autograd, iterations: int) -> Curve:
    """PSNR at each tenth iteration of Adam, with the amplitudes solved for the patterns of that iteration."""
    curve = []
    for made in range(iterations + 1):
        intensities = adam.intensities(adam.drive)
        if made % _EVERY == 0:
            fixed = intensities.detach()
            adam.amplitudes = solved_amplitudes(fixed, adam.colours, adam.target)
            curve.append((made, psnr_db(adam.image(fixed), adam.target)))
        adam.move(torch.nn.functional.mse_loss(adam.image(intensities), adam.target))
    return curve


def psnr_db(image: torch.Tensor, target: torch.Tensor) -> float:
    """PSNR (dB) of linear sRGB clipped to 0…1, mean over planes, as `IterationState.psnr_db`."""
    errors = (image.clamp(0, 1) - target.clamp(0, 1)).square().mean(dim=(1, 2, 3))
    return float(-10 * torch.log10(errors).mean())


def solved_amplitudes(
    intensities: torch.Tensor, colours: NDArray[np.float64], target: torch.Tensor
) -> NDArray[np.float64]:
    """argmin over a ≥ 0 of |Σ a·colour·intensity − target|²: (wavelength,)."""
    light, targets = intensities.flatten(1).double(), target.movedim(1, 0).flatten(1).double()
    gram = (light @ light.T).numpy() * (colours @ colours.T)
    right = np.einsum("lc,lc->l", colours, (light @ targets.T).numpy())
    root = np.linalg.cholesky(gram).T
    return np.asarray(nnls(root, np.linalg.solve(root.T, right))[0])


def report(rows: Sequence[dict[str, Any]]) -> str:
    """The results as a table."""
    header = ["target, seed, stops", "long run, dB", "Adam's, dB", "iterations", "Adam's"]
    header += ["seconds", "Adam's", "ratio"]
    cells = []
    for row in rows:
        reached, adam = row["iterations"], row["adam_iterations"]
        less = "" if adam else "< "
        cells.append(
            [
                f"{row['target']}, {row['seed']}, {'first order' if row['stops'] else 'none'}",
                *(f"{row[key]:.2f}" for key in ("long_db", "adam_long_db")),
                *(str(n) if n else "not reached" for n in (reached, adam)),
                *(f"{row[key]:.1f}" for key in ("seconds", "adam_seconds")),
                f"{less}{row['seconds'] / row['adam_seconds']:.2f}" if reached else "not reached",
            ]
        )
    return markdown_table(header, cells)
