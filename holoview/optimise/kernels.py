"""From the fields of a plane to its image and back: by torch, or compiled by numba, with fewer passes over memory.

`Kernels`           the operations, by torch: the reference, and what other devices than the CPU use
`CompiledKernels`   the same, compiled for this processor; results differ by rounding
`choose_kernels`    the faster of both on this machine, measured once and remembered

The compiled operations hold no lock of Python, so that each thread of a `ThreadTeam` works on its own block. numba
keeps its machine code in the user's cache folder, for each processor and version.
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import cache_dir
from holoview.util.packages import import_optional

Tensor = torch.Tensor


class Kernels:
    """Operations on fields (laser, source, row, x), complex, by torch. name: of this way to compute them."""

    name = "torch"

    def mix(self, fields: Tensor, weights: Tensor) -> Tensor:
        """The image (channel, row, x) Σ weight·|E|². weights (beam, channel): of each laser from each source."""
        squares = torch.view_as_real(fields.movedim(2, 0)).square().flatten(1, 2).flatten(2)
        products = weights.T @ squares
        pairs = products.view(*products.shape[:-1], -1, 2)
        return (pairs[..., 0] + pairs[..., 1]).movedim(1, 0)

    def replace_by_adjoint(self, fields: Tensor, weights: Tensor, slopes: Tensor) -> None:
        """Replaces fields E by c_E = 2·g·conj(E), with g the slopes weighted for each beam.

        weights (beam, channel). slopes (channel, row, x): ∂L/∂image.
        """
        # g·(1 − i): pairs (g, −g) for the real and the imaginary part of conj(E)
        pairs = torch.view_as_real(slopes.movedim(1, 0).to(fields.dtype) * (1 - 1j)).flatten(2)
        parts = torch.view_as_real(fields.movedim(2, 0))
        parts.mul_(((2 * weights) @ pairs).view(parts.shape))

    def replace_by_residual(self, image: Tensor, target: Tensor, factor: float) -> tuple[Tensor, Tensor]:
        """Replaces an image (channel, row, x) by factor·(image − target); the norms of two differences.

        These are image − target, and the same of both clipped to 0…1.
        """
        error_norm = torch.linalg.vector_norm(image.clamp(0, 1).sub_(target.clamp(0, 1)))
        residual_norm = torch.linalg.vector_norm(image.sub_(target))
        image.mul_(factor)
        return residual_norm, error_norm


TORCH_KERNELS = Kernels()
"""The reference."""


class CompiledKernels(Kernels):
    """The same operations by numba, on the CPU; of fields whose rows are contiguous.

    Raises UserError if numba isn't installed or can't be loaded.
    """

    name = "compiled"

    def __init__(self) -> None:
        self._mix, self._weight, self._residual = _compiled()

    def mix(self, fields: Tensor, weights: Tensor) -> Tensor:
        image = weights.new_empty(weights.shape[1], *fields.shape[2:])
        self._mix(*_flat(fields), weights.contiguous().numpy(), image.numpy())
        return image

    def replace_by_adjoint(self, fields: Tensor, weights: Tensor, slopes: Tensor) -> None:
        self._weight(*_flat(fields), (2 * weights).contiguous().numpy(), slopes.contiguous().numpy())

    def replace_by_residual(self, image: Tensor, target: Tensor, factor: float) -> tuple[Tensor, Tensor]:
        norms = image.new_empty(2)
        self._residual(*_flat(image), *_flat(target)[::2], image.new_full((1,), factor).numpy(), norms.numpy())
        return norms[0], norms[1]


def _flat(values: Tensor) -> tuple[NDArray[np.floating], tuple[int, ...], tuple[int, ...]]:
    """A tensor (…, x) with contiguous rows as numba's loops take it: one axis, and the sizes and strides of all others.

    Loops over one axis without gaps use the processor's vectors. Real and imaginary parts of complex numbers alternate.
    """
    parts = torch.view_as_real(values).flatten(-2) if values.is_complex() else values
    assert parts.stride(-1) == 1
    length = 1 + sum((size - 1) * stride for size, stride in zip(parts.shape, parts.stride(), strict=True))
    return parts.as_strided((length,), (1,)).numpy(), tuple(parts.shape), parts.stride()[:-1]


# --- what numba compiles ---------------------------------------------------------------------------------------------


def _mix_loops(flat: Any, shape: Any, strides: Any, weights: Any, image: Any) -> None:
    channels, rows, samples = image.shape
    power = np.empty(samples, image.dtype)
    for row in range(rows):
        image[:, row] = 0
        for laser in range(shape[0]):
            for source in range(shape[1]):
                first = laser * strides[0] + source * strides[1] + row * strides[2]
                field = flat[first : first + 2 * samples]
                for x in range(samples):
                    power[x] = field[2 * x] * field[2 * x] + field[2 * x + 1] * field[2 * x + 1]
                for channel in range(channels):
                    weight, line = weights[laser * shape[1] + source, channel], image[channel, row]
                    for x in range(samples):
                        line[x] += weight * power[x]


def _weight_loops(flat: Any, shape: Any, strides: Any, weights: Any, slopes: Any) -> None:
    channels, rows, samples = slopes.shape
    slope = np.empty(samples, slopes.dtype)
    for row in range(rows):
        for laser in range(shape[0]):
            for source in range(shape[1]):
                slope[:] = 0
                for channel in range(channels):
                    weight, line = weights[laser * shape[1] + source, channel], slopes[channel, row]
                    for x in range(samples):
                        slope[x] += weight * line[x]
                first = laser * strides[0] + source * strides[1] + row * strides[2]
                field = flat[first : first + 2 * samples]
                for x in range(samples):
                    field[2 * x] *= slope[x]
                    field[2 * x + 1] *= -slope[x]


def _residual_loops(
    flat: Any, shape: Any, strides: Any, target_flat: Any, target_strides: Any, factor: Any, norms: Any
) -> None:
    samples = shape[2]
    low, high, scale = norms.dtype.type(0), norms.dtype.type(1), factor[0]
    residuals = errors = 0.0
    for channel in range(shape[0]):
        for row in range(shape[1]):
            first = channel * strides[0] + row * strides[1]
            image = flat[first : first + samples]
            first = channel * target_strides[0] + row * target_strides[1]
            target = target_flat[first : first + samples]
            for x in range(samples):
                residual = image[x] - target[x]
                error = min(max(image[x], low), high) - min(max(target[x], low), high)
                residuals += residual * residual
                errors += error * error
                image[x] = residual * scale
    norms[0], norms[1] = np.sqrt(residuals), np.sqrt(errors)


@cache
def _compiled() -> tuple[Callable[..., None], ...]:
    """The loops as machine code, compiled when first called with numbers of some precision."""
    numba = import_optional("numba", "compiled kernels")
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(cache_dir() / "numba")  # read where a function is decorated
    try:
        return tuple(
            numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})(loops)
            for loops in (_mix_loops, _weight_loops, _residual_loops)
        )
    finally:
        numba.config.CACHE_DIR = before


# --- the choice ------------------------------------------------------------------------------------------------------

_FORMAT = 1
"""Of the file of choices; to be increased when loops become faster or slower."""
_FILE = "optimiser-kernels.json"
_BLOCK = (8, 1, 16, 1024)  # lasers, sources, rows, samples: 1 MiB, as a block on the processor
_ROUNDS = 5


@cache
def choose_kernels(device: str) -> Kernels:
    """The faster kernels for a torch device: compiled ones only on the CPU, and where numba is installed.

    Both are timed when a machine computes its first hologram, and the choice is kept in the user's cache folder.
    """
    if torch.device(device).type != "cpu" or find_spec("numba") is None:
        return TORCH_KERNELS
    chosen = _remembered_name()
    if chosen is None:
        chosen = _faster_name()
        _remember(chosen)
    return CompiledKernels() if chosen == CompiledKernels.name else TORCH_KERNELS


def will_compile(device: str) -> bool:
    """Whether `choose_kernels` has yet to compile and time the kernels for a torch device, which takes seconds."""
    return torch.device(device).type == "cpu" and find_spec("numba") is not None and _remembered_name() is None


def _faster_name() -> str:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # as a thread of the team has
    try:
        rivals = (TORCH_KERNELS, CompiledKernels())
        seconds = {kernels.name: [_seconds_of_block(kernels) for _ in range(_ROUNDS)] for kernels in rivals}
    except Exception:  # whatever a compiler meets on a machine that nobody has tried
        return TORCH_KERNELS.name
    finally:
        torch.set_num_threads(threads)
    return min(seconds, key=lambda name: min(seconds[name][1:]))  # the first round compiles


def _seconds_of_block(kernels: Kernels) -> float:
    """Processor time of this thread for a block, from fields to their gradients."""
    lasers, _, rows, samples = _BLOCK
    fields, target = torch.ones(_BLOCK, dtype=torch.complex64), torch.zeros(3, rows, samples)
    weights = torch.ones(lasers, 3)
    started = time.thread_time()
    image = kernels.mix(fields, weights)
    kernels.replace_by_residual(image, target, 1.0)
    kernels.replace_by_adjoint(fields, weights, image)
    return time.thread_time() - started


def _key() -> str:
    """Everything that the times depend on."""
    versions = [version(library) for library in ("numba", "torch")]
    return json.dumps([_FORMAT, platform.node(), platform.machine(), *versions])


def _remembered_name() -> str | None:
    name = _remembered().get(_key())
    return name if name in (TORCH_KERNELS.name, CompiledKernels.name) else None


def _remembered() -> dict[str, Any]:
    try:
        entries = json.loads((cache_dir() / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return entries if isinstance(entries, dict) else {}


def _remember(name: str) -> None:
    path = cache_dir() / _FILE
    with suppress(OSError, UserError):  # a folder that can't be written: the next run measures again
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, json.dumps(_remembered() | {_key(): name}, indent=1, sort_keys=True), is_durable=False)
