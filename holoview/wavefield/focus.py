"""The distance at which a field is sharpest, before its plane and behind it, by two published measures.

*Edge sparsity*: √(σ/μ) of |∇u| over the picture, Tamura's coefficient of the gradient of the complex field, which a
few strong edges make large (Zhang, Wang, Wu, Tamamitsu & Ozcan, Opt. Lett. 42, 3824 (2017), "ToG").

*Normalised variance* of the intensity, σ²/μ² (Groen, Young & Ligthart, Cytometry 6, 81 (1985); for holograms
Langehanenberg, Kemper, Dirksen & von Bally, Appl. Opt. 47, D176 (2008)). Of an object that changes the phase alone it
is smallest, not largest, in focus.

The range is searched with the middle of the field's band first, whose depth of focus is long, and then around the best
distances with more of it. Steps are one depth of focus, λ/NA², of the band that is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from holoview.numerics.sampling import frequency_indices
from holoview.optics.free_space import first_order_window, fresnel_propagate
from holoview.optics.propagate import free_space
from holoview.util.errors import UserError
from holoview.wavefield.propagation import choose_method, farthest_by_spectrum
from holoview.wavefield.wavefield import Wavefield

Measure = Literal["edge sparsity", "normalised variance"]
MEASURES: tuple[Measure, ...] = ("edge sparsity", "normalised variance")

_SEEN_BEST_M = 550e-9
_FIRST_SAMPLES = (256, 128, 64)  # of a side; the first for which one side's range takes few distances
_MOST_STEPS = 150
_MOST_SAMPLES = 1024
_KEPT = 2  # distances of each side and measure that are searched with more samples
_BETWEEN = 4  # distances on each side of one that is kept
_CLEARLY_SHARPER: dict[Measure, float] = {"edge sparsity": 1.1, "normalised variance": 2.0}
"""[1] A picture is clearly sharper than another if each of its measures is so many times as large. Evidence: of 13
simulated holograms (off-axis, phase-shifting, phase patterns, complex fields) in focus on one side, the measures are
1.12 to 2.3 and 2.2 to 55 times those of the other side; of holograms that are the same on both, 0.99 to 1.01."""
_MOST_COMPARED = 1 << 24  # samples of a field both sides of which are compared unasked


@dataclass(frozen=True, eq=False)
class FocusCurve:
    """Both measures at some distances, of a part of the field's band.

    samples: of the longer side that were used. distances_m: (n,), rising. measures: (n,) of each, as of `MEASURES`.
    """

    samples: int
    distances_m: NDArray[np.float64]
    measures: dict[Measure, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class FoundFocus:
    """Where a field is in focus.

    distances_m: by each measure. other_side_m: the best distance on the other side of the plane, by each measure; None
    where it wasn't searched. other_side_share: its measure in that of the best. curves: the coarse one over the whole
    range, and finer ones.
    """

    distances_m: dict[Measure, float]
    other_side_m: dict[Measure, float | None]
    other_side_share: dict[Measure, float]
    curves: tuple[FocusCurve, ...]

    @property
    def distance_m(self) -> float:
        """By the first measure."""
        return self.distances_m[MEASURES[0]]


def edge_sparsity(field: Tensor) -> float:
    """√(σ/μ) of |∇u| of a complex field (y, x); 0 for a field without structure."""
    down, right = field[1:, :-1] - field[:-1, :-1], field[:-1, 1:] - field[:-1, :-1]
    slope = torch.sqrt(down.abs().square() + right.abs().square())
    mean = float(slope.mean())
    return math.sqrt(float(slope.std()) / mean) if mean > 0 else 0.0


def normalised_variance(field: Tensor) -> float:
    """σ²/μ² of the intensity |u|² of a complex field (y, x); 0 for darkness."""
    intensity = field.abs().square()
    mean = float(intensity.mean())
    return float(intensity.var()) / mean**2 if mean > 0 else 0.0


def default_range_m(field: Wavefield) -> tuple[float, float]:
    """Distances between which an image is looked for: around the one that is expected, else as far as samples allow.

    Half to one and a half times the expected distance, or the reference's radius; without any, up to twice 2·N·dx²/λ,
    beyond which the own window shows little, from a hundredth of that.
    """
    expected = abs(field.distance_m) or abs(field.reference_radius_m or 0.0)
    if expected > 0:
        return 0.5 * expected, 1.5 * expected
    farthest = 2 * farthest_by_spectrum(field)
    return farthest / 100, farthest


def is_sharper_on_other_side(field: Wavefield) -> bool:
    """Whether the image is clearly sharper at minus the field's distance than at the distance, by both measures.

    Then the phase, or the distance, was stated with the other sign. False without a distance, where one transform would
    alias, and for fields of more than 2²⁴ samples.
    """
    distance_m = field.distance_m
    if distance_m == 0 or field.shape[0] * field.shape[1] > _MOST_COMPARED:
        return False
    near, far = sorted((abs(distance_m), 1.001 * abs(distance_m)))
    try:
        view = _View.of(field, near, far)
    except UserError:
        return False
    here, there = (view.at(sign * distance_m, min(view.side, _MOST_SAMPLES)) for sign in (1, -1))
    return all(
        measure(there) > _CLEARLY_SHARPER[name] * measure(here)
        for name, measure in zip(MEASURES, (edge_sparsity, normalised_variance), strict=True)
    )


def find_focus(
    field: Wavefield,
    low_m: float,
    high_m: float,
    progress: Callable[[int, int, str], None] | None = None,
) -> FoundFocus:
    """The sharpest distance of the first frame, at the wavelength nearest to 550 nm.

    low_m, high_m: the range. If both are above 0, the other side of the plane is searched as well: programs differ in
    the sign of the phase and of z.
    progress: called with the number of the distance, of how many about, and words.

    The spectrum is cut around its centre of gravity and propagated as a periodic field, so that light which leaves the
    field on one side comes back on the other and still counts. A field with a spherical reference, or a range beyond
    2·N·dx²/λ, is propagated by one transform of the middle of the field.

    Raises UserError for an empty range, and where one transform would alias.
    """
    if not (math.isfinite(low_m) and math.isfinite(high_m) and low_m < high_m):
        raise UserError("range", f"{low_m:g} to {high_m:g} m", expected="two finite distances, the smaller first")
    sides = [(low_m, high_m)] + ([(-high_m, -low_m)] if low_m > 0 else [])
    view = _View.of(field, low_m, high_m)
    samples = next((n for n in _FIRST_SAMPLES if view.count(sides, n) <= _MOST_STEPS * len(sides)), _FIRST_SAMPLES[-1])
    samples = min(samples, view.side)
    nodes = np.unique(np.concatenate([view.nodes(side, samples) for side in sides]))
    levels = math.ceil(math.log2(max(1.0, min(view.side, _MOST_SAMPLES) / samples)))
    total = len(nodes) + levels * len(sides) * len(MEASURES) * _KEPT * (2 * _BETWEEN + 1)
    done = 0

    def measured(distances_m: NDArray[np.float64], samples: int) -> FocusCurve:
        nonlocal done
        values = []
        for distance_m in distances_m:
            seen = view.at(float(distance_m), samples)
            values.append((edge_sparsity(seen), normalised_variance(seen)))
            done += 1
            if progress is not None:
                progress(min(done, total), total, f"{distance_m * 1e3:.4g} mm")
        table = np.array(values)
        return FocusCurve(samples, distances_m, {name: table[:, i] for i, name in enumerate(MEASURES)})

    curves = [measured(nodes, samples)]
    while samples < min(view.side, _MOST_SAMPLES):
        kept, finer = _best_of(curves[-1], sides), min(2 * samples, view.side, _MOST_SAMPLES)
        around = [
            np.linspace(-1, 1, 2 * _BETWEEN + 1) * view.step(distance_m, samples) + distance_m for distance_m in kept
        ]
        samples = finer
        curves.append(
            measured(np.unique(np.clip(np.concatenate(around), -max(map(abs, (low_m, high_m))), high_m)), samples)
        )
    return _found(curves, sides)


@dataclass(frozen=True, eq=False)
class _View:
    """A field of which a part of the band, or of the samples, is seen at a distance.

    values: (y, x) complex64, or its spectrum, for which `transforms` is False. centre: indices of the spectrum's centre
    of gravity.
    """

    values: Tensor
    pitch_m: tuple[float, float]
    wavelength_m: float
    transforms: bool
    radius_m: float | None
    centre: tuple[int, int]

    @staticmethod
    def of(field: Wavefield, low_m: float, high_m: float) -> _View:
        """The view of a field's first frame. Raises UserError where one transform would alias within the range."""
        index = int(np.argmin(np.abs(field.wavelengths_m - _SEEN_BEST_M)))
        values = torch.from_numpy(field.values[0, index].copy())
        radius_m = field.reference_radius_m
        transforms = radius_m is not None or low_m > farthest_by_spectrum(field)
        if transforms:
            for distance_m in (low_m, high_m):
                choose_method(field, distance_m, "fresnel" if radius_m is None else "fourier")
        centre = (0, 0)
        if not transforms:
            values = torch.fft.fft2(values)
            power = values.abs().square()
            centre = _centre_of(power.sum(dim=1)), _centre_of(power.sum(dim=0))
        return _View(values, field.pitch_m, float(field.wavelengths_m[index]), transforms, radius_m, centre)

    @property
    def side(self) -> int:
        """Samples of the longer side."""
        return max(self.values.shape)

    def part(self, samples: int) -> tuple[int, int]:
        """Rows and columns that are used if the longer side has so many samples."""
        rows, columns = (max(8, min(n, round(n * samples / self.side))) for n in self.values.shape)
        return rows, columns

    def step(self, distance_m: float, samples: int) -> float:
        """One depth of focus, λ/NA²."""
        shape = self.values.shape
        along = max(range(2), key=lambda axis: shape[axis] * self.pitch_m[axis])
        side_m, used = shape[along] * self.pitch_m[along], self.part(samples)[along]
        if self.transforms:
            return self.wavelength_m * (2 * distance_m / (used * self.pitch_m[along])) ** 2
        na = min(self.wavelength_m * used / (2 * side_m), 1.0)
        if distance_m != 0:
            na = min(na, side_m / (2 * abs(distance_m)))
        return self.wavelength_m / na**2

    def nodes(self, side: tuple[float, float], samples: int) -> NDArray[np.float64]:
        """Distances one depth of focus apart."""
        found: list[float] = []
        distance_m = side[0]
        while distance_m < side[1] and len(found) < 100 * _MOST_STEPS:
            found.append(distance_m)
            distance_m += self.step(distance_m, samples)
        return np.array([*found, side[1]])

    def count(self, sides: list[tuple[float, float]], samples: int) -> int:
        """How many distances the coarse search takes."""
        return sum(len(self.nodes(side, min(samples, self.side))) for side in sides)

    def at(self, distance_m: float, samples: int) -> Tensor:
        """The field at a distance, of a part of its band or of its middle."""
        rows, columns = self.part(samples)
        if self.transforms:
            top, left = ((n - k) // 2 for n, k in zip(self.values.shape, (rows, columns), strict=True))
            middle = self.values[top : top + rows, left : left + columns]
            window = first_order_window((rows, columns), self.pitch_m, self.wavelength_m, distance_m)
            return fresnel_propagate(middle, self.pitch_m, self.wavelength_m, distance_m, window, self.radius_m)
        ky, kx = (
            torch.from_numpy(_signed(frequency_indices(k) + c, n))
            for k, c, n in zip((rows, columns), self.centre, self.values.shape, strict=True)
        )
        cut = self.values[ky % self.values.shape[0]][:, kx % self.values.shape[1]]
        sine_y, sine_x = (
            self.wavelength_m / (n * pitch) for n, pitch in zip(self.values.shape, self.pitch_m, strict=True)
        )
        return torch.fft.ifft2(cut * free_space(distance_m / self.wavelength_m, (sine_y, sine_x), ky, kx, cut.dtype))


def _inside(distances_m: NDArray[np.float64], sides: list[tuple[float, float]]) -> NDArray[np.float64]:
    """The distances that lie on one of the sides, rising and each once."""
    return np.unique(np.concatenate([distances_m[(distances_m >= a) & (distances_m <= b)] for a, b in sides]))


def _signed(indices: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """Frequency indices, periodic in n, from −n/2 to (n − 1)/2."""
    return (indices + n // 2) % n - n // 2


def _centre_of(power: Tensor) -> int:
    """The index of the centre of gravity of a periodic spectrum, by the phase of its first harmonic."""
    angles = torch.arange(len(power), dtype=torch.float64) * (2 * math.pi / len(power))
    weights = power.double()
    angle = math.atan2(float((weights * angles.sin()).sum()), float((weights * angles.cos()).sum()))
    return round(angle / (2 * math.pi) * len(power))


def _best_of(curve: FocusCurve, sides: list[tuple[float, float]]) -> list[float]:
    """The largest local maxima of each measure on each side."""
    kept: list[float] = []
    for low, high in sides:
        inside = (curve.distances_m >= low) & (curve.distances_m <= high)
        distances = curve.distances_m[inside]
        for values in curve.measures.values():
            heights = np.pad(values[inside], 1, constant_values=-np.inf)
            peaks = np.flatnonzero((heights[1:-1] >= heights[:-2]) & (heights[1:-1] >= heights[2:]))
            best = peaks[np.argsort(-heights[1:-1][peaks], kind="stable")][:_KEPT]
            kept += [float(distances[i]) for i in best]
    return kept


def _found(curves: list[FocusCurve], sides: list[tuple[float, float]]) -> FoundFocus:
    """The best distances of the finest curve."""
    best: dict[Measure, float] = {}
    other: dict[Measure, float | None] = {}
    share: dict[Measure, float] = {}
    finest = curves[-1]
    for name in MEASURES:
        found = []
        for low, high in sides:
            inside = np.flatnonzero((finest.distances_m >= low) & (finest.distances_m <= high))
            if len(inside):
                found.append(_peak(finest.distances_m[inside], finest.measures[name][inside]))
        found.sort(key=lambda pair: -pair[1])
        best[name] = found[0][0]
        other[name] = found[1][0] if len(found) > 1 else None
        share[name] = found[1][1] / found[0][1] if len(found) > 1 and found[0][1] > 0 else 0.0
    return FoundFocus(best, other, share, tuple(curves))


def _peak(distances_m: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float]:
    """The place of the largest value and the value: the centre of gravity of the upper half of its peak.

    Speckle makes single values random, the more the shallower the peak.
    """
    i, height = int(np.argmax(values)), float(values.max())
    above = values - (height + float(values.min())) / 2
    low = high = i
    reach_m = 1.01 * _BETWEEN * float(np.diff(distances_m).min()) if len(values) > 1 else 0.0
    while low > 0 and above[low - 1] > 0 and distances_m[i] - distances_m[low - 1] <= reach_m:
        low -= 1
    while high < len(values) - 1 and above[high + 1] > 0 and distances_m[high + 1] - distances_m[i] <= reach_m:
        high += 1
    inside = slice(low, high + 1)
    widths = np.gradient(distances_m[inside]) if high > low else np.ones(1)
    weights = np.maximum(above[inside], 0) * widths
    return float(np.average(distances_m[inside], weights=weights) if weights.sum() > 0 else distances_m[i]), height
