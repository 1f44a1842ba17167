"""Gaussian blur, affine warp and interpolation of maps on a grid, differentiable; edges are continued outwards."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn.functional import grid_sample, pad

from holoview.light.numerics.sampling import next_fast_length
from holoview.util.errors import UserError

_MOST_REACH, _LEAST_SIDE = 8, 128

AffineRows = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Two rows (y, x, 1) of an affine map: its results y' and x'."""
TensorRows = tuple[tuple[float, float, Tensor], tuple[float, float, Tensor]]
"""The same with shifts that have derivatives."""

_LEAST_WEIGHT = 1e-8  # of a kernel that is cut off


def centred_indices(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Sample indices 0 … n − 1 minus the grid's centre (n − 1)/2, shape (n,)."""
    return torch.arange(n, dtype=dtype, device=device) - (n - 1) / 2


def upsample_nearest(pixels: Tensor, factor: int) -> Tensor:
    """Repeats each entry of the last two axes `factor` times: pixels as squares of constant value (fill factor 1)."""
    return pixels.repeat_interleave(factor, dim=-2).repeat_interleave(factor, dim=-1)


def gaussian_blur(values: Tensor, sigma: float | Tensor) -> Tensor:
    """A real map (y, x) convolved with a Gaussian of standard deviation `sigma` samples.

    Multiplies the spectrum by exp(−2π²σ²f²), so that the result depends smoothly on σ² down to zero, where the map is
    unchanged up to rounding. A tensor `sigma` may require gradients.
    """

    def gain(fy: Tensor, fx: Tensor) -> Tensor:
        along_y, along_x = (torch.exp(-2 * (math.pi * sigma) ** 2 * f.square()) for f in (fy, fx))
        return along_y * along_x

    # At least 8: the kernel of a narrow Gaussian rings, cut at the edge of the band, and must not jump with the margin.
    return _filtered(values, max(math.ceil(4 * float(torch.as_tensor(sigma).detach())) + 2, 8), gain)


def weighted_blur(values: Tensor, neighbour: float | Tensor) -> Tensor:
    """A real map (y, x) of which each sample becomes a mean, in which one n samples away along an axis weighs w^(n²).

    neighbour: w, the weight of the nearest ones over the sample's own, 0 … 1 without 1. These are the weights of a
    Gaussian of variance −1/(2 ln w), and smooth in w from zero on, where the map is unchanged up to rounding. A tensor
    may require gradients.
    """
    weight = float(torch.as_tensor(neighbour).detach())
    reach = math.ceil(math.sqrt(math.log(_LEAST_WEIGHT) / math.log(weight))) if weight > 0 else 1
    steps = torch.arange(1, reach + 1, dtype=values.dtype, device=values.device)
    weights = torch.as_tensor(neighbour, dtype=values.dtype, device=values.device) ** steps.square()

    def gain(fy: Tensor, fx: Tensor) -> Tensor:
        along_y, along_x = (
            (1 + 2 * (weights * torch.cos(2 * math.pi * f[..., None] * steps)).sum(-1)) / (1 + 2 * weights.sum())
            for f in (fy, fx)
        )
        return along_y * along_x

    return _filtered(values, reach + 2, gain)


def _filtered(values: Tensor, margin: int, gain: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """A real map, continued by `margin` samples, whose spectrum is multiplied by a real even gain.

    gain: of the frequencies (rows, 1) and (1, columns), cycles per sample.
    """
    rows, columns = values.shape
    if margin > _MOST_REACH * max(rows, columns, _LEAST_SIDE):
        expected = f"at most {_MOST_REACH} times its size of {columns} × {rows}"
        raise UserError("blur", f"one that reaches {margin} samples beyond the picture", expected=expected)
    padded = [next_fast_length(n + 2 * margin) for n in (rows, columns)]
    edges = (margin, padded[1] - columns - margin, margin, padded[0] - rows - margin)
    spectrum = torch.fft.rfft2(pad(values[None, None], edges, mode="replicate")[0, 0])
    fy = torch.fft.fftfreq(padded[0], dtype=values.dtype, device=values.device)
    fx = torch.fft.rfftfreq(padded[1], dtype=values.dtype, device=values.device)
    filtered = torch.fft.irfft2(spectrum * gain(fy[:, None], fx[None, :]), s=padded)
    return filtered[margin : margin + rows, margin : margin + columns]


def affine_warp(values: Tensor, source: AffineRows | TensorRows, shape: tuple[int, int] | None = None) -> Tensor:
    """A map whose entry at r = (y, x) is that of `values` at the affine image of r, bilinear between samples.

    values: (y, x) real or complex.
    source: rows that take (y, x, 1), in samples from the centre of the result, to the position in `values`, in samples
    from its centre. For shifts below a sample the result is the mean over a sample of shifted squares.
    shape: (rows, columns) of the result, that of `values` when None.
    """
    rows, columns = shape or values.shape
    real = values.real.dtype
    y = centred_indices(rows, real, values.device)[:, None]
    x = centred_indices(columns, real, values.device)[None, :]
    position_y, position_x = (a * y + b * x + c for a, b, c in source)
    return interpolate_at(values, position_y, position_x)


def interpolate_at(values: Tensor, position_y: Tensor, position_x: Tensor) -> Tensor:
    """A map (y, x), real or complex, at positions (rows, columns) in samples from its centre, bilinear between them."""
    parts = torch.view_as_real(values).movedim(-1, 0) if values.is_complex() else values[None]
    scale_y, scale_x = (2.0 / n for n in values.shape)
    normalised = torch.stack([position_x * scale_x, position_y * scale_y], dim=-1)[None]
    read = grid_sample(parts[None].contiguous(), normalised, padding_mode="border", align_corners=False)[0]
    return torch.view_as_complex(read.movedim(0, -1).contiguous()) if values.is_complex() else read[0]
