"""Fields over any distance, before or behind them, seen in a window of any pitch, place and tilt; differentiable.

Two ways. Both leave out the carrier exp(2πiz/λ); z may be negative.

*Angular spectrum*, exact for scalar light:

    u(X; z) = ∫ U(f)·H(f)·T(f)·exp(2πi f·X) d²f,   U(f) = Σ u_n·exp(−2πi f·x_n)·dy·dx

with H of `holoview.light.optics.propagate`. The field between its samples is the one without frequencies beyond
1/(2·dx). A ray of direction sine s = λf moves sideways by d = z·s/√(1 − |s|²). Rays that lead from no sample to no
point of the window need no computing: with E half of the field's side and half of the window's together, T is 1 within
E of the window's centre, and 0 beyond E + 8·√(λ|z|), or where the samples' band ends if that is nearer. Between the two
it falls as an error function, so that the edge of the band sends no more than 1e-6 of the light into the window.
(Matsushima & Shimobaba, Opt. Express 17, 19662 (2009), and Matsushima, Opt. Express 18, 18453 (2010), cut the same band
at E with a hard edge, which diffracts.) The integral is a sum over frequencies so near to each other that its copies of
the light, one period apart, miss the window: a plain FFT towards the frequencies, and another or a chirp-z transform
from them to the samples of the window.

*Fresnel by one transform*, paraxial (Goodman, Introduction to Fourier Optics, 3rd ed., eq. 4-17; Voelz & Roggemann,
Appl. Opt. 48, 6132 (2009)), for the far side of z = N·dx²/λ, where the first order λz/dx is wider than the field:

    u(X; z) = exp(πi·X²/(λz))/(iλz) · Σ u_n·exp(πi·c·x_n²/λ)·exp(−2πi·x_n·X/(λz))·dy·dx,   c = 1/z − 1/R

where a field that has to be lit by a spherical wave of radius R, as a Fourier hologram, has the equivalent distance
1/c = R·z/(R − z), and z = R is a plain Fourier transform, which a lens of focal length R makes.

`tilted_propagate` gives the field in a window that is turned out of the plane across the axis, from its spectrum in
the window's own frame.

A plane wave of frequencies f = (f_x, f_y, f_z), |f| = 1/λ, has the frequencies g = (f·a_x, f·a_y) along the axes a_x,
a_y of the window, so that the field at X·a_x + Y·a_y from its centre c is

    u(X, Y) = ∫ U(f)·H(f)·T(f)·exp(2πi f·c)·(f_z/g_z)·exp(2πi(g_x·X + g_y·Y)) d²g,   f = g_x·a_x + g_y·a_y + g_z·n

with the normal n and g_z = √(1/λ² − g²) (Matsushima, Schimmel & Wyrowski, J. Opt. Soc. Am. A 20, 1755 (2003)). H and
the fading T are those of `holoview.light.optics.free_space`. The frequencies g are equidistant and f isn't: U is
interpolated by Kaiser and Bessel's kernel of 8 samples on a twice finer spectrum (Beatty, Nishimura & Pauly, IEEE
Trans. Med. Imaging 24, 799 (2005)). The carrier exp(2πi·z/λ) of the window's centre is left out, those of its other
points aren't.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from holoview.light.numerics.fourier import PrunedAxis, chirp_z_transform, phasor_of_turns
from holoview.light.numerics.sampling import next_fast_length, positions
from holoview.light.optics.propagate import free_space
from holoview.util.errors import UserError

Pair = tuple[float, float]

_MARGIN = 8.0  # in units of √(λz): the taper's width, of ten standard deviations; 6 leave 2e-6 of the light at an edge
_ALIGNED = 1e-9  # of a sample: how near two grids are one grid
_BLOCK = 1 << 22  # frequencies of which H is computed at a time, so that its float64 phases take little memory


@dataclass(frozen=True)
class SampleWindow:
    """A rectangle of samples in a plane across the axis, or turned out of it.

    shape: rows and columns. pitch_m: distance (y, x) between samples. centre_m: its centre (y, x) beside the axis.
    tilt_rad: angles by which its y axis and its x axis rise towards +z, as of `holoview.light.optics.free_space`.
    """

    shape: tuple[int, int]
    pitch_m: Pair
    centre_m: Pair = (0.0, 0.0)
    tilt_rad: Pair = (0.0, 0.0)

    @property
    def side_m(self) -> Pair:
        """Height and width."""
        return self.shape[0] * self.pitch_m[0], self.shape[1] * self.pitch_m[1]

    def positions_m(self, axis: int) -> NDArray[np.float64]:
        """Positions of the samples along y (0) or x (1)."""
        return self.centre_m[axis] + positions(self.shape[axis], self.pitch_m[axis])


# --- angular spectrum -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SpectrumAxis:
    """One axis of an angular spectrum: the samples of a field, frequencies, and the samples of a window.

    count, pitch_m: of the field. window_count, window_pitch_m, centre_m: of the window. padded: samples of the field's
    pitch in a period, P. lowest, highest: the frequencies that are computed, both included; none if crossed. reach_m,
    margin_m: sideways ways from the window's centre up to which, and then within which light is let fade out.
    """

    count: int
    pitch_m: float
    window_count: int
    window_pitch_m: float
    centre_m: float
    padded: int
    lowest: int
    highest: int
    reach_m: float
    margin_m: float

    @property
    def step(self) -> float:
        """Distance between frequencies, 1/m."""
        return 1.0 / (self.padded * self.pitch_m)

    @property
    def indices(self) -> Tensor:
        """Signed indices of the frequencies."""
        return torch.arange(self.lowest, self.highest + 1)

    def forward(self, values: Tensor, dim: int) -> Tensor:
        """The spectrum of a field along an axis, with positions that count from the field's first sample."""
        offset, _ = self._offsets() or (0, 0)
        return self._pruned(offset, self.count).forward(values, dim)

    def inverse(self, spectrum: Tensor, dim: int) -> Tensor:
        """The field in the window, of a spectrum of `forward`."""
        offsets = self._offsets()
        if offsets is not None:
            return self._pruned(offsets[1], self.window_count).inverse(spectrum, dim)
        k = self.indices.double()
        to_window = self.centre_m + (self.count - 1) / 2 * self.pitch_m  # from the first sample to the window's centre
        positions_m = positions(self.window_count, self.window_pitch_m)
        middle = (self.lowest + self.highest) / 2
        at_centre = phasor_of_turns(k * (self.step * to_window)) / self.padded
        moved = torch.movedim(spectrum, dim, -1) * at_centre.to(spectrum.dtype)
        scale = -self.step * self.window_pitch_m
        summed = chirp_z_transform(moved, scale * -(self.window_count - 1) / 2, scale, self.window_count)
        carrier = phasor_of_turns(torch.from_numpy(positions_m) * (middle * self.step)).to(spectrum.dtype)
        return torch.movedim(summed * carrier, -1, dim)

    def _pruned(self, offset: int, count: int) -> PrunedAxis:
        return PrunedAxis(self.padded, offset, count, self.lowest, self.highest - self.lowest + 1)

    def _offsets(self) -> tuple[int, int] | None:
        """First samples of the field and of the window on one grid of P samples; None where there is no such grid."""
        if abs(self.window_pitch_m / self.pitch_m - 1) * self.window_count > _ALIGNED:
            return None
        shift = self.centre_m / self.pitch_m + (self.count - self.window_count) / 2
        whole = round(shift)
        start, end = min(0, whole), max(self.count, whole + self.window_count)
        if abs(shift - whole) > _ALIGNED or end - start > self.padded:
            return None
        return -start, whole - start


@dataclass(frozen=True)
class AngularSpectrum:
    """The propagation of one wavelength over one distance into a window, by angular spectrum. Made by `make`.

    axes: y and x.
    """

    wavelength_m: float
    distance_m: float
    axes: tuple[SpectrumAxis, SpectrumAxis]

    @staticmethod
    def make(
        shape: tuple[int, int], pitch_m: Pair, wavelength_m: float, distance_m: float, window: SampleWindow
    ) -> AngularSpectrum:
        """The propagation of a field of this shape and pitch (y, x)."""
        steepest = [wavelength_m / (2 * pitch) for pitch in pitch_m]
        farthest = [_sideways(distance_m, s, math.hypot(*steepest)) for s in steepest]
        y, x = (_axis(shape, pitch_m, wavelength_m, distance_m, window, axis, farthest[axis]) for axis in (0, 1))
        return AngularSpectrum(wavelength_m, distance_m, (y, x))

    @property
    def padded(self) -> tuple[int, int]:
        """Samples (y, x) of the padded grid, whose FFT takes most of the time and of the memory."""
        return self.axes[0].padded, self.axes[1].padded

    def propagate(self, values: Tensor) -> Tensor:
        """The field in the window, (…, rows, columns), of a field (…, y, x) complex."""
        y, x = self.axes
        if min(axis.highest - axis.lowest for axis in self.axes) < 0:
            return values.sum(dim=(-2, -1), keepdim=True) * values.new_zeros(y.window_count, x.window_count)
        spectrum = self._transmitted(y.forward(x.forward(values, -1), -2))
        return x.inverse(y.inverse(spectrum, -2), -1)

    def _transmitted(self, spectrum: Tensor) -> Tensor:
        """The spectrum times H and T, in blocks of rows."""
        ky, kx = (axis.indices for axis in self.axes)
        rows = max(1, _BLOCK // len(kx))
        blocks = [
            part * self.transfer_at(k, kx, spectrum.dtype)
            for part, k in zip(torch.split(spectrum, rows, dim=-2), torch.split(ky, rows), strict=True)
        ]
        return blocks[0] if len(blocks) == 1 else torch.cat(blocks, dim=-2)

    def transfer_at(self, ky: Tensor, kx: Tensor, dtype: torch.dtype) -> Tensor:
        """H·T (A, B) at rows ky and columns kx of frequency indices; without evanescent waves."""
        sine_step = self.wavelength_m * self.axes[0].step, self.wavelength_m * self.axes[1].step
        whole = free_space(self.distance_m / self.wavelength_m, sine_step, ky, kx, dtype)
        sines = [k.double() * step for k, step in zip((ky, kx), sine_step, strict=True)]
        squared = [s.square().max() for s in sines]
        if float(sum(squared)) < 1 and not self._fades(float(sum(squared)), [float(s.abs().max()) for s in sines]):
            return whole
        return whole * self.fading(sines[0][:, None], sines[1][None, :]).to(dtype)

    def fading(self, sine_y: Tensor, sine_x: Tensor) -> Tensor:
        """T at direction sines that broadcast with each other, float64; 0 for evanescent waves."""
        a = sine_y.square() + sine_x.square()
        slope = self.distance_m / torch.sqrt((1 - a).clamp_min(torch.finfo(torch.float64).tiny))
        weight = (a < 1).double()
        for axis, sine in zip(self.axes, (sine_y, sine_x), strict=True):
            if axis.margin_m > 0:
                way = (sine * slope - axis.centre_m).abs() - (axis.reach_m + axis.margin_m / 2)
                weight = weight * (0.5 * torch.erfc(way * (10 / (math.sqrt(2) * axis.margin_m))))
        return weight

    def _fades(self, squared: float, steepest: list[float]) -> bool:
        """Whether the steepest of some rays leads beyond what the window needs."""
        return any(
            abs(self.distance_m) * s / math.sqrt(1 - squared) + abs(axis.centre_m) > axis.reach_m
            for axis, s in zip(self.axes, steepest, strict=True)
        )


def _axis(
    shape: tuple[int, int],
    pitch_m: Pair,
    wavelength_m: float,
    distance_m: float,
    window: SampleWindow,
    axis: int,
    farthest_m: float,
) -> SpectrumAxis:
    """The frequencies that lead into a window, and the period that keeps all else out of it.

    farthest_m: how far the steepest ray moves sideways.
    """
    n, pitch, centre_m = shape[axis], pitch_m[axis], window.centre_m[axis]
    reach_m = (n * pitch + window.side_m[axis]) / 2
    zone_m = math.sqrt(wavelength_m * abs(distance_m))
    room_m = _sideways(distance_m, wavelength_m / (2 * pitch), wavelength_m / (2 * pitch)) - reach_m - abs(centre_m)
    margin_m = room_m if zone_m < room_m < _MARGIN * zone_m else _MARGIN * zone_m
    ways = max(centre_m - reach_m - margin_m, -farthest_m), min(centre_m + reach_m + margin_m, farthest_m)
    widest_m = reach_m + max(ways[1] - centre_m, centre_m - ways[0]) + margin_m
    padded = next_fast_length(max(n, math.ceil(widest_m / pitch)))
    lowest, highest = -(padded // 2), (padded - 1) // 2
    if distance_m != 0:
        sines = sorted(way / math.copysign(math.hypot(way, distance_m), distance_m) for way in ways)
        step = wavelength_m / (padded * pitch)
        lowest, highest = max(lowest, math.ceil(sines[0] / step)), min(highest, math.floor(sines[1] / step))
    return SpectrumAxis(
        n, pitch, window.shape[axis], window.pitch_m[axis], centre_m, padded, lowest, highest, reach_m, margin_m
    )


def _sideways(distance_m: float, sine: float, whole_sine: float) -> float:
    """How far a ray moves along an axis; infinite for waves that don't propagate."""
    return abs(distance_m) * sine / math.sqrt(1 - whole_sine**2) if whole_sine < 1 else math.inf


# --- Fresnel by one transform -----------------------------------------------------------------------------------------


def first_order_window(shape: tuple[int, int], pitch_m: Pair, wavelength_m: float, distance_m: float) -> SampleWindow:
    """The window that one FFT fills: as many samples as the field has, λ|z|/(N·pitch) apart."""
    y, x = (wavelength_m * abs(distance_m) / (n * pitch) for n, pitch in zip(shape, pitch_m, strict=True))
    return SampleWindow(shape, (y, x))


def fresnel_propagate(
    values: Tensor,
    pitch_m: Pair,
    wavelength_m: float,
    distance_m: float,
    window: SampleWindow,
    radius_m: float | None = None,
) -> Tensor:
    """The field in a window, (…, rows, columns), of a field (…, y, x) complex, by Fresnel's integral.

    radius_m: R of the spherical wave that lights the field, towards a point that far behind it; None for a plane wave.
    """
    curvature = 1 / distance_m - (0.0 if radius_m is None else 1 / radius_m)
    for axis, dim in ((1, -1), (0, -2)):
        n, pitch = values.shape[dim], pitch_m[axis]
        before = phasor_of_turns(torch.from_numpy(positions(n, pitch)).square() * (curvature / (2 * wavelength_m)))
        x = window.positions_m(axis)
        after = phasor_of_turns(torch.from_numpy(x).square() / (2 * wavelength_m * distance_m))
        scale = pitch / (wavelength_m * distance_m)
        lit = torch.movedim(values, dim, -1) * before.to(values.dtype)
        summed = chirp_z_transform(lit, scale * float(x[0]), scale * window.pitch_m[axis], window.shape[axis])
        values = torch.movedim(summed * (after * pitch).to(values.dtype), -1, dim)
    return values * complex(0.0, -1.0 / (wavelength_m * distance_m))


# --- a window that is turned ------------------------------------------------------------------------------------------


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


def tilted_propagate(
    values: Tensor, pitch_m: Pair, wavelength_m: float, distance_m: float, window: SampleWindow
) -> Tensor:
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


def _to_window(spectrum: Tensor, dim: int, frame: _Frame, axis: int, window: SampleWindow) -> Tensor:
    """Σ_k V_k·exp(2πi·g_k·X) at the samples X of the window."""
    count, pitch_m, step = window.shape[axis], window.pitch_m[axis], frame.step[axis]
    middle = frame.lowest[axis] + (frame.count[axis] - 1) / 2 * step
    scale = -step * pitch_m
    summed = chirp_z_transform(torch.movedim(spectrum, dim, -1), -scale * (count - 1) / 2, scale, count)
    carrier = phasor_of_turns(torch.from_numpy(positions(count, pitch_m)) * middle)
    return torch.movedim(summed * carrier.to(spectrum.dtype), -1, dim)


def _path(
    values: Tensor, pitch_m: Pair, wavelength_m: float, distance_m: float, window: SampleWindow
) -> AngularSpectrum:
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
    box = SampleWindow((1, 1), (sides[0], sides[1]), window.centre_m)
    return AngularSpectrum.make(shape, pitch_m, wavelength_m, distance_m, box)


def _frame(path: AngularSpectrum, window: SampleWindow) -> _Frame:
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
