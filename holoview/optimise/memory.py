"""What an optimisation holds in memory, and a clear word when that is more than there is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import psutil

from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.util.errors import UserError

_COMPLEX64, _FLOAT32 = 8, 4
_FIELD_BUDGET_BYTES = 4 << 30
_WAVELENGTH_GRADIENT_FIELDS = 12  # maps in double precision and products, for one beam at a time


def with_compact_grid(system: System) -> System:
    """The system padded by the walk-off only, where it is padded to twice its size: about half the work."""
    return system.with_(propagation="compact") if system.sampling.propagation == "linear" else system


def should_keep_fields(plan: Plan) -> bool:
    """Whether the fields of all beams at one plane are kept for the gradient; else they are propagated once more."""
    return _beam_count(plan) * _field_bytes(plan) <= _FIELD_BUDGET_BYTES


def peak_bytes(system: System, *, free_wavelengths: bool = False) -> int:
    """What optimising on the compact grid holds at its peak, within a tenth or so; chromatic: wavelengths too."""
    return _estimate_bytes(make_plan(with_compact_grid(system)), free_wavelengths)


@contextmanager
def memory_guard(plan: Plan, device: str, *, free_wavelengths: bool = False) -> Iterator[None]:
    """UserError with what is needed and what to lower, where there is less, or where it runs out in the block."""
    needed = _estimate_bytes(plan, free_wavelengths)
    if device == "cpu" and needed > psutil.virtual_memory().total:
        raise _out_of_memory_error(needed, f"of {_gib(psutil.virtual_memory().total)}")
    try:
        yield
    except MemoryError as error:
        raise _out_of_memory_error(needed, "and ran out") from error
    except RuntimeError as error:
        if "memory" not in str(error).lower():
            raise
        raise _out_of_memory_error(needed, f"on {device} and ran out") from error


def _estimate_bytes(plan: Plan, chromatic: bool) -> int:
    """Transfer functions, three or four fields a beam, an intensity a laser, the target, and what FFTs take."""
    wavelengths = int(np.count_nonzero(plan.weights.any(axis=0)))
    planes, modulators = len(plan.planes_m), len(plan.system.modulators)
    fields = (
        wavelengths * (planes + 1) + _beam_count(plan) * (modulators + 1 + should_keep_fields(plan) + chromatic) + 6
    )
    lasers = int(np.count_nonzero(plan.weights))
    fields += _WAVELENGTH_GRADIENT_FIELDS * chromatic
    images = lasers + 6 * planes + 9
    return fields * _field_bytes(plan) + images * math.prod(plan.grid.shape) * _FLOAT32


def _beam_count(plan: Plan) -> int:
    """Lasers that are on, counted in each frame and for each source direction."""
    return int(np.count_nonzero(plan.weights)) * len(plan.slopes)


def _field_bytes(plan: Plan) -> int:
    return math.prod(plan.grid.padded) * _COMPLEX64


def _gib(count: float) -> str:
    return f"{count / 2**30:.3g} GiB"


def _out_of_memory_error(needed: int, found: str) -> UserError:
    return UserError(
        "optimisation",
        f"needs about {_gib(needed)} of memory {found}",
        remedy="lower shape, upsample, frames, sources, or the number of planes or wavelengths",
    )
