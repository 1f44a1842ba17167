"""Gaussian blur, affine warp and interpolation of maps on a grid, differentiable; edges are continued outwards."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import torch
from torch import Tensor
from torch.nn.functional import grid_sample, pad

from holoview.light.numerics.sampling import next_fast_length
from holoview.util.errors import UserError

_MOST_REACH, _LEAST_SIDE = 8, 128

AffineRows = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Two rows (y, x, 1) of an affine map: its results y' and x'."""

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


def affine_warp(values: Tensor, source: AffineRows, shape: tuple[int, int] | None = None) -> Tensor:
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


# --- affine warp of a band-limited map --------------------------------------------------------------------------------

# Two passes along one axis each (Catmull and Smith, SIGGRAPH 1980): first along y to where the rows of the result cross
# the columns of the map, then along x. The first pass shears, which widens the band along x by the rotation's tangent.


_TAPS = 14
_STEPS = 4096  # of the table of weights; linear interpolation between them errs by 1e-7
_BETA = 7.86  # Kaiser's window: ripples of −80 dB, with a transition of 0.39 of the sampling frequency for 14 taps


def band_limited_warp(values: Tensor, source: AffineRows, shape: tuple[int, int]) -> Tensor:
    """A map whose entry at r = (y, x) is that of `values` at the affine image of r.

    values: (y, x) real or complex, without frequencies outside the circle of a quarter of its sampling frequency;
    continued outwards.
    source: rows that take (y, x, 1), in samples from the centre of the result, to the position in `values`, in samples
    from its centre. shape: (rows, columns) of the result.

    Errors are at most 2.5e-4 of the sum of the amplitudes of its waves for rotations up to half a radian: a frequency
    (k_y, k_x) has to leave |k_x| + |k_y|·tan below 0.305 of the sampling frequency. At the corner of a square band of a
    quarter they are 6 % at half a radian, and within the bound up to 0.2 rad.
    """
    (a, b, c), (d, e, f) = source
    rows, columns = (centred_indices(n, torch.float64, values.device) for n in shape)
    x = centred_indices(values.shape[1], torch.float64, values.device)
    column_of_x = (x[None, :] - d * rows[:, None] - f) / e  # of the result, where its row crosses a column of the map
    at_rows = _interpolated(values, a * rows[:, None] + b * column_of_x + c, dim=0)
    return _interpolated(at_rows, d * rows[:, None] + e * columns[None, :] + f, dim=1)


def _interpolated(values: Tensor, position: Tensor, dim: int) -> Tensor:
    """Values at positions along one axis, which count in samples from its centre; the other axis stays."""
    n, weights = values.shape[dim], _weights(values.real.dtype, values.device)
    place = position + (n - 1) / 2
    first = torch.floor(place)
    step = (place - first) * _STEPS
    at = step.to(torch.int32).clamp(max=_STEPS - 1)
    between, tap_0 = (step - at).to(weights.dtype), first.long() - (_TAPS // 2 - 1)
    result = torch.zeros(position.shape, dtype=values.dtype, device=values.device)
    for tap in range(_TAPS):
        weight = torch.lerp(weights[tap][at], weights[tap][at + 1], between)
        result = result + weight * torch.gather(values, dim, (tap_0 + tap).clamp(0, n - 1))
    return result


@lru_cache(maxsize=4)
def _weights(dtype: torch.dtype, device: torch.device) -> Tensor:
    """Weight (tap, step) of each tap for positions 0 … 1 after the middle one, in steps, linear between them."""
    part = torch.linspace(0.0, 1.0, _STEPS + 1, dtype=torch.float64, device=device)
    taps = torch.arange(_TAPS, dtype=torch.float64, device=device)
    return _kernel(part[None, :] + (_TAPS // 2 - 1) - taps[:, None]).to(dtype)


def _kernel(distance: Tensor) -> Tensor:
    """Weight of a sample at a distance, in samples; zero from half of the taps on."""
    inside = (1 - (distance * (2 / _TAPS)).square()).clamp(min=0.0)
    window = torch.special.i0(_BETA * inside.sqrt()) / torch.special.i0(torch.tensor(_BETA, dtype=torch.float64))
    return torch.sinc(distance) * window * (inside > 0)


def band_limited_rows(
    values: Tensor, first: Tensor, stride: int, count: int, nodes: Sequence[tuple[float, float]]
) -> Tensor:
    """Each row of a map at equidistant places that begin elsewhere in each row, or weighted sums of what lies beside.

    values: (rows, n), real, without frequencies above 0.305 of its sampling frequency along rows, beyond which errors
    of 2.5e-4 of the sum of the amplitudes of its waves grow.
    first: (rows,) float64, the first place of each row, in samples from its first sample. stride: whole samples from
    one place to the next. count: places in a row. nodes: distances from a place, in strides, and their weights.
    Every sample within half of the taps of such a point has to be in `values`.

    Returns (rows, count).
    """
    points = [(stride * at, weight) for at, weight in nodes]
    lowest, highest = min(points)[0], max(points)[0]
    start = torch.floor(first + lowest).long() - (_TAPS // 2 - 1)
    taps = torch.arange(_TAPS + math.floor(highest - lowest) + 1, device=values.device)
    distance = (first - start)[:, None] - taps
    weights = sum((weight * _kernel(distance + at) for at, weight in points), torch.zeros_like(distance)).to(
        values.dtype
    )
    reach = stride * (count - 1) + 1
    aligned = torch.gather(values, 1, start[:, None] + torch.arange(reach + len(taps) - 1, device=values.device))
    result = torch.zeros(len(values), count, dtype=values.dtype, device=values.device)
    for tap in range(len(taps)):
        result = result + weights[:, tap, None] * aligned[:, tap : tap + reach : stride]
    return result
