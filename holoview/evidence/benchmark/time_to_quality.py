"""The time until a hologram is as good as it gets: the optimiser's, and that of Adam on a loop that keeps H.

A long run of each shows which quality can be reached; the goal is `MARGIN_DB` below the better one. Both begin with the
same random patterns and solve for the amplitudes each tenth iteration. Adam's step stays as it is: of those in
`STEPS_RAD`, the one that reaches the goal first counts, and its result is the first iteration that reaches the goal.
The optimiser's steps fall over the iterations that are planned, so that its result is the smallest plan that ends at
the goal, found by bisection; or a longer plan that takes less time, since its iterations take one plane. Then both are
timed in turn: the optimiser's whole run, with all that it prepares, and Adam's iterations alone.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import torch

from holoview.evidence.benchmark.autograd_loop import ChainLoop, StoredLoop, Work
from holoview.evidence.benchmark.frame_jobs import JobTimings, time_interleaved
from holoview.evidence.benchmark.machine import processor_name
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import LONG_RUN, iterate
from holoview.holograms.targets.picture import Picture
from holoview.holograms.targets.target import target_for
from holoview.holograms.view import random_drive
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.processes import Interruption
from holoview.util.progress import ProgressCallback, no_progress

MARGIN_DB = 0.2
STEPS_RAD = (0.1, 0.2, 0.4)
"""Adam's steps, of which the best counts: phase at the middle wavelength."""
_BETAS = (0.9, 0.999)
_EVERY = 10  # iterations between two solutions for the amplitudes
_SHORTEST, _RATIO = 10, 1.05  # of the bisection: fewest iterations, and the ratio at which it ends
_OWN, _ADAM = "holoview", "Adam"
_SAME_LOSS = 3e-4  # relative: a float32 sum of 1e7 squares is right to 1e-4

Curve = list[tuple[int, float]]
"""Number of iterations and PSNR (dB)."""


@dataclass(frozen=True)
class QualityRun:
    """The scope of a measurement. long: iterations of the long runs. rounds: in which times are measured.

    progress, interruption: of the measurement, which takes minutes.
    """

    long: int = 500
    rounds: int = 3
    steps_rad: Sequence[float] = STEPS_RAD
    progress: ProgressCallback = no_progress
    interruption: Interruption = field(default_factory=Interruption)


def quality_work(system: System, picture: str | os.PathLike[str] | Picture, seed: int = 0, device: str = "cpu") -> Work:
    """The case of a bench, without padding, and of a picture at its middle plane, for a device of torch.

    A chain of elements keeps its padding. Raises UserError for benches that the loop in torch doesn't compute.
    """
    if system.is_chain:
        stack = np.asarray(target_for(system, picture).stack, dtype=np.float32)
        return Work(system, stack, random_drive(system, seed), device)
    if system.frames != 1 or system.is_field:
        raise UserError(system.name, "has several frames or shows a field", expected="one frame of modulators")
    system = system.edit({"propagation": "periodic"})
    stack = np.asarray(target_for(system, picture).stack, dtype=np.float32)
    return Work(system, stack, random_drive(system, seed), device)


def time_to_quality(work: Work, scope: QualityRun = QualityRun()) -> dict[str, Any] | None:
    """Iterations and times to the goal, of both, as JSON values; None if it was interrupted.

    "iterations" and "ratio" are None where the optimiser doesn't reach the goal in a long run; where Adam doesn't, its
    time is that of its long run, and the ratio an upper limit.
    """
    _check_same_loss(work)
    runs: dict[str, Iterator[tuple[int, float]]] = {_OWN: planned(work, scope.long)}
    runs |= {f"{_ADAM}, {step:g} rad": adam_curve(work, step, scope.long) for step in scope.steps_rad}
    curves = [_watched(run, name, number, len(runs), scope) for number, (name, run) in enumerate(runs.items())]
    if scope.interruption():
        return None
    own, long_runs = curves[0], dict(zip(scope.steps_rad, curves[1:], strict=True))
    goal_db = max(own[-1][1], *(psnr_db for curve in long_runs.values() for _, psnr_db in curve)) - MARGIN_DB
    reached = {step: _first(curve, goal_db) for step, curve in long_runs.items()}
    step = min(reached, key=lambda step: (reached[step] or math.inf, -max(db for _, db in long_runs[step])))
    iterations = _fastest_plan(work, goal_db, scope) if own[-1][1] >= goal_db else None
    if scope.interruption():
        return None
    timings = _timed(work, step, iterations or scope.long, scope.rounds)
    adam_iterations = reached[step]
    share = (adam_iterations or scope.long) / _EVERY
    return {
        "preset": work.system.name,
        "size": list(work.system.way.shape[::-1]),
        "wavelengths": len(work.system.wavelengths_m),
        "planes": len(work.system.planes_m),
        "is_chain": work.system.is_chain,
        "processor": processor_name(),
        "device": work.device,
        "threads": torch.get_num_threads(),
        "long": scope.long,
        "long_db": own[-1][1],
        "adam_long_db": max(psnr_db for _, psnr_db in long_runs[step]),
        "adam_step_rad": step,
        "goal_db": goal_db,
        "iterations": iterations,
        "adam_iterations": adam_iterations,
        "seconds": timings[_OWN].median_ms / 1e3,
        "adam_seconds": share * timings[_ADAM].median_ms / 1e3,
        "cpu_seconds": timings[_OWN].cpu_ms / 1e3,
        "adam_cpu_seconds": share * timings[_ADAM].cpu_ms / 1e3,
        "ratio": None if iterations is None else timings[_OWN].median_ms / (share * timings[_ADAM].median_ms),
        "cpu_ratio": None if iterations is None else timings[_OWN].cpu_ms / (share * timings[_ADAM].cpu_ms),
        "curve": list(planned(work, iterations or scope.long)),
        "adam_curve": long_runs[step],
    }


def _watched(run: Iterator[tuple[int, float]], name: str, number: int, count: int, scope: QualityRun) -> Curve:
    """The curve of one of `count` long runs, until an interruption."""
    curve: Curve = []
    for made, psnr_db in run:
        if scope.interruption():
            break
        curve.append((made, psnr_db))
        scope.progress(number * scope.long + made, count * scope.long, f"long run, {name}: {psnr_db:.2f} dB")
    return curve


def planned(work: Work, iterations: int) -> Iterator[tuple[int, float]]:
    """The curve of a run of the optimiser that is planned for so many iterations: PSNR of the best hologram so far."""
    settings = Settings(iterations=iterations)
    for state in iterate(work.system, work.stack, settings, start=work.drive, device=work.device):
        yield state.iteration, state.best_psnr_db


def adam_curve(work: Work, step_rad: float, iterations: int) -> Iterator[tuple[int, float]]:
    """PSNR at each tenth iteration of Adam, with the amplitudes solved for the patterns of that iteration."""
    loop = _rival(work, step_rad)
    for made in range(iterations + 1):
        light = loop.light()
        if made % _EVERY == 0:
            loop.solve_amplitudes(light)
            yield made, loop.psnr_db(light)
        loop.move(loop.loss_of(light))


def _rival(work: Work, step_rad: float = STEPS_RAD[0]) -> Any:
    """The loop of Adam for a bench, with the light, the loss, the step and the amplitudes of each."""
    return (ChainLoop if work.system.is_chain else StoredLoop)(work, step_rad, _BETAS)


def _check_same_loss(work: Work) -> None:
    loop = _rival(work)
    settings = Settings(iterations=1, free=("patterns",))
    loss = next(iterate(work.system, work.stack, settings, start=work.drive, device=work.device)).loss
    found = loop.loss_of(loop.light()).item()
    if not abs(found / loss - 1) <= _SAME_LOSS:
        raise UserError(
            work.system.name,
            f"has a loss of {loss:.6g}, and {found:.6g} by the loop in torch",
            expected="a bench without effects, an eye or several sources",
        )


def _first(curve: Curve, goal_db: float) -> int | None:
    return next((made for made, psnr_db in curve if psnr_db >= goal_db), None)


def _fastest_plan(work: Work, goal_db: float, scope: QualityRun) -> int:
    """The iterations of `_shortest_plan`, or `LONG_RUN` if that takes less time and ends at the goal too."""
    shortest = _shortest_plan(work, goal_db, scope)
    if not shortest < LONG_RUN <= scope.long or scope.interruption():
        return shortest
    *_, (_, psnr_db) = planned(work, LONG_RUN)
    if psnr_db < goal_db:
        return shortest
    jobs = {str(plan): partial(_run, work, plan) for plan in (shortest, LONG_RUN)}
    timings = time_interleaved(jobs, scope.rounds)
    return int(min(timings, key=lambda plan: timings[plan].minimum_ms))


def _shortest_plan(work: Work, goal_db: float, scope: QualityRun) -> int:
    """The fewest iterations (to 5 %) whose run ends at the goal, as one of `scope.long` iterations does."""
    low, high = _SHORTEST, scope.long
    while high > max(low + 1, _RATIO * low) and not scope.interruption():
        middle = round(math.sqrt(low * high))
        scope.progress(scope.long - high + low, scope.long, f"a run of {middle} iterations")
        *_, (_, psnr_db) = planned(work, middle)
        if psnr_db >= goal_db:
            high = middle
        else:
            low = middle
    return high


def _run(work: Work, iterations: int) -> None:
    for _ in planned(work, iterations):
        pass


def _timed(work: Work, step_rad: float, iterations: int, rounds: int) -> dict[str, JobTimings]:
    """Times of a whole run of the optimiser, and of ten iterations of Adam with one solution for the amplitudes."""
    adam = _rival(work, step_rad)

    def adam_steps() -> None:
        for made in range(_EVERY):
            light = adam.light()
            if made == 0:
                adam.solve_amplitudes(light)
            adam.move(adam.loss_of(light))
        adam.wait()

    jobs: dict[str, Callable[[], None]] = {_OWN: partial(_run, work, iterations), _ADAM: adam_steps}
    return time_interleaved(jobs, rounds)


def quality_text(found: Mapping[str, Any]) -> str:
    """A result of `time_to_quality` as lines of text."""
    columns, rows = found["size"]
    header = f"{'':<24}{'long run, dB':>14}{'iterations':>12}{'s':>8}{'processor, s':>14}"
    lines = [header]
    for name, prefix in ((_OWN, ""), (f"Adam, {found['adam_step_rad']:g} rad", "adam_")):
        made = found[f"{prefix}iterations"]
        numbers = f"{found[f'{prefix}seconds']:>8.2f}{found[f'{prefix}cpu_seconds']:>14.2f}"
        lines.append(f"{name:<24}{found[f'{prefix}long_db']:>14.2f}{made or 'not reached':>12}{numbers}")
    if found["ratio"] is None:
        verdict = f"holoview doesn't reach {found['goal_db']:.2f} dB in {found['long']} iterations"
    else:
        limit = "" if found["adam_iterations"] else "at most "
        verdict = f"holoview ÷ Adam: {limit}{found['ratio']:.2f} (processor time {found['cpu_ratio']:.2f})"
    return "\n".join(
        [
            f"{found['preset']}: {columns} x {rows} samples, {found['wavelengths']} wavelengths, "
            f"{found['planes']} planes{'' if found.get('is_chain') else ', not padded'}",
            f"{found['processor']}, {found['threads']} threads of torch",
            f"until a hologram is within {MARGIN_DB} dB of the better of two long runs: {found['goal_db']:.2f} dB",
            "",
            *lines,
            "",
            verdict,
        ]
    )
