"""Times an iteration of the optimiser, of odak and of torchoptics: one wavelength, one modulator, 3 planes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.baselines_peers import LIBRARIES, PEERS, OdakOptimiser, Peer, installed
from benchmarks.optimiser_work import Run, interleaved, mono_work, ours, summary, times_table
from holoview.benchmark.autograd_loop import Work
from holoview.benchmark.frame_benchmark import torch_threads

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
