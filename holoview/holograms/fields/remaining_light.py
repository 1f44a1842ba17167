"""What an in-line recording shows beside the objects whose distances are known.

The light of an object at a known distance is confined to its support there, and objects absorb or delay light, but
don't add any. These constraints and the recorded amplitude give the wave of the objects without its twin (Latychevskaia
& Fink, Phys. Rev. Lett. 98, 233901 (2007)). What the recording holds beside this wave's pattern is other objects',
noise, and what the constraints leave open. Rings, twins and gathered light of the known objects go with them, and so
does light of others that crosses their support.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy.ndimage
import torch
from numpy.typing import NDArray
from torch import Tensor

from holoview.holograms.fields.depth_sweep import RIM, Swept, squared_slopes
from holoview.light.numerics.sampling import frequency_indices, taper
from holoview.light.optics.propagate import free_space

_ABOVE_MEDIAN, _OF_GREATEST = 3.0, 0.3
"""|scattered light| of an object's support, times its median over the picture, or its greatest value: this is less
where an object covers much of the picture."""
_BESIDE, _AS_SHARP = (1.5, 3.0, 6.0, 12.0), 0.8
"""Depths of focus before and behind an object at which its parts are less sharp, and the least that they have in it of
their greatest sharpness: the twin disturbs it."""
_PART, _LEAST_PART = 12, 16  # of a tile, the side over the resolved length, and samples at least
_GAINS = (2.0, 2.0, 1.5, 1.5, 1.5)
"""Of each round: the amplitude alone is known, which is half of a weak object's change in the hologram."""
_CORNER = 0.52  # cycles a sample: frequencies in the corners of the spectrum, where fringes are weakest
_STRUCTURE = 0.02  # cycles a sample: what is smoother is the beam's


def without_objects(swept: Swept, distances_m: list[float], finely: bool = False) -> tuple[Swept, float]:
    """A recording without objects at some distances, and the share of its structure's power that is left.

    finely: whether their supports are examined in small tiles, so that less light of others is taken away, and more of
    the objects' own is left; otherwise as whole connected parts.
    """
    beam = swept.incident or 1.0
    recorded = swept.values.real / beam
    amplitude = (1 + recorded).clamp(min=0).sqrt()
    supports = [_support(swept, recorded.to(torch.complex64), z, finely) for z in distances_m]
    waves = [torch.zeros_like(swept.values) for _ in distances_m]
    for gain in _GAINS:
        for i, (distance_m, support) in enumerate(zip(distances_m, supports, strict=True)):
            whole = 1 + torch.stack(waves).sum(dim=0)
            change = gain * whole * (amplitude / whole.abs().clamp(min=1e-3) - 1)
            there = 1 + support * _moved(swept, waves[i] + change, distance_m)
            there = there / there.abs().clamp(min=1.0)
            waves[i] = _moved(swept, there - 1, -distance_m)
    left = recorded - ((1 + torch.stack(waves).sum(dim=0)).abs().square() - 1)
    fading = [torch.from_numpy(taper(n, RIM)).to(left.dtype) for n in left.shape]
    values = (left * beam * fading[0][:, None] * fading[1]).to(torch.complex64)
    share = _share_of(values.real.numpy(), swept.values.real.numpy())
    return replace(swept, values=values, spectrum=torch.fft.fftshift(torch.fft.fft2(values))), share


def _moved(swept: Swept, wave: Tensor, distance_m: float) -> Tensor:
    """A wave (y, x) at a distance, in its own frame, without light from beyond it."""
    padded = [2 * n for n in wave.shape]
    whole = torch.zeros(padded, dtype=wave.dtype)
    whole[: wave.shape[0], : wave.shape[1]] = wave
    ky, kx = (torch.from_numpy(frequency_indices(m)) for m in padded)
    y, x = (swept.wavelength_m / (m * pitch) for m, pitch in zip(padded, swept.pitch_m, strict=True))
    transfer = free_space(distance_m / swept.wavelength_m, (y, x), ky, kx, wave.dtype)
    return torch.fft.ifft2(torch.fft.fft2(whole) * transfer)[: wave.shape[0], : wave.shape[1]]


def _support(swept: Swept, recorded: Tensor, distance_m: float, finely: bool) -> Tensor:
    """Where an object's scattered light stands out of the picture, with its inside and a margin: 0 … 1, soft.

    Of each part that stands out for itself, or its part in each tile, only if its edges are about as sharp at this
    distance as some depths of focus before and behind: what is sharper there is another object's light.
    """
    pitch_m, depth_m = max(swept.pitch_m), swept.depth_of_focus_m(distance_m)
    na = math.sqrt(swept.wavelength_m / depth_m)
    resolved = max(1.0, swept.wavelength_m / (2 * na * pitch_m))
    wave = _moved(swept, recorded, distance_m)
    size = scipy.ndimage.gaussian_filter(wave.abs().numpy(), 0.5 * resolved)
    least = min(_ABOVE_MEDIAN * float(np.median(size)), _OF_GREATEST * float(size.max()))
    inside = scipy.ndimage.binary_dilation(size > least, iterations=math.ceil(1.5 * resolved))
    parts, count = scipy.ndimage.label(inside)
    if finely:
        side = max(_LEAST_PART, round(_PART * resolved))
        tile_y, tile_x = (np.arange(n) // side for n in inside.shape)
        parts = np.where(inside, parts + (count + 1) * (tile_y[:, None] * (tile_x[-1] + 1) + tile_x), 0)
    here = _sharpness(wave, parts)
    elsewhere = [_sharpness(_moved(swept, wave, side * away * depth_m), parts) for away in _BESIDE for side in (-1, 1)]
    own = inside & (here >= _AS_SHARP * np.max(elsewhere, axis=0))[parts]
    filled = scipy.ndimage.binary_fill_holes(own).astype(np.float32)
    return torch.from_numpy(scipy.ndimage.gaussian_filter(filled, 0.5 * resolved))


def _sharpness(wave: Tensor, parts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Σ|∇u|⁴ of a wave (y, x) over each numbered part of the picture."""
    fourth = np.pad(squared_slopes(wave).numpy() ** 2, ((0, 1), (0, 1)))
    return np.asarray(np.bincount(parts.ravel(), fourth.ravel()), np.float64)


def _share_of(rest: NDArray[np.float32], recorded: NDArray[np.float32]) -> float:
    """The power of what is left of a recording's structure over that before (both (y, x)), without even noise."""
    before, after = (np.abs(np.fft.fft2(values)) ** 2 for values in (recorded, rest))
    f = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n) for n in recorded.shape), indexing="ij"))
    noise = float(np.median(before[f > _CORNER])) / math.log(2)  # of exponentially distributed powers the mean
    fine = (f > _STRUCTURE) & (f < 0.5)
    structure, left = (float(power[fine].sum()) - noise * int(fine.sum()) for power in (before, after))
    return float(np.clip(left / max(structure, 1e-30), 0.0, 1.0))
