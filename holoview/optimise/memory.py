"""What an optimisation holds in memory, and whether it can keep the fields that the gradient needs."""

from __future__ import annotations

import math

import numpy as np

from holoview.plan import Plan, make_plan
from holoview.system import System

_COMPLEX64, _FLOAT32 = 8, 4
_TRACE_BUDGET_BYTES = 4 << 30
_COLOUR_IMAGES = 6 * 3  # target, result, residual and their intermediates, of three channels each


def on_compact_grid(system: System) -> System:
    """The system padded by the walk-off only, where it is padded to twice its size: about half the work."""
    return system.with_(propagation="compact") if system.sampling.propagation == "linear" else system


def keeps_traces(plan: Plan) -> bool:
    """Whether the fields of all lasers are kept for the gradient; else each is propagated a second time."""
    return _lasers(plan) * _trace_bytes(plan) <= _TRACE_BUDGET_BYTES


def peak_bytes(system: System) -> int:
    """What optimising on the compact grid holds at its peak, within a tenth or so.

    Transfer functions, kept fields, an intensity a laser and frame, and the colour images.
    """
    plan = make_plan(on_compact_grid(system))
    planes = len(plan.planes_m)
    wavelengths = int(np.count_nonzero(plan.weights.any(axis=0)))
    transfers = wavelengths * (planes + len(system.modulators) - 1) * math.prod(plan.grid.padded) * _COMPLEX64
    kept = (_lasers(plan) if keeps_traces(plan) else 1) * _trace_bytes(plan)
    images = (_lasers(plan) + _COLOUR_IMAGES) * planes * math.prod(plan.grid.shape) * _FLOAT32
    return transfers + kept + images


def _lasers(plan: Plan) -> int:
    """Lasers that are on, counted in each frame."""
    return int(np.count_nonzero(plan.weights))


def _trace_bytes(plan: Plan) -> int:
    """Fields of one laser in one frame: behind each modulator and at each plane, for every source."""
    fields = len(plan.planes_m) + len(plan.system.modulators)
    return len(plan.slopes) * fields * math.prod(plan.grid.shape) * _COMPLEX64
