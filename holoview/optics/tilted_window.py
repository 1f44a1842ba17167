"""The field in a window that is turned out of the plane across the axis, from its spectrum in the window's own frame.

A plane wave of frequencies f = (f_x, f_y, f_z), |f| = 1/λ, has the frequencies g = (f·a_x, f·a_y) along the axes a_x,
a_y of the window, so that the field at X·a_x + Y·a_y from its centre c is

    u(X, Y) = ∫ U(f)·H(f)·T(f)·exp(2πi f·c)·(f_z/g_z)·exp(2πi(g_x·X + g_y·Y)) d²g,   f = g_x·a_x + g_y·a_y + g_z·n

with the normal n and g_z = √(1/λ² − g²) (Matsushima, Schimmel & Wyrowski, J. Opt. Soc. Am. A 20, 1755 (2003)). H and
the fading T are those of `holoview.optics.free_space`. The frequencies g are equidistant and f isn't: U is interpolated
by Kaiser and Bessel's kernel of 8 samples on a twice finer spectrum (Beatty, Nishimura & Pauly, IEEE Trans. Med.
Imaging 24, 799 (2005)). The carrier exp(2πi·z/λ) of the window's centre is left out, those of its other points aren't.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from holoview.numerics.fourier import chirp_z_transform, phasor_of_turns
from holoview.numerics.sampling import next_fast_length, positions
from holoview.optics.free_space import AngularSpectrum, Pair, Window
from holoview.util.errors import UserError

_TAPS = 8
_SHAPE = math.pi * math.sqrt((_TAPS / 2) ** 2 * 1.5**2 - 0.8)  # β, Beatty et al., eq. 5, for twice the samples
_MOST_FREQUENCIES = 1 << 26
_LEAST_COSINE = 0.1  # of rays and the window's normal: beyond, light grazes the window
_CORNERS = tuple(product((-1.0, 1.0), repeat=2))


def axes_of(tilt_rad: Pair) -> NDArray[np.float64]:
    """The unit vectors a_x, a_y and n of a window, as rows (x, y, z).

    tilt_rad: (α, β), angles by which the window's y axis and its x axis rise out of the plane towards +z. It is turned
    by β first, then about its new x axis by α.
    """
    (sa, sb), (ca, cb) = (tuple(f(angle) for angle in tilt_rad) for f in (math.sin, math.cos))
    return np.array([[cb, 0.0, sb], [-sa * sb, ca, sa * cb], [-sb * ca, -sa, ca * cb]])


@dataclass(frozen=True, eq=False)
class _Frame:
    """The frequencies in the frame of a window.

    axes: as of `axes_of`. lowest, step, count: first frequency (y, x), distance between frequencies, their number.
    """

    axes: NDArray[np.float64]
    lowest: Pair
    step: Pair
    count: tuple[int, int]

    def frequencies(self, axis: int) -> Tensor:
        """Along y (0) or x (1), 1/m."""
        return self.lowest[axis] + self.step[axis] * torch.arange(self.count[axis], dtype=torch.float64)


def tilted_propagate(values: Tensor, pitch_m: Pair, wavelength_m: float, distance_m: float, window: Window) -> Tensor:
    """The field in a tilted window, (…, rows, columns), of a field (…, y, x) complex; differentiable.

    distance_m: z of the window's centre.

    Raises UserError for a window that reaches the plane of the field, or that light grazes, and where it needs too many
    frequencies.
    """
    path = _path(values, pitch_m, wavelength_m, distance_m, window)
    frame = _frame(path, window)
    gy, gx = frame.frequencies(0)[:, None], frame.frequencies(1)[None, :]
    gz = torch.sqrt((wavelength_m**-2 - gy.square() - gx.square()).clamp_min(0))
    fx, fy, fz = (gx * a + gy * b + gz * c for a, b, c in frame.axes.T)
    passes = (fz > 0) & (gz > 0) & (fx.abs() <= 0.5 / pitch_m[1]) & (fy.abs() <= 0.5 / pitch_m[0])
    squared = (wavelength_m * fx).square() + (wavelength_m * fy).square()
    turns = -distance_m / wavelength_m * squared / (1 + torch.sqrt((1 - squared).clamp_min(0)))
    turns = turns + fx * window.centre_m[1] + fy * window.centre_m[0]
    weight = path.fading(wavelength_m * fy, wavelength_m * fx) * passes * (fz / gz.clamp_min(1e-30))
    area = frame.step[0] * frame.step[1] * pitch_m[0] * pitch_m[1]
    factor = (phasor_of_turns(turns) * (weight * area)).to(values.dtype)
    spectrum = interpolated_spectrum(values, fy * pitch_m[0], fx * pitch_m[1]) * factor
    for axis, dim in ((1, -1), (0, -2)):
        spectrum = _to_window(spectrum, dim, frame, axis, window)
    return spectrum


def interpolated_spectrum(values: Tensor, fy: Tensor, fx: Tensor) -> Tensor:
    """Σ u_n·exp(−2πi f·n), n from the centre, (…, A, B), of (…, y, x) complex at frequencies (A, B) in cycles a sample.

    The error is about 1e-7 of the largest value.
    """
    padded = [next_fast_length(2 * n) for n in values.shape[-2:]]
    for dim, (n, m) in zip((-2, -1), zip(values.shape[-2:], padded, strict=True), strict=True):
        compensation = torch.from_numpy(1 / _kernel_transform(positions(n, 1.0) / m)).to(values.dtype)
        values = torch.movedim(torch.movedim(values, dim, -1) * compensation, -1, dim)
    fine = torch.fft.fft2(values, s=padded)
    places = [f * m for f, m in zip((fy, fx), padded, strict=True)]
    first = [torch.floor(place).long() - (_TAPS // 2 - 1) for place in places]
    # the FFT counts from the first sample: each of its values is turned back to the centre of the samples
    turned = [
        phasor_of_turns(torch.arange(m, dtype=torch.float64) * (((n - 1) / 2) / m % 1.0)).to(values.dtype)
        for n, m in zip(values.shape[-2:], padded, strict=True)
    ]
    fine = fine * turned[0][:, None] * turned[1]
    total = torch.zeros((*fine.shape[:-2], *fy.shape), dtype=values.dtype)
    # beyond the end of the periodic spectrum, positions of half a sample change its sign
    weights = [
        [_kernel(place - start - tap) * _sign(start + tap, n, m) for tap in range(_TAPS)]
        for place, start, n, m in zip(places, first, values.shape[-2:], padded, strict=True)
    ]
    for ty, tx in product(range(_TAPS), repeat=2):
        found = fine[..., (first[0] + ty) % padded[0], (first[1] + tx) % padded[1]]
        total = total + found * (weights[0][ty] * weights[1][tx]).to(values.dtype)
    return total


def _sign(k: Tensor, n: int, period: int) -> Tensor:
    """exp(2πi·(n − 1)/2) for each period that k lies beyond the first: −1 for even n and an odd number of periods."""
    return 1.0 - 2.0 * (torch.div(k, period, rounding_mode="floor") % 2) if n % 2 == 0 else torch.ones_like(k).double()


def _kernel(t: Tensor) -> Tensor:
    inside = (1 - (t * (2 / _TAPS)).square()).clamp_min(0)
    return torch.special.i0(_SHAPE * inside.sqrt()) * (t.abs() < _TAPS / 2)


def _kernel_transform(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """∫ kernel(t)·exp(2πi·t·x) dt."""
    root = np.sqrt(_SHAPE**2 - (math.pi * _TAPS * x) ** 2)
    return np.asarray(_TAPS * np.sinh(root) / root)


def _to_window(spectrum: Tensor, dim: int, frame: _Frame, axis: int, window: Window) -> Tensor:
    """Σ_k V_k·exp(2πi·g_k·X) at the samples X of the window."""
    count, pitch_m, step = window.shape[axis], window.pitch_m[axis], frame.step[axis]
    middle = frame.lowest[axis] + (frame.count[axis] - 1) / 2 * step
    scale = -step * pitch_m
    summed = chirp_z_transform(torch.movedim(spectrum, dim, -1), -scale * (count - 1) / 2, scale, count)
    carrier = phasor_of_turns(torch.from_numpy(positions(count, pitch_m)) * middle)
    return torch.movedim(summed * carrier.to(spectrum.dtype), -1, dim)


def _path(values: Tensor, pitch_m: Pair, wavelength_m: float, distance_m: float, window: Window) -> AngularSpectrum:
    """The propagation to the plane across the axis at the window's centre, into all that its light passes there."""
    axes = axes_of(window.tilt_rad)
    half = np.array(window.side_m[::-1]) / 2  # X, Y
    across, depth = np.abs(axes[:2]).T[:2] @ half, float(np.abs(axes[:2, 2]) @ half)
    if depth >= 0.9 * abs(distance_m):
        raise UserError(
            "window",
            f"one that reaches {depth:g} m before and behind its centre at {distance_m:g} m",
            expected="a tilted window that stays clear of the plane of the field",
            remedy="a smaller tilt or window",
        )
    farther = abs(distance_m) / (abs(distance_m) - depth)
    shape = (values.shape[-2], values.shape[-1])
    sides = []
    for axis in (0, 1):
        field, beside = shape[axis] * pitch_m[axis] / 2, abs(window.centre_m[axis])
        sides.append(2 * (farther * (across[1 - axis] + field + beside) - field - beside))
    box = Window((1, 1), (sides[0], sides[1]), window.centre_m)
    return AngularSpectrum.make(shape, pitch_m, wavelength_m, distance_m, box)


def _frame(path: AngularSpectrum, window: Window) -> _Frame:
    """The frequencies of the window's frame that hold the light of a path, so near that its copies miss the window."""
    axes, λ, z = axes_of(window.tilt_rad), path.wavelength_m, path.distance_m
    y, x = path.axes
    ends = [np.linspace(a.lowest * a.step, max(a.highest, a.lowest) * a.step, 9) for a in (x, y)]
    fx, fy = np.meshgrid(*ends)
    fz = np.sqrt(np.maximum(λ**-2 - fx**2 - fy**2, 0))
    g = np.tensordot(axes[:2], np.stack([fx, fy, fz]), axes=1)  # of x, of y
    light = [a.reach_m + a.margin_m + abs(a.centre_m) + a.count * a.pitch_m / 2 for a in (x, y)]
    slopes = [min(abs(a.centre_m) + a.reach_m + a.margin_m, 1e3 * abs(z)) / abs(z) for a in (x, y)]
    widest = np.zeros(2)
    for (px, py), (sx, sy) in product(_CORNERS, repeat=2):
        start, ray = np.array([px * light[0], py * light[1], 0.0]), np.array([sx * slopes[0], sy * slopes[1], 1.0])
        towards = float(axes[2] @ ray) / float(np.linalg.norm(ray))
        if towards < _LEAST_COSINE:
            raise UserError("window", "a tilt at which light grazes it", expected="a smaller tilt or a smaller window")
        widest = np.maximum(widest, np.abs(axes[:2] @ (start - ray * float(axes[2] @ start) / float(axes[2] @ ray))))
    step = [1 / (side / 2 + wide) for side, wide in zip(window.side_m[::-1], widest, strict=True)]
    lowest = [float(part.min()) for part in g]
    count = [math.ceil((float(part.max()) - low) / s) + 1 for part, low, s in zip(g, lowest, step, strict=True)]
    if count[0] * count[1] > _MOST_FREQUENCIES:
        raise UserError(
            "window", f"a tilted one that needs {count[0]} × {count[1]} frequencies", expected="fewer: a smaller window"
        )
    return _Frame(axes, (lowest[1], lowest[0]), (step[1], step[0]), (count[1], count[0]))
