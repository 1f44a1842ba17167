"""The optimiser beside odak and torchoptics, one wavelength, one modulator, 3 planes: an iteration, and the time to
a good hologram."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from itertools import accumulate
from typing import Any

from benchmarks.baselines_peers import LIBRARIES, PEERS, OdakOptimiser, Peer, installed, odak_kept
from benchmarks.common import markdown_table
from benchmarks.optimiser_work import Run, interleaved, mono_work, ours, summary, times_table
from holoview.evidence.benchmark.autograd_loop import Work
from holoview.evidence.benchmark.frame_jobs import time_interleaved
from holoview.evidence.benchmark.time_to_quality import MARGIN_DB, STEPS_RAD
from holoview.holograms.optimise.parallel import torch_threads

OWN, ODAK_OPTIMISER = "holoview", "odak, multi_color_hologram_optimizer"
PADDINGS = {"none": (1, "periodic"), "twofold": (2, "linear")}


def measure(size: Sequence[int], repeats: int, thread_counts: Sequence[int]) -> dict[str, Any]:
    """For each padding the differences of the losses and the times; versions are None for missing libraries."""
    result: dict[str, Any] = {"versions": {library: installed(library) for library in LIBRARIES}, "paddings": {}}
    for name, (padding, propagation) in PADDINGS.items():
        work = mono_work(size, propagation)
        found: dict[str, Any] = {"loss_differences": loss_differences(work, padding), "threads": {}}
        for count in thread_counts:
            with torch_threads(count):
                found["threads"][str(count)] = summary(interleaved(_runs(work, padding), repeats), OWN)
        result["paddings"][name] = found
    return result


def loss_differences(work: Work, padding: int) -> dict[str, float]:
    """Relative difference of each library's first loss from the optimiser's, since their models differ slightly."""
    loss = next(ours(work)).loss
    return {name: abs(peer.loss().item() / loss - 1) for name, peer in _peers(work, padding).items()}


def measure_quality(size: Sequence[int], long: int, rounds: int) -> dict[str, Any] | None:
    """Processor time until the loss is within 0.2 dB of the best of all long runs, padded twofold, one thread.

    A library's loop is that of `Peer`, with Adam's best step; their losses agree, so that one curve serves for all.
    None without odak. "iterations" is None where holoview's long run doesn't reach the goal; its time is then given.
    """
    if not installed("odak"):
        return None
    work = mono_work(size, PADDINGS["twofold"][1])
    with torch_threads(1):
        curves = {step: list(accumulate(_losses(odak_kept(work, 2), step, long), min)) for step in STEPS_RAD}
        own, best = _planned_loss(work, long), min(curve[-1] for curve in curves.values())
        goal = 10 ** (MARGIN_DB / 10) * min(own, best)
        step = min(curves, key=lambda step: (sum(loss > goal for loss in curves[step]), curves[step][-1]))
        counts = range(1, long + 1)
        least = bisect.bisect_left(counts, True, hi=long - 1, key=lambda count: _planned_loss(work, count) <= goal)
        jobs: dict[str, Run] = {OWN: lambda: _planned_loss(work, counts[least])}
        jobs |= {name: peer.step for name, peer in _peers(work, 2).items()}
        seconds = {name: job.cpu_ms / 1e3 for name, job in time_interleaved(jobs, rounds).items()}
    return {
        "step_rad": step,
        "goal_db": _db(goal),
        "long_db": _db(own),
        "their_long_db": _db(best),
        "iterations": counts[least] if own <= goal else None,
        "their_iterations": sum(loss > goal for loss in curves[step]),
        "seconds": seconds,
    }


def _db(loss: float) -> float:
    return -10 * math.log10(loss)


def _losses(peer: Peer, step_rad: float, iterations: int) -> list[float]:
    peer.adam.param_groups[0]["lr"] = step_rad
    return [peer.step() for _ in range(iterations)]


def _planned_loss(work: Work, iterations: int) -> float:
    """The loss of the best hologram of a run that is planned for so many iterations."""
    return min(state.loss for state in ours(work, iterations=iterations))


def report_quality(found: dict[str, Any] | None) -> str:
    """The result as a table."""
    if found is None:
        return "odak isn't installed"
    seconds, theirs, own = found["seconds"], found["their_iterations"], found["seconds"][OWN]
    reaches = found["iterations"] is not None
    cells = [[OWN, f"{found['long_db']:.2f}", str(found["iterations"] or "not reached"), f"{own:.2f}", ""]]
    for name in [name for name in seconds if name != OWN]:
        spent = theirs * seconds[name]
        ratio = f"{own / spent:.3f}" if reaches else "not reached"
        cells.append([name, f"{found['their_long_db']:.2f}", str(theirs), f"{spent:.1f}", ratio])
    header = ["", "long run, dB", f"iterations to {found['goal_db']:.2f} dB", "processor time, s", "holoview ÷ it"]
    return f"Adam's step: {found['step_rad']:g} rad\n\n{markdown_table(header, cells)}"


def _peers(work: Work, padding: int) -> dict[str, Peer]:
    """The installed libraries."""
    return {name: make(work, padding) for name, (library, make) in PEERS.items() if installed(library)}


def _runs(work: Work, padding: int) -> dict[str, Run]:
    """An iteration of the optimiser and of each installed library."""
    states = ours(work)
    runs: dict[str, Run] = {OWN: lambda: next(states)}
    runs |= {name: peer.step for name, peer in _peers(work, padding).items()}
    if installed("odak") and padding == 2:
        runs[ODAK_OPTIMISER] = OdakOptimiser(work).step
    return runs


def report(result: dict[str, Any]) -> str:
    """The results as tables."""
    lines = [", ".join(f"{library} {number or 'not installed'}" for library, number in result["versions"].items())]
    names = [OWN, *PEERS, ODAK_OPTIMISER]
    for padding, found in result["paddings"].items():
        lines.append("")
        for name, off in found["loss_differences"].items():
            lines.append(f"padding {padding}: the first loss of {name} differs from ours by {off:.1e}")
        for count, rows in found["threads"].items():
            shown = [name for name in names if name != ODAK_OPTIMISER or padding == "twofold"]
            lines += ["", times_table(f"padding {padding}, ", count, rows, shown)]
    return "\n".join(lines)
