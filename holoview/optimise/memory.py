"""Estimate of the memory that an optimisation needs, and an error that says what to reduce."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import psutil

from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.optimise.lasers import lit_lasers
from holoview.util.errors import UserError

_COMPLEX64, _FLOAT32 = 8, 4
_WAVELENGTH_GRADIENT_FIELDS = 12  # maps in double precision and products, for one beam at a time

FIELD_BUDGET_BYTES = 4 << 30
"""The most memory that the fields of all beams at one plane may take to be kept for the gradient."""


def with_compact_grid(system: System) -> System:
    """The system with `propagation` "compact" in place of "linear": padded by the walk-off only, half the work."""
    return system.with_(propagation="compact") if system.sampling.propagation == "linear" else system


def should_keep_fields(plan: Plan) -> bool:
    """Whether the fields of all beams at one plane are kept for the gradient; otherwise they are propagated again."""
    return _beam_count(plan) * _field_bytes(plan) <= FIELD_BUDGET_BYTES


def peak_bytes(system: System, *, free_wavelengths: bool = False) -> int:
    """Peak memory of an optimisation on the compact grid, within 10 %, of patterns or of wavelengths as well."""
    return _estimate_bytes(make_plan(with_compact_grid(system)), free_wavelengths)


@contextmanager
def memory_guard(plan: Plan, device: str, *, free_wavelengths: bool = False) -> Iterator[None]:
    """Raises UserError if the machine has too little memory for an optimisation, or if it runs out inside the block.

    The error says how much is needed and which options to lower.
    """
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


def _estimate_bytes(plan: Plan, free_wavelengths: bool) -> int:
    """Transfer functions, three or four fields a beam, an intensity a laser, the target, and temporaries of FFTs."""
    wavelengths = int(np.count_nonzero(plan.weights.any(axis=0)))
    planes, modulators = len(plan.planes_m), len(plan.system.modulators)
    fields_per_beam = modulators + 1 + should_keep_fields(plan) + free_wavelengths
    fields = wavelengths * (planes + 1) + _beam_count(plan) * fields_per_beam + 6
    fields += _WAVELENGTH_GRADIENT_FIELDS * free_wavelengths
    images = len(lit_lasers(plan)) + 6 * planes + 9
    return fields * _field_bytes(plan) + images * math.prod(plan.grid.shape) * _FLOAT32


def _beam_count(plan: Plan) -> int:
    """Coherent beams: a laser that is on makes one for each source direction."""
    return len(lit_lasers(plan)) * len(plan.slopes)


def _field_bytes(plan: Plan) -> int:
    return math.prod(plan.grid.padded) * _COMPLEX64


def _gib(count: float) -> str:
    return f"{count / 2**30:.3g} GiB"


def _out_of_memory_error(needed: int, problem: str) -> UserError:
    return UserError(
        "optimisation",
        f"needs about {_gib(needed)} of memory {problem}",
        remedy="lower shape, upsample, frames, sources, or the number of planes or wavelengths",
    )
