"""The distance at which a field is sharpest, before its plane and behind it, by two published measures.

*Edge sparsity*: √(σ/μ) of |∇u| over the picture, Tamura's coefficient of the gradient of the complex field, which a
few strong edges make large (Zhang, Wang, Wu, Tamamitsu & Ozcan, Opt. Lett. 42, 3824 (2017), "ToG").

*Normalised variance* of the intensity, σ²/μ² (Groen, Young & Ligthart, Cytometry 6, 81 (1985); for holograms
Langehanenberg, Kemper, Dirksen & von Bally, Appl. Opt. 47, D176 (2008)).

Both are taken over the window that holds 98 % of the light at each distance, and of the light divided by its local
r.m.s. amplitude, so that neither light that leaves the field's frame nor darkness beside it changes them. Where the
unscattered wave dominates, it is taken out first, as in a dark field: a transparent object hardly changes the intensity
in focus, while the light that it scatters is most compact there.

Causes other than focus change the measures slowly: speckle, the field's finite frame, the far field. These causes act
alike on both sides of the plane and cancel in ln m(z) − ln m(−z). That difference alone would also be large where the
other side is merely dull, so that ln m(z) itself is added. The most prominent maximum of 2·ln m(z) − ln m(−z) is the
distance of focus: the maximum that rises highest above the valleys beside it.

An in-line recording is real, so that its image has a twin on the other side: its objects are found by
`holoview.holograms.fields.focused_objects`.

The range is first searched with the middle of the field's band, whose depth of focus λ/NA² is long, in steps of half
this depth; then finer bands move the best distances.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from holoview.holograms.fields.depth_sweep import MOST_SAMPLES, Level, Swept, smoothed
from holoview.holograms.fields.focused_objects import (
    APART_DEPTHS,
    MOST_UNEXPLAINED,
    FocusedObject,
    Unclear,
    search_objects,
)
from holoview.holograms.fields.propagation import choose_method, farthest_by_spectrum
from holoview.holograms.fields.wavefield import Wavefield
from holoview.light.numerics.sampling import frequency_indices, next_fast_length, taper
from holoview.light.optics.free_space import first_order_window, fresnel_propagate
from holoview.light.optics.propagate import free_space
from holoview.util import units
from holoview.util.errors import UserError

Measure = Literal["edge sparsity", "normalised variance"]
MEASURES: tuple[Measure, ...] = ("edge sparsity", "normalised variance")

_SEEN_BEST_M = 550e-9
_FIRST_SAMPLES = (128, 64, 32)  # of the band along its longer side; the first for which a side takes few distances
_MOST_STEPS = 200
_MOST_SAMPLES = 512  # of the band in the end
_BETWEEN = 4  # distances on each side of one that is kept
_LIGHT = 0.98  # of the power, in the band and in the window of each distance
_MOST_PADDED = 8  # times the field's side, for light that leaves it
_UNSCATTERED = 0.25  # of the power near one frequency: the wave that no object scattered dominates
_PEAK_BINS = 2  # around that frequency
_LOCAL = 1 / 6  # of the window: the width σ over which the light's r.m.s. amplitude is taken
_BLOCKS = 64  # of a side, over which the amplitude is averaged first
_DARK = 0.05  # of the mean power, which keeps darkness dark
_FADED = 0.1  # of a side: hard edges of the frame would be the sharpest ones at distance 0
_MUCH_SPARSER = 1.25
_CLEARLY_SHARPER: dict[Measure, float] = {"edge sparsity": 1.06, "normalised variance": 1.2}
"""[1] A picture is clearly sharper than another if each of its measures is so many times as large, or the sparsity of
its edges alone `_MUCH_SPARSER` times. Evidence: of six published recordings and fields and five simulated ones, in
focus on one side, the measures are 1.06 to 3.3 and 1.22 to 840 times those of the other side; of holograms that are
equal on both sides, 0.998 to 1.005; of a diffuse photograph, which has no edges, 0.98 and 0.85. Of six simulated
amplitudes with smooth phases, which act as lenses, the measures are 1.37 to 1.73 and 0.92 to 4.3 times; at 0.3 to 4
times their distance, where neither side is in focus, the wrong side has at most 1.06 times the right one's sparsity."""
_AGREE = 0.05
_OTHER_SIDE = {True: 0.95, False: 0.9}
"""[2] The most of a measure that the other side may have, if the measures agree and if they don't. Of 24 drawn off-axis
recordings and fields it is 0.53 to 0.87 where the image was found, 1.00 where it was not; of 24 fields of band-limited
noise the sparsity's is 0.94 to 1.08. The variance alone is below 0.9 in noise, too, and isn't enough."""
_LEAST_DEPTHS = 0.5  # of focus between the plane and a clear focus
_REAL = 1e-5  # of the largest value: imaginary parts of float32
_EVEN = 1e-5  # the same of amplitudes
_SAMPLES_COMPARED = 256
_TINY = 1e-30  # where a picture is dark
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
    """The distances at which a field is in focus.

    range_m: that was searched; on both sides if both are above 0. objects: what is clearly in focus, the clearest
    first; none where no focus is clear. unclear: what else is seen in an in-line recording. unexplained: the share, 0 …
    1, of the power of its structure that is in focus at none of the objects' distances; None where none is clear.
    whole: of the curves, how many cover the range together, the first.
    nearest_sampled_m: of an in-line recording the distance from which on all fringes within the frame are sampled;
    nearest_searchable_m: that from which on enough of them are, two depths of focus.
    distances_m: by each measure. other_side_m: the best distance on the other side of the plane, by each measure; None
    where it wasn't searched. other_side_share: the measure there, over that at the best distance. curves: coarse
    curves that cover the whole range, and finer curves.
    """

    distances_m: dict[Measure, float]
    other_side_m: dict[Measure, float | None]
    other_side_share: dict[Measure, float]
    curves: tuple[FocusCurve, ...]
    range_m: tuple[float, float]
    objects: tuple[FocusedObject, ...] = ()
    whole: int = 1
    nearest_sampled_m: float = 0.0
    nearest_searchable_m: float = 0.0
    unclear: tuple[Unclear, ...] = ()
    unexplained: float | None = None

    @property
    def is_incomplete(self) -> bool:
        """Whether so much of an in-line recording isn't explained that objects must be missing, or are wrong."""
        return self.unexplained is not None and self.unexplained > MOST_UNEXPLAINED

    @property
    def least_apart_m(self) -> float:
        """Along z; two objects that are nearer to each other aren't told apart. 0 without objects."""
        return APART_DEPTHS * max((thing.depth_of_focus_m for thing in self.objects), default=0.0)

    @property
    def clear(self) -> bool:
        """Whether a focus stands out of the range."""
        return bool(self.objects)

    @property
    def distance_m(self) -> float:
        """Of the clearest object. Where none is clear by the first measure; by the second if it alone is larger on the
        side that it names than on the other."""
        if self.objects:
            return self.objects[0].distance_m
        first, second = MEASURES
        return self.distances_m[second if self.other_side_share[second] < 1 < self.other_side_share[first] else first]


def clear_distance_m(found: FoundFocus, clearly: float) -> float | None:
    """The distance that both measures name, within a twentieth, if the normalised variance has a clear peak.

    clearly: least peak over the median: of many speckles the peak is 1.1, of few up to 2, of images in focus 3 to 100.
    None for a largest value at an end of the range, towards which the measures of even light rise.
    """
    first, second = (found.distances_m[name] for name in MEASURES)
    variance = found.curves[0].measures["normalised variance"]
    ends_m = np.sort(np.abs(found.curves[0].distances_m))[[0, -1]]
    is_clear = float(variance.max()) >= clearly * float(np.median(variance))
    is_clear = is_clear and ends_m[0] < (1 - _AGREE) * abs(found.distance_m) < (1 - _AGREE) ** 2 * ends_m[1]
    return found.distance_m if is_clear and abs(first - second) <= _AGREE * abs(found.distance_m) else None


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
    """Distances between which an image is looked for.

    Half to one and a half times the expected distance, or the reference's radius. Without these, of an in-line
    recording from four depths of focus to 8·N·dx²/λ, where the field's side limits the aperture; of others from a
    hundredth of 4·N·dx²/λ up to it, or to where light at the edge of the band moves sideways by two sides of the field.
    """
    expected = abs(field.distance_m) or abs(field.reference_radius_m or 0.0)
    if is_in_line(field) and not field.distance_m:
        return _in_line_range_m(field)
    if expected > 0:
        return 0.5 * expected, 1.5 * expected
    farthest = 2 * farthest_by_spectrum(field)
    return farthest / 100, max(farthest, 2 * _View.of(field, 0.0, farthest).farthest_m)


def is_sharper_on_other_side(field: Wavefield) -> bool:
    """Whether the image is clearly sharper at minus the field's distance than at the distance [1].

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
    here, there = (view.at(sign * distance_m, min(view.side, _SAMPLES_COMPARED)) for sign in (1, -1))
    sparser = edge_sparsity(there) / max(edge_sparsity(here), _TINY)
    more_varied = normalised_variance(there) / max(normalised_variance(here), _TINY)
    are_both = sparser > _CLEARLY_SHARPER["edge sparsity"] and more_varied > _CLEARLY_SHARPER["normalised variance"]
    return are_both or sparser > _MUCH_SPARSER


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

    The spectrum is cut around its centre of gravity and the field is padded with darkness, so that light which leaves
    the frame still counts. A field with a spherical reference is propagated by one transform of its middle.

    Raises UserError for an empty range, and where one transform would alias.
    """
    if not (math.isfinite(low_m) and math.isfinite(high_m) and low_m < high_m):
        raise UserError("range", f"{low_m:g} to {high_m:g} m", expected="two finite distances, the smaller first")
    if is_in_line(field):
        return _in_line_focus(field, low_m, high_m, progress)
    view = _View.of(field, low_m, high_m)
    samples = next(
        (n for n in _FIRST_SAMPLES if len(view.nodes(low_m, high_m, min(n, view.side))) <= _MOST_STEPS),
        _FIRST_SAMPLES[-1],
    )
    samples = min(samples, view.side)
    sides, nodes = [(low_m, high_m)], view.nodes(low_m, high_m, samples)
    if low_m > 0:
        sides, nodes = [*sides, (-high_m, -low_m)], np.concatenate([-nodes[::-1], nodes])
    levels = math.ceil(math.log2(max(1.0, min(view.side, _MOST_SAMPLES) / samples)))
    total = len(nodes) + levels * len(sides) * len(MEASURES) * (2 * _BETWEEN + 1)
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
    kept = [_best_of(curves[0], name, side, len(sides) > 1) for side in sides for name in MEASURES]
    while samples < min(view.side, _MOST_SAMPLES):
        around = [
            np.linspace(-1, 1, 2 * _BETWEEN + 1) * view.step(peak.distance_m, samples) + peak.distance_m
            for peak in kept
        ]
        samples = min(2 * samples, view.side, _MOST_SAMPLES)
        curves.append(measured(np.unique(np.clip(np.concatenate(around), sides[-1][0], high_m)), samples))
        kept = [_refined(curves[-1], peak, reach) for peak, reach in zip(kept, around, strict=True)]
    return _found(kept, tuple(curves), (low_m, high_m), view)


def is_in_line(field: Wavefield) -> bool:
    """Whether the field is real, and no pattern of the phases 0 and π: an image has its twin on the other side."""
    values = field.values[0]
    if float(np.abs(values.imag).max()) > _REAL * float(np.abs(values.real).max()):
        return False
    sizes = np.abs(values.real)
    return float(np.ptp(sizes)) > _EVEN * float(sizes.max())


def _in_line_range_m(field: Wavefield) -> tuple[float, float]:
    swept, radius_m = _swept(field), field.reference_radius_m
    coarsest_m = swept.side_m / min(swept.most_samples, MOST_SAMPLES)
    near_m = 16 * coarsest_m**2 / swept.wavelength_m
    return _real_m(near_m, radius_m), _real_m(8 * swept.nearest_sampled_m, radius_m)


def _swept(field: Wavefield) -> Swept:
    index = int(np.argmin(np.abs(field.wavelengths_m - _SEEN_BEST_M)))
    return Swept.of(torch.from_numpy(field.values[0, index].copy()), field.pitch_m, float(field.wavelengths_m[index]))


def _equivalent_m(distance_m: float, radius_m: float | None) -> float:
    """The distance z·R/(R − z) over which light of a plane wave does what that of a point at R does over z."""
    return distance_m if radius_m is None else distance_m * abs(radius_m) / (abs(radius_m) - distance_m)


def _real_m(distance_m: float, radius_m: float | None) -> float:
    """The inverse of `_equivalent_m`."""
    return distance_m if radius_m is None else distance_m * abs(radius_m) / (abs(radius_m) + distance_m)


def _in_line_focus(
    field: Wavefield, low_m: float, high_m: float, progress: Callable[[int, int, str], None] | None
) -> FoundFocus:
    """The objects of an in-line recording, before the plane of the camera or, as twins, behind it."""
    swept, radius_m = _swept(field), field.reference_radius_m
    sign = -1.0 if high_m <= 0 else 1.0
    nearest_m, farthest_m = sorted((abs(low_m), abs(high_m))) if low_m * high_m > 0 else (0.0, max(-low_m, high_m))
    if radius_m is not None and farthest_m >= abs(radius_m):
        found = f"up to {units.format_rounded(farthest_m, 'mm')}"
        raise UserError("range", found, expected=f"below the radius of {units.format_rounded(abs(radius_m), 'mm')}")
    least_m = 2 * swept.depth_of_focus_m(0.0)
    first_m, last_m = (max(_equivalent_m(z, radius_m), least_m) for z in (nearest_m, farthest_m))
    if not first_m < last_m:
        supported = units.format_rounded(_real_m(least_m, radius_m), "mm")
        raise UserError(
            "range",
            f"up to {units.format_rounded(farthest_m, 'mm')}",
            expected=f"some of it beyond {supported}",
            remedy="nearer fringes are finer than the pixels",
        )
    objects, unclear, unexplained, levels = search_objects(swept, first_m, last_m, progress)
    scaled = [_in_space(thing, sign, radius_m) for thing in objects]
    curves = tuple(_curve_of(level, sign, radius_m) for level in levels)
    by_measure = {name: _nearest_top(curves, name, scaled) for name in MEASURES}
    return FoundFocus(
        by_measure,
        {name: -z for name, z in by_measure.items()},
        dict.fromkeys(MEASURES, 1.0),
        curves,
        (low_m, high_m),
        tuple(scaled),
        len(curves),
        _real_m(swept.nearest_sampled_m, radius_m),
        _real_m(least_m, radius_m),
        tuple(_unclear_in_space(thing, objects[0].distance_m, radius_m) for thing in unclear),
        unexplained,
    )


def _in_space(thing: FocusedObject, sign: float, radius_m: float | None) -> FocusedObject:
    """An object of equivalent distance, seen with a point source, at its own distance and size."""
    distance_m = _real_m(thing.distance_m, radius_m)
    smaller = distance_m / thing.distance_m  # 1/M, M = R/(R − z)
    y, x = thing.centre_m or (0.0, 0.0)
    centre_m = y * smaller, x * smaller
    return FocusedObject(sign * distance_m, thing.depth_of_focus_m * smaller**2, thing.share, centre_m, thing.votes)


def _unclear_in_space(thing: Unclear, distance_m: float, radius_m: float | None) -> Unclear:
    """Something of unknown distance, as if it stood at this equivalent one."""
    y, x = (part * _real_m(distance_m, radius_m) / distance_m for part in thing.centre_m)
    return Unclear((y, x))


def _curve_of(level: Level, sign: float, radius_m: float | None) -> FocusCurve:
    """A level's own part, rising."""
    own = (level.distances_m >= level.own[0]) & (level.distances_m <= level.own[1])
    order = slice(None, None, int(sign))
    distances_m = np.array([sign * _real_m(z, radius_m) for z in level.distances_m[own]])[order]
    return FocusCurve(
        level.samples,
        distances_m,
        {"edge sparsity": level.edge_sparsity[own][order], "normalised variance": level.variance[own][order]},
    )


def _nearest_top(curves: tuple[FocusCurve, ...], name: Measure, found: list[FocusedObject]) -> float:
    """The distance of a measure's largest value: within six depths of focus of the clearest object, if there is one."""
    best_m, height = (found[0].distance_m if found else 0.0), -math.inf
    for curve in curves:
        rises = np.log(curve.measures[name]) - float(np.median(np.log(curve.measures[name])))
        for distance_m, rise in zip(curve.distances_m, rises, strict=True):
            near = not found or abs(distance_m - found[0].distance_m) < 6 * found[0].depth_of_focus_m
            if near and rise > height:
                best_m, height = float(distance_m), float(rise)
    return best_m


@dataclass(frozen=True)
class _Peak:
    """A maximum of a measure.

    prominence: the height of the maximum over the higher one of the valleys beside it; 0 where the curve has none
    inside, and the largest value is at an end.
    """

    measure: Measure
    side: tuple[float, float]
    distance_m: float
    value: float
    prominence: float


@dataclass(frozen=True, eq=False)
class _View:
    """A field of which a part of the band, or of the samples, is seen at a distance.

    values: (y, x) complex64: without its tilt and its unscattered wave, faded at its edges; of a field with the
    reference radius `radius_m`, as it is. band: samples (y, x) of the part of the spectrum, around 0, that holds 98 %
    of the light.
    """

    values: Tensor
    pitch_m: tuple[float, float]
    wavelength_m: float
    radius_m: float | None
    band: tuple[int, int]

    @staticmethod
    def of(field: Wavefield, low_m: float, high_m: float) -> _View:
        """The view of a field's first frame. Raises UserError where one transform would alias within the range."""
        index = int(np.argmin(np.abs(field.wavelengths_m - _SEEN_BEST_M)))
        values = torch.from_numpy(field.values[0, index].copy())
        radius_m, band = field.reference_radius_m, field.shape
        if radius_m is not None:
            for distance_m in (low_m, high_m):
                choose_method(field, distance_m, "fourier")
        else:
            values, power = _scattered(values)
            band = _band(power, 0), _band(power, 1)
        return _View(values, field.pitch_m, float(field.wavelengths_m[index]), radius_m, band)

    @property
    def side(self) -> int:
        """Samples of the longer side of the band."""
        return max(self.band)

    @property
    def sides_m(self) -> tuple[float, float]:
        """Lengths (y, x) of the field's frame, m."""
        y, x = (n * pitch for n, pitch in zip(self.values.shape, self.pitch_m, strict=True))
        return y, x

    @property
    def farthest_m(self) -> float:
        """The distance at which light at the edge of the band has moved sideways by the field's side."""
        return min(2 * side**2 / (self.wavelength_m * n) for side, n in zip(self.sides_m, self.band, strict=True))

    def part(self, samples: int) -> tuple[int, int]:
        """Rows and columns of the band that are used if its longer side has so many samples."""
        rows, columns = (max(8, min(n, round(n * samples / self.side))) for n in self.band)
        return min(rows, self.band[0]), min(columns, self.band[1])

    def step(self, distance_m: float, samples: int) -> float:
        """Half the depth of focus λ/NA²."""
        along = int(np.argmax(self.sides_m))
        side_m, used = self.sides_m[along], self.part(samples)[along]
        if self.radius_m is not None:
            na = used * self.pitch_m[along] / (2 * abs(distance_m))
        else:
            na = min(self.wavelength_m * used / (2 * side_m), 1.0)
            if distance_m != 0:
                na = min(na, side_m / (2 * abs(distance_m)))
        return 0.5 * self.wavelength_m / na**2

    def nodes(self, low_m: float, high_m: float, samples: int) -> NDArray[np.float64]:
        """Distances half a depth of focus apart."""
        found: list[float] = []
        distance_m = low_m
        while distance_m < high_m and len(found) < 100 * _MOST_STEPS:
            found.append(distance_m)
            distance_m += self.step(distance_m, samples)
        return np.array([*found, high_m])

    def at(self, distance_m: float, samples: int) -> Tensor:
        """The field at a distance, of a part of its band or of its middle, in the window that holds its light."""
        rows, columns = self.part(samples)
        if self.radius_m is not None:
            middle = _middle(self.values, (rows, columns))
            window = first_order_window((rows, columns), self.pitch_m, self.wavelength_m, distance_m)
            return _lit(fresnel_propagate(middle, self.pitch_m, self.wavelength_m, distance_m, window, self.radius_m))
        padded = [self._padded(n, side_m, distance_m) for n, side_m in zip((rows, columns), self.sides_m, strict=True)]
        whole = torch.zeros(padded, dtype=self.values.dtype)
        _middle(whole, (rows, columns))[:] = self._narrowed((rows, columns))
        sine_y, sine_x = (
            self.wavelength_m * n / (side_m * m)
            for n, side_m, m in zip((rows, columns), self.sides_m, padded, strict=True)
        )
        ky, kx = (torch.from_numpy(frequency_indices(m)) for m in padded)
        transfer = free_space(distance_m / self.wavelength_m, (sine_y, sine_x), ky, kx, whole.dtype)
        return _lit(torch.fft.ifft2(torch.fft.fft2(whole) * transfer))

    def _narrowed(self, part: tuple[int, int]) -> Tensor:
        """The field with this part of its band alone, as coarse as that allows."""
        spectrum = torch.fft.fftshift(torch.fft.fft2(self.values))
        return torch.fft.ifft2(torch.fft.ifftshift(_middle(spectrum, part)))

    def _padded(self, n: int, side_m: float, distance_m: float) -> int:
        """Samples of a side that has room for light of the whole band of n samples."""
        wide = 1 + abs(distance_m) * self.wavelength_m * n / side_m**2
        return next_fast_length(math.ceil(n * min(wide, _MOST_PADDED)))


def _scattered(values: Tensor) -> tuple[Tensor, Tensor]:
    """A field (y, x) without tilt and, where it dominates, without unscattered wave, faded at its edges; its power.

    The power is that of the spectrum, zero frequency first, before the fading.
    """
    spectrum = torch.fft.fft2(values)
    power = spectrum.abs().square()
    peak = np.unravel_index(int(power.argmax()), power.shape)
    near = [
        torch.arange(int(k) - _PEAK_BINS, int(k) + _PEAK_BINS + 1) % n for k, n in zip(peak, power.shape, strict=True)
    ]
    centre = _centre_of(power.sum(dim=1)), _centre_of(power.sum(dim=0))
    if float(power[near[0]][:, near[1]].sum()) > _UNSCATTERED * float(power.sum()):
        spectrum[near[0][:, None], near[1][None, :]] = 0
        centre = int(peak[0]), int(peak[1])
    spectrum = torch.roll(spectrum, (-centre[0], -centre[1]), (0, 1))
    fading = [torch.from_numpy(taper(n, _FADED)).to(values.real.dtype) for n in values.shape]
    return torch.fft.ifft2(spectrum) * fading[0][:, None] * fading[1][None, :], spectrum.abs().square()


def _band(power: Tensor, axis: int) -> int:
    """How many samples of a spectrum around the frequency 0 hold 98 % of its power along an axis; even if possible."""
    n = power.shape[axis]
    along = power.sum(dim=1 - axis).double()
    order = torch.from_numpy(np.abs(frequency_indices(n))).argsort(stable=True)
    light = along[order].cumsum(0)
    if not float(light[-1]) > 0:
        return n
    reached = int(torch.searchsorted(light, _LIGHT * light[-1]))
    return max(min(n, 8), min(n, 2 * (reached // 2 + 1)))


def _lit(field: Tensor) -> Tensor:
    """The window (y, x) of a field that holds 98 % of its light along each axis, divided by the local amplitude."""
    power = field.abs().square().double()
    edges = []
    for axis in (0, 1):
        light = power.sum(dim=1 - axis).cumsum(0)
        outside = 0.5 * (1 - _LIGHT) * light[-1]
        low = int(torch.searchsorted(light, outside))
        high = int(torch.searchsorted(light, light[-1] - outside))
        edges.append(slice(low, max(high + 1, low + 3)))
    window = field[edges[0], edges[1]]
    return window / torch.sqrt(_local_mean(window.abs().square())).clamp(min=1e-30)


def _local_mean(intensity: Tensor) -> Tensor:
    """The mean of an intensity (y, x) over a Gaussian of the width `_LOCAL`, and a little of the whole mean."""
    return smoothed(intensity, _BLOCKS, _LOCAL) + _DARK * intensity.mean()


def _middle(values: Tensor, shape: tuple[int, int]) -> Tensor:
    """The middle rows and columns; of a spectrum with the zero frequency in its middle, those around this one."""
    top, left = (n // 2 - k // 2 for n, k in zip(values.shape, shape, strict=True))
    return values[top : top + shape[0], left : left + shape[1]]


def _centre_of(power: Tensor) -> int:
    """The index of the centre of gravity of a periodic spectrum, by the phase of its first harmonic."""
    angles = torch.arange(len(power), dtype=torch.float64) * (2 * math.pi / len(power))
    weights = power.double()
    angle = math.atan2(float((weights * angles.sin()).sum()), float((weights * angles.cos()).sum()))
    return round(angle / (2 * math.pi) * len(power))


def _best_of(curve: FocusCurve, name: Measure, side: tuple[float, float], has_both: bool) -> _Peak:
    """The most prominent maximum of a measure on one side; has_both: the curve has the same distances on the other."""
    inside = (curve.distances_m >= side[0]) & (curve.distances_m <= side[1])
    distances_m, values = curve.distances_m[inside], curve.measures[name][inside]
    compared = np.log(np.maximum(values, 1e-30))
    if has_both:
        compared = 2 * compared - np.log(np.maximum(curve.measures[name][::-1][inside], 1e-30))
    from scipy.signal import find_peaks  # slow start: opening a field needs no curve

    peaks, found = find_peaks(compared, prominence=0)
    prominences = found["prominences"] if len(peaks) else np.zeros(1)
    best = int(peaks[np.argmax(prominences)]) if len(peaks) else int(np.argmax(compared))
    return _Peak(name, side, float(distances_m[best]), float(values[best]), float(prominences.max()))


def _refined(curve: FocusCurve, peak: _Peak, around_m: NDArray[np.float64]) -> _Peak:
    """A peak moved to the place of the largest value of a finer curve around it."""
    low, high = max(around_m[0], peak.side[0]), min(around_m[-1], peak.side[1])
    inside = (curve.distances_m >= low) & (curve.distances_m <= high)
    distance_m, value = _peak(curve.distances_m[inside], curve.measures[peak.measure][inside])
    return replace(peak, distance_m=distance_m, value=value)


def _found(peaks: list[_Peak], curves: tuple[FocusCurve, ...], range_m: tuple[float, float], view: _View) -> FoundFocus:
    """The most prominent peak of each measure, and that of the other side."""
    best: dict[Measure, float] = {}
    other: dict[Measure, float | None] = {}
    share: dict[Measure, float] = {}
    for name in MEASURES:
        first, *rest = sorted((p for p in peaks if p.measure == name), key=lambda p: (-p.prominence, -p.value))
        best[name] = first.distance_m
        other[name] = rest[0].distance_m if rest else None
        share[name] = rest[0].value / first.value if rest and first.value > 0 else 0.0
    found = FoundFocus(best, other, share, curves, range_m)
    depth_m = 2 * view.step(found.distance_m, view.side)
    is_clear = _stands_out(found, depth_m, {name: _is_inside(best[name], curves[0]) for name in MEASURES})
    return replace(found, objects=(FocusedObject(found.distance_m, depth_m, 1.0),)) if is_clear else found


def _is_inside(distance_m: float, curve: FocusCurve) -> bool:
    """Whether a distance lies inside the range of its side, by more than half a step of the coarse curve."""
    side = np.sort(np.abs(curve.distances_m[curve.distances_m * distance_m > 0]))
    return len(side) > 2 and bool(side[:2].mean() < abs(distance_m) < side[-2:].mean())


def _stands_out(found: FoundFocus, depth_m: float, inside: dict[Measure, bool]) -> bool:
    """Whether a focus is clear [2]."""
    first, second = (found.distances_m[name] for name in MEASURES)
    agree = abs(first - second) <= max(_AGREE * abs(found.distance_m), 2 * depth_m)
    named = [name for name in MEASURES if found.distances_m[name] == found.distance_m and inside[name]]
    if not named or abs(found.distance_m) < _LEAST_DEPTHS * depth_m:
        return False
    if found.other_side_m[named[0]] is None:
        return agree
    return (agree or named[0] == MEASURES[0]) and found.other_side_share[named[0]] <= _OTHER_SIDE[agree]


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
