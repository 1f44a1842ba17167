"""From the fields of a plane to its image and back: by torch, or compiled by numba, with fewer passes over memory.

`Kernels`           the operations, by torch: the reference, and what other devices than the CPU use
`CompiledKernels`   the same, compiled for this processor; results differ by rounding

The compiled operations hold no lock of Python, so that each thread of a `ThreadTeam` works on its own block. numba
keeps its machine code in the user's cache folder, for each processor and version.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import torch

from holoview.holograms.optimise.beams import SpectralAxis, flat_view
from holoview.holograms.optimise.machine_code import compiled

Tensor = torch.Tensor


class Kernels:
    """Operations on fields (laser, source, row, x), complex, by torch. name: of this implementation."""

    name = "torch"

    def has_passes(self, axes: tuple[SpectralAxis, SpectralAxis]) -> bool:
        """Whether compiled passes do the transforms along these axes, and the operations between them."""
        return False

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

    def sum_imaginary(self, products: Tensor, factors: Tensor, out: Tensor) -> None:
        """Writes Σ factor·Im(product), (y, x). products (laser, source, y, x). factors (laser,)."""
        torch.sum(products.imag * factors[:, None, None, None], dim=(0, 1), out=out)

    def replace_by_residual(self, image: Tensor, target: Tensor, factor: float) -> tuple[Tensor, Tensor]:
        """Replaces an image (channel, row, x) by factor·(image − target).

        Returns two norms: of image − target, and of the same difference with both clipped to 0…1.
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
        self._mix, self._weight, self._residual, self._sum_imaginary = _compiled_loops()

    def has_passes(self, axes: tuple[SpectralAxis, SpectralAxis]) -> bool:
        from holoview.holograms.optimise.compiled_model import fits_passes

        return fits_passes(axes)

    def mix(self, fields: Tensor, weights: Tensor) -> Tensor:
        image = weights.new_empty(weights.shape[1], *fields.shape[2:])
        self._mix(*flat_view(fields), weights.contiguous().numpy(), image.numpy())
        return image

    def replace_by_adjoint(self, fields: Tensor, weights: Tensor, slopes: Tensor) -> None:
        self._weight(*flat_view(fields), (2 * weights).contiguous().numpy(), slopes.contiguous().numpy())

    def sum_imaginary(self, products: Tensor, factors: Tensor, out: Tensor) -> None:
        self._sum_imaginary(*flat_view(products), factors.contiguous().numpy(), out.numpy())

    def replace_by_residual(self, image: Tensor, target: Tensor, factor: float) -> tuple[Tensor, Tensor]:
        norms = image.new_empty(2)
        self._residual(*flat_view(image), *flat_view(target)[::2], image.new_full((1,), factor).numpy(), norms.numpy())
        return norms[0], norms[1]


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


def _imaginary_loops(flat: Any, shape: Any, strides: Any, factors: Any, out: Any) -> None:
    for row in range(shape[2]):
        line = out[row]
        line[:] = 0
        for laser in range(shape[0]):
            factor = factors[laser]
            for source in range(shape[1]):
                first = laser * strides[0] + source * strides[1] + row * strides[2]
                field = flat[first : first + shape[3]]
                for x in range(line.size):
                    line[x] += factor * field[2 * x + 1]


@cache
def _compiled_loops() -> tuple[Callable[..., None], ...]:
    return tuple(map(compiled, (_mix_loops, _weight_loops, _residual_loops, _imaginary_loops)))
