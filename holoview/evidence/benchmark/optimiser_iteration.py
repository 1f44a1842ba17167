"""Times an iteration of the optimiser on the processor and on the card that PyTorch computes on, for equal patterns.

Also the way of a hologram from there to the shaders.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import cycle
from typing import Any
from warnings import catch_warnings

import numpy as np
import torch

from holoview.evidence.benchmark.frame_jobs import (
    full_frame,
    open_renderer,
    time_interleaved,
    update_and_wait,
)
from holoview.holograms.optimise.checkpoint import IterationState
from holoview.holograms.optimise.memory import with_compact_grid
from holoview.holograms.optimise.parallel import resolve_torch_device
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.holograms.view import random_drive
from holoview.light.gpu.device import Device
from holoview.light.model.system import System
from holoview.util.errors import UserError

_SETTINGS = Settings(iterations=1_000_000, free=("patterns",), drawn_planes=0)
_LAUNCHED = ", not recorded"
_DRIVE_SEED, _STACK_SEED = 0, 1
_AGREEING = 3
"""Iterations after which the losses are compared."""


def time_iterations(system: System, rounds: int, limit_s: float, devices: tuple[str, ...] = ()) -> dict[str, Any]:
    """Times of an iteration (ms) and losses by torch device, as JSON values.

    An iteration is the loss in linear sRGB at all planes, its gradient for all patterns, and Adam's step, on the
    compact grid that `holoview optimise` uses. The target is noise: an iteration takes equally long for any target.

    devices: of torch; by default the processor, and CUDA or MPS where there is one. On CUDA an iteration is timed
    twice: recorded as a CUDA graph, and launched operation by operation. limit_s: no further round begins after this
    time.
    """
    compact = with_compact_grid(system)
    rows, columns = system.way.shape
    stack = np.random.default_rng(_STACK_SEED).random((len(system.planes_m), rows, columns, 3), dtype=np.float32)
    names = devices or tuple(dict.fromkeys(("cpu", resolve_torch_device())))
    runs, failures, losses = {}, {}, {}
    for name in names:
        with catch_warnings(action="error", category=RuntimeWarning):  # an iteration that can't be recorded
            for way, record in {name: True, f"{name}{_LAUNCHED}": False}.items():
                if not (record or name.startswith("cuda")):
                    continue
                try:
                    states = iterate(compact, stack, _SETTINGS, device=resolve_torch_device(name), record=record)
                    losses[way] = [next(states).loss for _ in range(_AGREEING)]
                    runs[way] = states
                except (UserError, RuntimeError, RuntimeWarning) as error:  # torch has no class for what devices lack
                    failures[way] = str(error).partition("\n")[0]
    jobs = {name: partial(_step, name, states) for name, states in runs.items()}
    timings = time_interleaved(jobs, rounds, limit_s=limit_s)
    return {
        "size": [columns, rows],
        "wavelengths": len(system.wavelengths_m),
        "planes": len(system.planes_m),
        "threads": torch.get_num_threads(),
        "median_ms": {name: timing.median_ms for name, timing in timings.items()},
        "minimum_ms": {name: timing.minimum_ms for name, timing in timings.items()},
        "losses": losses,
        "failures": failures,
    }


def time_handover(system: System, device: Device, rounds: int, name: str = "auto") -> dict[str, float]:
    """Median times (ms) on the way of a hologram from the optimiser to its picture, for a device of torch.

    The shaders' library can't share a card's memory with torch: patterns are copied to the processor, and from there.
    """
    place, whole = resolve_torch_device(name), ""
    renderer = open_renderer(system, device)
    drives = [random_drive(system, seed) for seed in range(2)]
    parts = [drive if system.is_chain else {whole: drive} for drive in drives]
    patterns = cycle([{own: torch.from_numpy(p).to(place) for own, p in drive.items()} for drive in parts])

    def fetch() -> dict[str, Any]:
        return {own: tensor.cpu().numpy() for own, tensor in next(patterns).items()}

    def show() -> None:
        drive = fetch()
        renderer.edit(drive=drive if system.is_chain else drive[whole])
        update_and_wait(renderer)

    jobs = {
        f"patterns from {place} to the processor": lambda: (fetch(), None)[1],
        "patterns to the shaders, and a frame": show,
        "a frame": full_frame(renderer),
    }
    return {job: timing.median_ms for job, timing in time_interleaved(jobs, rounds).items()}


def _step(device: str, states: Iterator[IterationState]) -> None:
    """One iteration, to its end."""
    next(states)
    if device.startswith("cuda"):
        torch.cuda.synchronize()
