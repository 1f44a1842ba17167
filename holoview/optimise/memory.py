"""What an optimisation holds in memory, and a clear word when that is more than there is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import psutil

from holoview.errors import UserError
from holoview.plan import Plan, make_plan
from holoview.system import System

_COMPLEX64, _FLOAT32 = 8, 4
_FIELD_BUDGET_BYTES = 4 << 30
_CHROMATIC_FIELDS = 12  # maps in double precision and products, for one beam at a time


def on_compact_grid(system: System) -> System:
    """The system padded by the walk-off only, where it is padded to twice its size: about half the work."""
    return system.with_(propagation="compact") if system.sampling.propagation == "linear" else system


def keeps_fields(plan: Plan) -> bool:
    """Whether the fields of all beams at one plane are kept for the gradient; else they are propagated once more."""
    return _beams(plan) * _field_bytes(plan) <= _FIELD_BUDGET_BYTES


def peak_bytes(system: System, *, chromatic: bool = False) -> int:
    """What optimising on the compact grid holds at its peak, within a tenth or so; chromatic: wavelengths too."""
    return _bytes_of(make_plan(on_compact_grid(system)), chromatic)


@contextmanager
def needs_memory(plan: Plan, device: str, *, chromatic: bool = False) -> Iterator[None]:
    """UserError with what is needed and what to lower, where there is less, or where it runs out in the block."""
    needed = _bytes_of(plan, chromatic)
    if device == "cpu" and needed > psutil.virtual_memory().total:
        raise _too_little(needed, f"of {_gib(psutil.virtual_memory().total)}")
    try:
        yield
    except MemoryError as error:
        raise _too_little(needed, "and ran out") from error
    except RuntimeError as error:
        if "memory" not in str(error).lower():
            raise
        raise _too_little(needed, f"on {device} and ran out") from error


def _bytes_of(plan: Plan, chromatic: bool) -> int:
    """Transfer functions, three or four fields a beam, an intensity a laser, the target, and what FFTs take."""
    wavelengths = int(np.count_nonzero(plan.weights.any(axis=0)))
    planes, modulators = len(plan.planes_m), len(plan.system.modulators)
    fields = wavelengths * (planes + 1) + _beams(plan) * (modulators + 1 + keeps_fields(plan) + chromatic) + 6
    lasers = int(np.count_nonzero(plan.weights))
    fields += _CHROMATIC_FIELDS * chromatic
    images = lasers + 6 * planes + 9
    return fields * _field_bytes(plan) + images * math.prod(plan.grid.shape) * _FLOAT32


def _beams(plan: Plan) -> int:
    """Lasers that are on, counted in each frame and for each source direction."""
    return int(np.count_nonzero(plan.weights)) * len(plan.slopes)


def _field_bytes(plan: Plan) -> int:
    return math.prod(plan.grid.padded) * _COMPLEX64


def _gib(count: float) -> str:
    return f"{count / 2**30:.3g} GiB"


def _too_little(needed: int, found: str) -> UserError:
    return UserError(
        "optimisation",
        f"needs about {_gib(needed)} of memory {found}",
        remedy="lower shape, upsample, frames, sources, or the number of planes or wavelengths",
    )
