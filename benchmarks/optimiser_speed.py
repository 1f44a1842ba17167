"""Compares an iteration of the optimiser with autograd (first the results, then the time) and with its FFTs alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from benchmarks.baselines import Textbook
from benchmarks.optimiser_work import (
    Floor,
    colour_work,
    interleaved,
    iteration_ffts,
    ours,
    summary,
    times_table,
)
from holoview.evidence.benchmark.autograd_loop import Autograd, StoredLoop, Work
from holoview.holograms.optimise.parallel import torch_threads

OWN, SOLVING = "holoview", "holoview, amplitudes solved too"
TEXTBOOK, CACHED, FLOOR = "autograd, textbook", "autograd, cached H", "its FFTs alone"

# Relative differences allowed. With H from float64 what is left is rounding: a float32 sum of 1.2e7 squares is right to
# 1e-4. The textbook's phase, z/λ = 2.4e4 turns in float32, is right to 1e-2 rad.
TOLERANCES = {CACHED: 3e-4, TEXTBOOK: 3e-2}
_DOWNHILL = 0.99  # of the pixels: what the textbook's rounding leaves is 0.999
_WEAK = 0.01  # of the r.m.s. slope: below this, rounding decides the sign


@dataclass(frozen=True)
class Agreement:
    """Agreement of a baseline with the optimiser.

    loss, loss_after: relative difference of the loss at the start and after the optimiser's first step. downhill:
    fraction of pixels that this step moves against the baseline's gradient. gradient: relative L2 difference of the
    baseline's gradient from that with cached transfer functions.
    """

    loss: float
    loss_after: float
    downhill: float
    gradient: float


def check(work: Work) -> dict[str, Agreement]:
    """Compare both baselines with the optimiser. Raises RuntimeError if a difference exceeds its tolerance."""
    states = ours(work)
    start, after = next(states), next(states)
    moved = torch.from_numpy(after.best.drive[0])
    if not after.loss < start.loss or np.array_equal(after.best.drive, work.drive):
        raise RuntimeError("the first step doesn't lower the loss, so that there is nothing to compare after it")
    found: dict[str, Agreement] = {}
    reference: torch.Tensor | None = None
    for name, kind in ((CACHED, StoredLoop), (TEXTBOOK, Textbook)):
        found[name], slope = _compare(kind(work), start.loss, after.loss, moved, reference)
        reference = slope if reference is None else reference
        off = found[name]
        if max(off.loss, off.loss_after, off.gradient) > TOLERANCES[name] or off.downhill < _DOWNHILL:
            raise RuntimeError(f"{name} doesn't compute what the optimiser does: {off}")
    return found


def _compare(
    baseline: Autograd, our_loss: float, our_loss_after: float, moved: torch.Tensor, reference: torch.Tensor | None
) -> tuple[Agreement, torch.Tensor]:
    """Agreement of a baseline with the optimiser's losses and first step, and the baseline's gradient at the start."""
    loss = baseline.loss(baseline.drive)
    (slope,) = torch.autograd.grad(loss, baseline.drive)
    with torch.no_grad():
        loss_after = baseline.loss(moved).item()
    agreement = Agreement(
        loss=abs(loss.item() / our_loss - 1),
        loss_after=abs(loss_after / our_loss_after - 1),
        downhill=_downhill(slope, moved - baseline.drive.detach()),
        gradient=0.0 if reference is None else float((slope - reference).norm() / reference.norm()),
    )
    return agreement, slope


def _downhill(slope: torch.Tensor, step: torch.Tensor) -> float:
    """Fraction of pixels whose step goes against the slope, among those with a step and a significant slope."""
    counts = (slope.abs() > _WEAK * slope.square().mean().sqrt()) & (step != 0)
    return float((slope * step < 0)[counts].float().mean())


def measure(size: Sequence[int], repeats: int, thread_counts: Sequence[int]) -> dict[str, Any]:
    """Agreement, FFTs of an iteration, and times by number of threads."""
    work = colour_work(size)
    agreement = {name: asdict(found) for name, found in check(work).items()}
    result: dict[str, Any] = {
        "agreement": agreement,
        "ffts": iteration_ffts(work.system),
        "threads": {},
    }
    for count in thread_counts:
        with torch_threads(count):
            result["threads"][str(count)] = _times(work, repeats)
    return result


def _times(work: Work, repeats: int) -> dict[str, dict[str, float]]:
    """Times of an iteration: loss, gradient, Adam's step. SOLVING solves the amplitudes in each, not in each fifth."""
    plain, solving = ours(work), ours(work, free=("patterns", "amplitudes"), amplitudes_every=1)
    runs = {
        OWN: lambda: next(plain),
        SOLVING: lambda: next(solving),
        TEXTBOOK: Textbook(work).step,
        CACHED: StoredLoop(work).step,
        FLOOR: Floor(work.system).step,
    }
    return summary(interleaved(runs, repeats), OWN)


def report(result: dict[str, Any]) -> str:
    """The results as text and tables."""
    lines = []
    for name, found in result["agreement"].items():
        lines.append(
            f"{name}: loss differs by {found['loss']:.1e} at the start, {found['loss_after']:.1e} after our step; "
            f"{found['downhill']:.2%} of pixels go against its gradient, which differs by {found['gradient']:.1e}"
        )
    lines.append(f"FFTs of an iteration: {result['ffts']:g}")
    for count, rows in result["threads"].items():
        lines += ["", times_table("", count, rows, list(rows))]
    return "\n".join(lines)
