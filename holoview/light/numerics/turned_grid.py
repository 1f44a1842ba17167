"""The power of a sum of waves at the points of a grid that is turned against that of the sum, differentiable."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from holoview.light.numerics.fourier import chirp_z_transform, phasor_of_turns
from holoview.light.numerics.resample import AffineRows, centred_indices

_TAPS = 14
_BETA = 7.86  # Kaiser's window: ripples of −80 dB, with a transition of 0.39 of the sampling frequency for 14 taps
_BAND = 0.305  # [cycles a sample] up to which interpolation errs by ripples only
_MIDDLE = ((0.0, 1.0),)

Nodes = tuple[tuple[float, float], ...]
"""Places along a side of a square, in sides from its middle, and their weights."""


def turned_power(
    values: Tensor,
    source: AffineRows,
    shape: tuple[int, int],
    turns: tuple[tuple[float, float], tuple[float, float]],
    factor: Callable[[Tensor, Tensor], Tensor],
    nodes: Nodes = _MIDDLE,
) -> Tensor:
    """|Σ v·exp(−2πi(f_y·m + f_x·n))|² over places (m, n) from the middle of `values`, times a factor, at the points of
    a grid whose rows may have any direction up to half a right angle from that of `values`, or means beside them.

    values: (rows, columns), complex. source: rows that take (row, column, 1) of a point, from the middle of the
    result, to its place (y, x). shape: (rows, columns) of the result. turns: for y and for x the frequency at 0 and how
    much it grows with the place, cycles. factor: of the power at y (rows, n) and x (n,). nodes: across a point, along
    rows and along columns.

    On the line on which a row of points lies, the power is computed where columns of a regular grid cross it: sums
    along x first, then along y from another place for each column. Their step is the points' distance or a whole part
    of it, so that one set of weights interpolates the whole row. Errors are at most 1.2e-4 of the sum of the amplitudes
    of the power's waves.
    """
    (a, b, c), (d, e, f) = source
    (rows, columns), ((first_y, per_y), (first_x, per_x)) = shape, turns
    highest_y, highest_x = (abs(per) * (n - 1) for per, n in zip((per_y, per_x), values.shape, strict=True))
    stride = max(math.ceil((abs(e) * highest_x + abs(b) * highest_y) / _BAND), 1)
    turn = stride * d / e  # how many samples a row lies beside the one before
    width = math.ceil(stride * columns + abs(turn) * rows) + _TAPS + 2
    place = centred_indices(width, torch.float64, values.device)
    x, beside = e / stride * place + f, b / stride * place
    lines = chirp_z_transform(values, first_x + per_x * float(x[0]), per_x * e / stride, width).mT
    m = centred_indices(values.shape[0], torch.float64, values.device)
    lines = lines * phasor_of_turns(-per_y * beside[:, None] * m).to(values.dtype)
    step = a - b * d / e
    total = torch.zeros(shape, dtype=values.real.dtype, device=values.device)
    for node, weight in nodes:
        row = centred_indices(rows, torch.float64, values.device) + node
        y = (step * row + c)[:, None] + beside
        light = chirp_z_transform(lines, first_y + per_y * (step * float(row[0]) + c), per_y * step, rows).mT
        power = (light.real.square() + light.imag.square()) * factor(y, x)
        first = turn * row + (width - 1 - stride * (columns - 1)) / 2
        total = total + weight * band_limited_rows(power, first, stride, columns, nodes)
    return total


def band_limited_rows(values: Tensor, first: Tensor, stride: int, count: int, nodes: Nodes = _MIDDLE) -> Tensor:
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


def _kernel(distance: Tensor) -> Tensor:
    """Weight of a sample at a distance, in samples; zero from half of the taps on."""
    inside = (1 - (distance * (2 / _TAPS)).square()).clamp(min=0.0)
    window = torch.special.i0(_BETA * inside.sqrt()) / torch.special.i0(torch.tensor(_BETA, dtype=torch.float64))
    return torch.sinc(distance) * window * (inside > 0)
