"""Maps on a grid, blurred and warped; what lies outside continues the edge."""

from __future__ import annotations

import math

import torch
from torch.nn.functional import grid_sample, pad

from holoview.numerics.fft_grid import next_fast_length

Tensor = torch.Tensor
Affine = tuple[tuple[float, float, float], tuple[float, float, float]]


def centred_indices(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Sample numbers 0 … n − 1, counted from the grid's centre (n − 1)/2."""
    return torch.arange(n, dtype=dtype, device=device) - (n - 1) / 2


def upsample_nearest(pixels: Tensor, factor: int) -> Tensor:
    """Nearest-neighbour upsampling of the last two axes: a pixel is a square of constant value (fill factor 1)."""
    return pixels.repeat_interleave(factor, dim=-2).repeat_interleave(factor, dim=-1)


def gaussian_blur(values: Tensor, sigma: float | Tensor) -> Tensor:
    """A real map (y, x) convolved with a Gaussian of `sigma` samples, the edge continued outwards.

    By its Fourier transform exp(−2π²σ²f²), so that it depends smoothly on σ² down to zero, where it changes nothing.
    """
    rows, columns = values.shape
    margin = math.ceil(4 * float(torch.as_tensor(sigma).detach())) + 2
    padded = [next_fast_length(n + 2 * margin) for n in (rows, columns)]
    edges = (margin, padded[1] - columns - margin, margin, padded[0] - rows - margin)
    spectrum = torch.fft.rfft2(pad(values[None, None], edges, mode="replicate")[0, 0])
    fy = torch.fft.fftfreq(padded[0], dtype=values.dtype, device=values.device)
    fx = torch.fft.rfftfreq(padded[1], dtype=values.dtype, device=values.device)
    gain_y, gain_x = (torch.exp(-2 * (math.pi * sigma) ** 2 * f.square()) for f in (fy, fx))
    smooth = torch.fft.irfft2(spectrum * (gain_y[:, None] * gain_x[None, :]), s=padded)
    return smooth[margin : margin + rows, margin : margin + columns]


def affine_warp(values: Tensor, source: Affine, mode: str = "bilinear", shape: tuple[int, int] | None = None) -> Tensor:
    """A map (y, x), real or complex, whose entry at r from the centre is that of `values` at the affine map's source.

    source: rows (y, x, 1) that take r = (y, x) to the place, in samples from the centre, where `values` is read;
    linear between samples (or "bicubic"), which for small shifts is the mean over a sample of squares that moved.
    """
    rows, columns = shape or values.shape
    real = values.real.dtype
    y = centred_indices(rows, real, values.device)[:, None]
    x = centred_indices(columns, real, values.device)[None, :]
    at_y, at_x = (a * y + b * x + c for a, b, c in source)
    return interpolate_at(values, at_y, at_x, mode)


def interpolate_at(values: Tensor, at_y: Tensor, at_x: Tensor, mode: str = "bilinear") -> Tensor:
    """A map (y, x), real or complex, read at places (rows, columns) that count in samples from its centre."""
    parts = torch.view_as_real(values).movedim(-1, 0) if values.is_complex() else values[None]
    scale_y, scale_x = (2.0 / n for n in values.shape)
    places = torch.stack([at_x * scale_x, at_y * scale_y], dim=-1)[None]
    read = grid_sample(parts[None].contiguous(), places, mode=mode, padding_mode="border", align_corners=False)[0]
    return torch.view_as_complex(read.movedim(0, -1).contiguous()) if values.is_complex() else read[0]
