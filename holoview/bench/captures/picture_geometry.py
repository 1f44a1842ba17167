"""Where a camera's picture of a Fourier bench lies in the spectrum of the pattern that was shown.

A lens shows the modulator's spectrum |F|² in its focal plane. A picture of it may be turned or mirrored, its axis may
be anywhere, and one period of the spectrum, λ·f/(pixel pitch), covers

    scale = λ·f / (modulator pitch · camera pitch)

camera pixels. Envelopes (local means of amplitudes) give candidates for the orientation, the scale and the axis, by
masked normalised correlation over all places (Padfield, IEEE Trans. Image Process. 21, 2706 (2012)); where envelopes
are alike, the speckle decides (`numerics.speckle_match`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft2, fftshift, irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter, label

from holoview.bench.captures.dataset import ORIENTATIONS, inverse_orientation, turned, undone
from holoview.bench.captures.unknown_settings import dark_noise
from holoview.light.numerics.speckle_match import LOCAL_MEAN_PX, SpeckleMatch, local_mean, match_speckle
from holoview.util.progress import ProgressCallback, no_progress

Floats = NDArray[np.float64]
Masks = NDArray[np.bool_]

_SPECTRUM = 2048  # samples of the pattern's spectrum along each side
_ZERO_ORDER = 40  # samples of it to each side of the axis that don't count
_COARSE_SIDE, _FINE_SIDE = 240, 480  # pixels of the binned picture's longer side
_SCALES = 80  # tried at first, in a geometric series
_SCALE_RANGE = 0.25, 2.6  # of the picture's longer side, where no focal length is stated
_STATED_RANGE = 0.85  # of the stated scale, and its inverse
_FINE_SCALES = np.arange(0.97, 1.0301, 0.006)
_ALIKE = 0.9  # of the best score: a candidate that speckle has to exclude
_COMMON_SCALES = 0.996, 0.998, 1.0, 1.002, 1.004
_WINDOW = 480, 640  # camera pixels in which speckle is compared
_REACH_PX, _AROUND_PX = 25, 80
_MEAN_SHARE = 1 / 24
"""Of a window's shorter side: the largest σ of the local mean. In pictures of 93 and 141 rows a σ of 12 pixels leaves
the shape of a few blobs in the contrasts: 12 other patterns stood out by up to 9.2, the right one by 10.4; 12 others by
up to 4.6, the right one by 6.5. With 4 and 6 pixels they do by 5.6, 19.7, 4.1 (of 4) and 17.1."""
_BEAMS = 1.0, 0.7, 0.5, 0.35, 0.25  # radii of light tried, of half the modulator's shorter side
_STROKES = 0.5, 0.9  # tried, of the assumed one
_DARK_SHARE = 0.005  # of the pixels, the darkest, which tell what is no light
_LIT_NOISES = 4.0  # standard deviations of dark pixels by which the local mean is above them
_LEAST_LIT = 0.02  # of the pixels
_FAINT = 3.0, 15.0  # standard deviations between which wavefronts are tried
_WAVEFRONTS_RAD = -8.0, -4.0, -2.0, 2.0, 4.0, 8.0


@dataclass(frozen=True)
class SpectrumPlacement:
    """A way to lay a spectrum over a picture.

    orientation: of the picture, a name of `ORIENTATIONS`. scale_px: camera pixels to a period of the spectrum. axis_px:
    (y, x) of the zero order in the picture. envelope: correlation of the envelopes. speckle: the best match of speckle
    among simple beams, None where it wasn't tried. beam, stroke: of that match: radius of light over half of the
    modulator's shorter side, 1 for even light, and the stroke over the assumed one. wavefront: over that radius, rad at
    its edge: defocus 2r² − 1 and coma (3r² − 2)·y, (3r² − 2)·x, tried where speckle hardly stands without.
    """

    orientation: str
    scale_px: float
    axis_px: tuple[float, float]
    envelope: float
    speckle: SpeckleMatch | None = None
    beam: float = 1.0
    stroke: float = 1.0
    wavefront: tuple[float, float, float] = (0.0, 0.0, 0.0)


def zero_order_mask(picture: NDArray[np.floating] | NDArray[np.unsignedinteger], saturation: float) -> Masks:
    """True for the largest saturated spots of a picture (y, x) and their rims: the zero order. Others are speckle."""
    parts, count = label(picture >= saturation)
    if not count:
        return np.zeros(picture.shape, bool)
    area = np.bincount(parts.ravel())
    area[0] = 0
    return np.asarray(gaussian_filter((area[parts] >= 0.3 * area.max()).astype(np.float32), 6) > 0.02)


def find_placements(
    picture: NDArray[np.floating],
    phase: Floats,
    cut: Masks,
    scale_px: float | None = None,
    progress: ProgressCallback = no_progress,
) -> list[SpectrumPlacement]:
    """The ways to lay the spectrum of a pattern over a picture, the best first.

    picture: (y, x), counts. phase: (row, column), of the pattern as the modulator shows it, turns. cut: (y, x), True
    for pixels that don't count, such as the zero order. scale_px: stated scale, which is looked for within 15 %; any
    when None. The best few have their speckle compared.
    """
    spectrum = _spectrum_power(phase)
    longer = max(picture.shape)
    low, high = (_STATED_RANGE * scale_px, scale_px / _STATED_RANGE) if scale_px else (f * longer for f in _SCALE_RANGE)
    scales = np.geomspace(low, high, _SCALES if scale_px is None else 24)
    coarse = _scan(picture, cut, spectrum, scales, ORIENTATIONS, max(1, round(longer / _COARSE_SIDE)), progress)
    best: list[SpectrumPlacement] = []
    for orientation in dict.fromkeys(found.orientation for found in coarse):
        top = next(found for found in coarse if found.orientation == orientation)
        if top.envelope > _ALIKE * coarse[0].envelope:
            progress(0, 1, f"placement {orientation}")
            binning = max(1, round(longer / _FINE_SIDE))
            best.append(
                _scan(picture, cut, spectrum, top.scale_px * _FINE_SCALES, [orientation], binning, no_progress)[0]
            )
    tried = [_with_speckle(WindowedPicture(picture, cut, phase, found.orientation), found) for found in best]
    return sorted(tried, key=lambda found: -_correlation(found))


def _spectrum_power(phase: Floats) -> Floats:
    """Power of a pattern's spectrum, zero frequency in the middle, without the zero order."""
    field = np.zeros((_SPECTRUM, _SPECTRUM), np.complex64)
    rows, columns = (min(n, _SPECTRUM) for n in phase.shape)
    field[:rows, :columns] = np.exp(2j * np.pi * phase[:rows, :columns])
    power = np.abs(fftshift(fft2(field))) ** 2
    middle = slice(_SPECTRUM // 2 - _ZERO_ORDER, _SPECTRUM // 2 + _ZERO_ORDER + 1)
    power[middle, middle] = np.minimum(power[middle, middle], np.median(power[middle, middle]))
    return power.astype(np.float64)


def _binned(picture: NDArray[np.floating] | Masks, side: int) -> Floats:
    rows, columns = (n // side for n in picture.shape)
    cut = picture[: rows * side, : columns * side].astype(np.float64)
    return np.asarray(cut.reshape(rows, side, columns, side).mean(axis=(1, 3)))


def _scan(
    picture: NDArray[np.floating],
    cut: Masks,
    spectrum: Floats,
    scales: Floats,
    orientations: Sequence[str],
    binning: int,
    progress: ProgressCallback,
) -> list[SpectrumPlacement]:
    """The best place of each scale and orientation, by masked correlation of envelopes; the best first."""
    weight = (_binned(~cut, binning) > 0.99).astype(np.float64)
    light = np.sqrt(gaussian_filter(_binned(np.where(cut, 0.0, picture), binning), 1))
    light = (light - (light * weight).sum() / weight.sum()) * weight
    size = [next_fast_len(2 * n, real=True) for n in light.shape]
    of_light, of_weight = rfft2(light, size), rfft2(weight, size)
    coarser = 512 if binning >= 6 else 1024
    power = _binned(spectrum, _SPECTRUM // coarser)
    found = []
    for number, scale in enumerate(scales):
        progress(number, len(scales), "scales of the picture")
        count = max(8, round(scale / binning))
        nearest = ((np.arange(count) + 0.5) * coarser / count).astype(int)
        envelope = np.sqrt(gaussian_filter(gaussian_filter(power, 0.5 * coarser / count)[np.ix_(nearest, nearest)], 1))
        beyond = max(0, -((min(size) - count) // 2))
        envelope = envelope[beyond : count - beyond, beyond : count - beyond]
        for orientation in orientations:
            template = np.ascontiguousarray(turned(envelope, orientation))
            spectra = [np.conj(rfft2(part, size)) for part in (template, template * template)]
            products = [of_light * spectra[0], of_weight * spectra[0], of_weight * spectra[1]]
            numerator, sums, squares = (irfft2(product, size) for product in products)
            variance = np.maximum(squares - sums**2 / weight.sum(), 0.02 * float(squares.max()))
            scores = numerator / np.sqrt(float((light**2).sum()) * variance)
            at = np.unravel_index(int(scores.argmax()), scores.shape)
            corner = [(int(k) + n // 2) % n - n // 2 for k, n in zip(at, size, strict=True)]
            middle = [(k + side / 2) * binning - 0.5 for k, side in zip(corner, template.shape, strict=True)]
            found.append(SpectrumPlacement(orientation, float(scale), (middle[0], middle[1]), float(scores[at])))
    return sorted(found, key=lambda placement: -placement.envelope)


class WindowedPicture:
    """The brightest window of a picture, upright, in which speckle is compared; of a small picture all.

    picture: (y, x), counts, as taken. cut: (y, x), True for pixels that don't count.
    """

    def __init__(self, picture: NDArray[np.floating], cut: Masks, phase: Floats, orientation: str) -> None:
        upright, usable = undone(picture, orientation).astype(np.float64), undone(~cut, orientation)
        self._window = bright_window(upright, usable, _WINDOW)
        self._light, self._usable = upright[self._window], _lit(upright, usable)[self._window]
        self._phase, self._shape = phase, picture.shape
        least = min(self._light.shape)
        self._reach = {"reach_px": min(_REACH_PX, least // 8), "around_px": min(_AROUND_PX, least // 3)}
        self._mean_px = min(LOCAL_MEAN_PX, least * _MEAN_SHARE)

    def matched(self, placement: SpectrumPlacement) -> SpectrumPlacement:
        """The placement with the match of the speckle that its beam, stroke and wavefront predict."""
        predicted = simple_prediction(self._phase, placement, self._shape, self._window)
        match = match_speckle(self._light, predicted, self._usable, **self._reach, mean_px=self._mean_px)
        return replace(placement, speckle=match)


def _lit(picture: Floats, usable: Masks) -> Masks:
    """The usable pixels (y, x) in whose surroundings light stands out of the noise; all where hardly any does.

    In the dark, local contrast is that of the noise alone.
    """
    dark = float(np.quantile(picture[usable], _DARK_SHARE)) if usable.any() else 0.0
    mean = local_mean(picture - dark, usable)
    lit = usable & (mean > _LIT_NOISES * dark_noise(picture))
    return lit if lit.mean() > _LEAST_LIT else usable


def _with_speckle(seen: WindowedPicture, placement: SpectrumPlacement) -> SpectrumPlacement:
    """The placement with the best match of its speckle among simple beams and wavefronts."""
    tried = [seen.matched(replace(placement, beam=beam, stroke=stroke)) for beam, stroke in product(_BEAMS, _STROKES)]
    best = max(tried, key=_correlation)
    if best.speckle is None or not _FAINT[0] < best.speckle.significance < _FAINT[1]:
        return best
    for term, rad in product((2, 1, 0), _WAVEFRONTS_RAD):
        others = best.wavefront[:term], best.wavefront[term + 1 :]
        wavefront: Any = (*others[0], rad, *others[1])
        best = max(best, seen.matched(replace(best, wavefront=wavefront)), key=_correlation)
    return best


def _correlation(placement: SpectrumPlacement) -> float:
    return placement.speckle.correlation if placement.speckle else -1.0


def simple_prediction(
    phase: Floats, placement: SpectrumPlacement, shape: tuple[int, ...], window: tuple[slice, slice]
) -> Floats:
    """Intensity (y, x), in any unit, in a window of the upright picture, with the beam and stroke of the placement.

    phase: (row, column), turns. shape: of the picture as it was taken.
    """
    axis = upright_place(placement.axis_px, shape, placement.orientation)
    rows, columns = (np.arange(part.start, part.stop) for part in window)
    half = min(phase.shape) / 2
    v, u = (np.arange(n) - (n - 1) / 2 for n in phase.shape)
    reach = 1.2 * half * placement.beam if placement.beam < 1 else math.inf
    lit_v, lit_u = np.abs(v) <= reach, np.abs(u) <= reach
    r2 = (v[lit_v][:, None] ** 2 + u[lit_u][None] ** 2) / (placement.beam * half) ** 2
    amplitude = np.exp(-(np.clip(r2, 1e-4, 50.0) ** 2)) if placement.beam < 1 else np.ones_like(r2)
    wave_y = np.exp(-2j * np.pi * (rows - axis[0])[:, None] / placement.scale_px * v[lit_v]).astype(np.complex64)
    wave_x = np.exp(-2j * np.pi * u[lit_u][:, None] * (columns - axis[1]) / placement.scale_px).astype(np.complex64)
    defocus, coma_y, coma_x = placement.wavefront
    across_y, across_x = v[lit_v][:, None] / (placement.beam * half), u[lit_u][None] / (placement.beam * half)
    wavefront = defocus * (2 * r2 - 1) + (3 * r2 - 2) * (coma_y * across_y + coma_x * across_x)
    field = amplitude * np.exp(1j * (2 * np.pi * placement.stroke * phase[np.ix_(lit_v, lit_u)] + wavefront))
    return np.asarray(np.abs(wave_y @ field.astype(np.complex64) @ wave_x) ** 2, dtype=np.float64)


def common_placement(
    pictures: Sequence[NDArray[np.floating]], cuts: Sequence[Masks], phases: Sequence[Floats], start: SpectrumPlacement
) -> tuple[SpectrumPlacement, list[SpeckleMatch]]:
    """The one placement of several pictures of a bench, near a start, and the match of each picture's speckle there.

    The scale is the one of a few around the start's at which the pictures' speckle correlates most, together; the axis
    moves by the mean shift of the pictures that match.
    """
    parts = zip(pictures, cuts, phases, strict=True)
    seen = [WindowedPicture(*part, start.orientation) for part in parts]
    best: tuple[float, SpectrumPlacement, list[SpeckleMatch]] | None = None
    for factor in _COMMON_SCALES:
        tried = replace(start, scale_px=start.scale_px * factor)
        found = [one.matched(tried).speckle for one in seen]
        matches = [match for match in found if match is not None]
        total = sum(match.correlation for match in matches)
        if best is None or total > best[0]:
            best = total, tried, matches
    assert best is not None
    _, placement, matches = best
    heaviest = max(match.significance for match in matches)
    shifts = np.array([m.shift for m in matches if m.significance > heaviest / 3], dtype=np.float64)
    upright = upright_place(placement.axis_px, pictures[0].shape, placement.orientation)
    moved = (upright[0] + float(shifts[:, 0].mean()), upright[1] + float(shifts[:, 1].mean()))
    shape = undone(pictures[0], placement.orientation).shape
    return replace(
        placement, axis_px=upright_place(moved, shape, inverse_orientation(placement.orientation)), speckle=matches[0]
    ), matches


def upright_place(place: tuple[float, float], shape: tuple[int, ...], orientation: str) -> tuple[float, float]:
    """A place (y, x) of a picture, pixels, in the upright picture that `undone` gives."""
    indices = [undone(np.broadcast_to(index, shape[:2]), orientation) for index in np.ogrid[: shape[0], : shape[1]]]
    origin = [float(index[0, 0]) for index in indices]
    by_row = [float(index[1, 0] - index[0, 0]) for index in indices]
    by_column = [float(index[0, 1] - index[0, 0]) for index in indices]
    steps = np.array([by_row, by_column]).T
    upright = np.linalg.solve(steps, np.array(place) - origin)
    return float(upright[0]), float(upright[1])


def bright_window(picture: Floats, usable: Masks, size: tuple[int, int]) -> tuple[slice, slice]:
    """The window of a picture (y, x) that holds most of its bright usable pixels, as slices."""
    mean = gaussian_filter(np.where(usable, picture, 0.0), 12) / np.maximum(
        gaussian_filter(usable.astype(float), 12), 0.05
    )
    bright = usable & (mean > max(float(np.quantile(mean[usable], 0.85)), 3 * float(np.quantile(mean, 0.1))))
    rows, columns = (min(n, side) for n, side in zip(size, picture.shape, strict=True))
    sums = np.pad(bright, ((1, 0), (1, 0))).astype(np.int64).cumsum(axis=0).cumsum(axis=1)
    counts = sums[rows:, columns:] - sums[:-rows, columns:] - sums[rows:, :-columns] + sums[:-rows, :-columns]
    y, x = (int(k) for k in np.unravel_index(int(counts.argmax()), counts.shape))
    return slice(y, y + rows), slice(x, x + columns)
