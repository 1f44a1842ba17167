"""Estimate of the memory that an optimisation needs, and an error that names the options to lower."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import psutil

from holoview.holograms.optimise.lasers import lit_lasers
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

_COMPLEX64, _FLOAT32 = 8, 4
_WAVELENGTH_GRADIENT_FIELDS = 6  # maps in double precision and products, for one beam at a time
_BLOCKS_A_MODULATOR = 2  # blocks at a time, beside one for each modulator: inputs and results of FFTs, and squares
_IMAGES_A_PLANE, _IMAGES = 6, 16  # targets; the image of a plane, the drive, its moments and gradients
_STRUCTURE_IMAGES, _STRUCTURE_FIELDS = 30, 2  # for slopes of a channel's MS-SSIM; a plane's fields and squares

_TARGET_BYTES = 48  # of a sample of a plane of the target, while it is made
_REMEDY = "lower shape, upsample, frames, sources, or the number of planes or wavelengths"

CPU_BLOCK_BYTES = 1 << 20
"""Size of a block of complex numbers on the CPU: a core's second-level cache holds it."""


def with_compact_grid(system: System) -> System:
    """The system with `propagation` "compact" in place of "linear": padded by the walk-off only, half the work.

    A chain of elements keeps its grid.
    """
    is_linear = system.sampling.propagation == "linear" and not system.is_chain
    return system.with_(propagation="compact") if is_linear else system


def peak_bytes(system: System, *, free_wavelengths: bool = False, whole_planes: bool = False) -> int:
    """Peak memory of the tensors of an optimisation on the compact grid, within 10 % where torch computes.

    free_wavelengths: of these too.
    whole_planes: for a loss by structure, which takes a plane at once.

    Its process takes more: 7 to 90 MiB were measured with patterns alone (1024 × 768 samples, Linux, 2 threads: tables
    and threads of the FFTs, and what the C library's allocator keeps), and up to 500 MiB after a step of wavelengths.
    """
    return _estimate_bytes(make_plan(with_compact_grid(system)), free_wavelengths, whole_planes)


def require_optimisation_memory(system: System, *, free_wavelengths: bool = False) -> None:
    """Raises UserError unless an optimisation and its target fit into the memory that may be taken."""
    if system.is_chain:
        return  # its own loop asks for its memory
    plan = make_plan(with_compact_grid(system))
    target = len(plan.planes_m) * math.prod(plan.grid.shape) * _TARGET_BYTES
    require_memory("optimisation", _estimate_bytes(plan, free_wavelengths, False) + target, remedy=_REMEDY)


@contextmanager
def memory_guard(
    plan: Plan,
    device: str,
    *,
    free_wavelengths: bool = False,
    whole_planes: bool = False,
    drawn_pupils: int = 0,
    is_made: bool = False,
) -> Iterator[None]:
    """Raises UserError if the machine has too little memory for an optimisation, or if it runs out inside the block.

    drawn_pupils: how many places of the plan's planes are drawn anew; factors that they share are kept as well.
    is_made: whether it has its memory, which is then not compared with the machine's again.
    The error says how much is needed and which options to lower.
    """

    def needed() -> int:
        return _estimate_bytes(plan, free_wavelengths, whole_planes, drawn_pupils)

    if not is_made and device == "cpu" and needed() > psutil.virtual_memory().total:
        raise _out_of_memory_error(needed(), f"of {_gib(psutil.virtual_memory().total)}")
    try:
        yield
    except MemoryError as error:
        raise _out_of_memory_error(needed(), "and ran out") from error
    except RuntimeError as error:
        if "memory" not in str(error).lower():
            raise
        raise _out_of_memory_error(needed(), f"on {device} and ran out") from error


def _estimate_bytes(plan: Plan, free_wavelengths: bool, whole_planes: bool, drawn_pupils: int = 0) -> int:
    """Transfer functions, spectra and lines of all beams, phasors, images, and blocks that are computed at a time."""
    lasers, modulators = len(lit_lasers(plan)), len(plan.system.modulators)
    beams, wavelengths = lasers * len(plan.slopes), int(np.count_nonzero(plan.weights.any(axis=0)))
    last, gap = (_band_shape(plan, relay) for relay in (1, 0 if modulators == 2 else 1))
    line_length = last[1] + (gap[1] if modulators == 2 else 0)
    spectra = 2 + free_wavelengths
    kept = len(plan.planes_m) // drawn_pupils if drawn_pupils else 0
    numbers = wavelengths * ((len(plan.planes_m) + kept) * math.prod(last) + math.prod(gap))
    numbers += beams * (spectra * math.prod(last) + plan.grid.shape[0] * line_length)
    numbers += lasers * modulators * math.prod(plan.system.modulators[0].shape)
    field_bytes = math.prod(plan.grid.padded) * _COMPLEX64
    at_a_time = (_BLOCKS_A_MODULATOR + modulators) * min(beams * field_bytes, CPU_BLOCK_BYTES)
    if free_wavelengths:
        at_a_time += 2 * max(field_bytes, min(beams * field_bytes, CPU_BLOCK_BYTES))
        at_a_time += _WAVELENGTH_GRADIENT_FIELDS * field_bytes
    images = _IMAGES_A_PLANE * len(plan.planes_m) + _IMAGES
    if whole_planes:
        sample_bytes = _STRUCTURE_FIELDS * beams * _COMPLEX64 + _STRUCTURE_IMAGES * _FLOAT32
        at_a_time = max(at_a_time, math.prod(plan.grid.shape) * sample_bytes)
    return numbers * _COMPLEX64 + at_a_time + images * math.prod(plan.grid.shape) * _FLOAT32


def _band_shape(plan: Plan, relay: int) -> tuple[int, int]:
    """Frequencies (y, x) of a relay's band that are computed."""
    rows, columns = map(min, plan.band(relay).shape, plan.grid.padded)
    return rows, columns


def _gib(count: float) -> str:
    return f"{count / 2**30:.3g} GiB"


def _out_of_memory_error(needed: int, problem: str) -> UserError:
    return UserError(
        "optimisation",
        f"needs about {_gib(needed)} of memory {problem}",
        remedy=_REMEDY,
    )
