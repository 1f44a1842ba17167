"""Affine warp of a map that is sampled at least twice as finely as its band needs: windowed sinc interpolation.

Two passes along one axis each (Catmull and Smith, SIGGRAPH 1980): first along y to where the rows of the result cross
the columns of the map, then along x. The first pass shears, which widens the band along x by the rotation's tangent.
"""

from __future__ import annotations

from functools import lru_cache

import torch

from holoview.numerics.resample import AffineRows, centred_indices

Tensor = torch.Tensor
_TAPS = 14
_STEPS = 4096  # of the table of weights; linear interpolation between them errs by 1e-7
_BETA = 7.86  # Kaiser's window: ripples of −80 dB, with a transition of 0.39 of the sampling frequency for 14 taps


def band_limited_warp(values: Tensor, source: AffineRows, shape: tuple[int, int]) -> Tensor:
    """A map whose entry at r = (y, x) is that of `values` at the affine image of r.

    values: (y, x) real or complex, without frequencies above a quarter of its sampling frequency; continued outwards.
    source: rows that take (y, x, 1), in samples from the centre of the result, to the position in `values`, in samples
    from its centre. shape: (rows, columns) of the result.

    Errors are about 1e-4 of the largest value for rotations up to half a radian.
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
    t = part[None, :] + (_TAPS // 2 - 1) - torch.arange(_TAPS, dtype=torch.float64, device=device)[:, None]
    inside = (1 - (t * (2 / _TAPS)).square()).clamp(min=0.0)
    window = torch.special.i0(_BETA * inside.sqrt()) / torch.special.i0(torch.tensor(_BETA, dtype=torch.float64))
    return (torch.sinc(t) * window).to(dtype)
