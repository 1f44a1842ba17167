"""How many FFTs and how much time a good hologram costs: the optimiser against torch's Adam at a constant 0.1 rad.

A long run of each shows which quality can be reached; the goal is 0.2 dB below the better of the two. Both start from
the same random patterns and solve the amplitudes in closed form each tenth iteration. The optimiser's steps shrink over
the planned number of iterations, so its result is the smallest plan that reaches the goal at its end, found by
bisection. Adam's result is the first iteration that reaches the goal.

The time is that number of iterations times the processor time of one on one thread, which is measured in turn: ten
iterations of each, with one solution of the amplitudes, in several rounds.
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
from benchmarks.optimiser_work import colour_work, iteration_ffts, ours
from holoview.benchmark.frame_benchmark import torch_threads

TARGETS = ("still-life", "night", "resolution")
MARGIN_DB = 0.2
_RATE_RAD, _BETAS = 0.1, (0.9, 0.999)
_EVERY = 10  # iterations between two solutions of the amplitudes
_ROUNDS = 7  # in which times are measured
_SHORTEST, _RATIO = 10, 1.05  # of the bisection: fewest iterations, and the ratio at which it stops

Curve = list[tuple[int, float]]
"""Number of iterations and PSNR (dB)."""


def measure(
    seeds: int, long: int, size: Sequence[int], stops: Sequence[bool], targets: Sequence[str] = TARGETS
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
                    rows.append(_compare(work, Masked if has_stops else Cached, long))
                rows[-1] |= {"target": target, "seed": seed, "size": list(size), "stops": has_stops}
                print(report(rows[-1:]), file=sys.stderr, flush=True)
    return rows


def _compare(work: Work, baseline: type[Cached], long: int) -> dict[str, Any]:
    best_db, long_ffts, _ = planned(work, long)
    curve = adam_curve(baseline(work, _RATE_RAD, _BETAS), long)
    adam_db = max(psnr_db for _, psnr_db in curve)
    goal_db = max(best_db, adam_db) - MARGIN_DB
    reached = best_db >= goal_db
    iterations, ffts = shortest_plan(work, goal_db, long, long_ffts) if reached else (None, long_ffts)
    adam = next((made for made, psnr_db in curve if psnr_db >= goal_db), None)
    own_s, adam_s = iteration_seconds(work, baseline)
    return {
        "seconds": own_s * (long if iterations is None else iterations),
        "adam_seconds": adam_s * (long if adam is None else adam),
        "iteration_seconds": own_s,
        "adam_iteration_seconds": adam_s,
        "long_db": best_db,
        "adam_long_db": adam_db,
        "goal_db": goal_db,
        "iterations": iterations,
        "ffts": ffts,
        "adam_iterations": adam,
        "adam_ffts": iteration_ffts(work.system) * (long if adam is None else adam),
        "curve": planned(work, iterations or long)[2],
        "adam_curve": curve,
    }


def iteration_seconds(work: Work, baseline: type[Cached], rounds: int = _ROUNDS) -> tuple[float, float]:
    """Median processor time (s) of an iteration of the optimiser, and of Adam with stored H, measured in turn."""
    own = ours(work, free=("patterns", "amplitudes"), amplitudes_every=_EVERY)
    adam = baseline(work, _RATE_RAD, _BETAS)

    def own_steps() -> None:
        for _ in range(_EVERY):
            next(own)

    def adam_steps() -> None:
        for made in range(_EVERY):
            intensities = adam.intensities(adam.drive)
            if made == 0:
                adam.amplitudes = solved_amplitudes(intensities.detach(), adam.colours, adam.target)
            adam.move(torch.nn.functional.mse_loss(adam.image(intensities), adam.target))

    taken: dict[str, list[float]] = {"own": [], "adam": []}
    for turn in range(rounds + 1):  # the first one isn't counted
        for name, steps in (("own", own_steps), ("adam", adam_steps)):
            started = time.process_time()
            steps()
            if turn:
                taken[name].append(time.process_time() - started)
    own_s, adam_s = (statistics.median(taken[name]) / _EVERY for name in ("own", "adam"))
    return own_s, adam_s


def planned(work: Work, iterations: int) -> tuple[float, float, Curve]:
    """Final PSNR (dB) of a run planned for `iterations`, the number of FFTs that it has to make, and its curve."""
    states = hv.iterate(work.system, work.stack, hv.Settings(iterations=iterations), start=work.drive)
    curve = [(state.iteration, state.psnr_db) for state in states]
    return curve[-1][1], iteration_ffts(work.system) * iterations, curve


def shortest_plan(work: Work, goal_db: float, longest: int, ffts: float) -> tuple[int, float]:
    """The fewest iterations (to 5 %) whose run reaches the goal, and its FFTs.

    longest, ffts: iterations and FFTs of a run that is known to reach it.
    """
    low, high = _SHORTEST, longest
    while high > max(low + 1, _RATIO * low):
        middle = round(math.sqrt(low * high))
        final_db, made, _ = planned(work, middle)
        if final_db >= goal_db:
            high, ffts = middle, made
        else:
            low = middle
    return high, ffts


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
    header = ["target, seed, stops", "long run, dB", "Adam's, dB", "iterations", "Adam's", "FFTs", "Adam's", "ratio"]
    header += ["seconds", "Adam's", "ratio"]
    cells = []
    for row in rows:
        reached, adam = row["iterations"], row["adam_iterations"]
        less = "" if adam else "< "
        ratio = f"{less}{row['ffts'] / row['adam_ffts']:.2f}" if reached else "not reached"
        cells.append(
            [
                f"{row['target']}, {row['seed']}, {'first order' if row['stops'] else 'none'}",
                *(f"{row[key]:.2f}" for key in ("long_db", "adam_long_db")),
                *(str(n) if n else "not reached" for n in (reached, adam)),
                f"{row['ffts']:.0f}",
                f"{'> ' if not adam else ''}{row['adam_ffts']:.0f}",
                ratio,
                *(f"{row[key]:.1f}" for key in ("seconds", "adam_seconds")),
                f"{less}{row['seconds'] / row['adam_seconds']:.2f}" if reached else "not reached",
            ]
        )
    return markdown_table(header, cells)
