"""Where a camera's picture of a Fourier bench lies in the spectrum of the pattern that was shown.

A lens shows the modulator's spectrum |F|² in its focal plane. A picture of it may be turned or mirrored, its axis may
be anywhere, and one period of the spectrum, λ·f/(pixel pitch), covers

    scale = λ·f / (modulator pitch · camera pitch)

camera pixels. Envelopes (local means of amplitudes) give candidates for the orientation, the scale and the axis, by
masked normalised correlation over all places (Padfield, IEEE Trans. Image Process. 21, 2706 (2012)); where envelopes
are alike, the speckle decides (`numerics.speckle_match`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft2, fftshift, irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter, label

from holoview.captures.dataset import ORIENTATIONS, turned, undone
from holoview.numerics.speckle_match import SpeckleMatch, match_speckle
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
_WINDOW = 480, 640  # camera pixels in which speckle is compared
_REACH_PX, _AROUND_PX = 25, 80
_BEAMS = 1.0, 0.7, 0.5, 0.35, 0.25  # radii of light tried, of half the modulator's shorter side
_STROKES = 0.5, 0.9  # tried, of the assumed one


@dataclass(frozen=True)
class Placement:
    """A way to lay a spectrum over a picture.

    orientation: of the picture, a name of `ORIENTATIONS`. scale_px: camera pixels to a period of the spectrum. axis_px:
    (y, x) of the zero order in the picture. envelope: correlation of the envelopes. speckle: the best match of speckle
    among simple beams, None where it wasn't tried.
    """

    orientation: str
    scale_px: float
    axis_px: tuple[float, float]
    envelope: float
    speckle: SpeckleMatch | None = None


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
    saturation: float,
    scale_px: float | None = None,
    progress: ProgressCallback = no_progress,
) -> list[Placement]:
    """The ways to lay the spectrum of a pattern over a picture, the best first.

    picture: (y, x), counts. phase: (row, column), of the pattern as the modulator shows it, turns. saturation: counts
    of a full pixel. scale_px: stated scale, which is looked for within 15 %; any when None. The best few have their
    speckle compared.
    """
    spectrum = _spectrum_power(phase)
    cut = zero_order_mask(picture, saturation)
    longer = max(picture.shape)
    low, high = (_STATED_RANGE * scale_px, scale_px / _STATED_RANGE) if scale_px else (f * longer for f in _SCALE_RANGE)
    scales = np.geomspace(low, high, _SCALES if scale_px is None else 24)
    coarse = _scan(picture, cut, spectrum, scales, ORIENTATIONS, max(1, round(longer / _COARSE_SIDE)), progress)
    best: list[Placement] = []
    for orientation in dict.fromkeys(found.orientation for found in coarse):
        top = next(found for found in coarse if found.orientation == orientation)
        if top.envelope > _ALIKE * coarse[0].envelope:
            progress(0, 1, f"placement {orientation}")
            binning = max(1, round(longer / _FINE_SIDE))
            best.append(
                _scan(picture, cut, spectrum, top.scale_px * _FINE_SCALES, [orientation], binning, no_progress)[0]
            )
    tried = [_with_speckle(picture, cut, phase, placement) for placement in best]
    return sorted(tried, key=lambda found: -(found.speckle.correlation if found.speckle else -1.0))


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
) -> list[Placement]:
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
            found.append(Placement(orientation, float(scale), (middle[0], middle[1]), float(scores[at])))
    return sorted(found, key=lambda placement: -placement.envelope)


def _with_speckle(picture: NDArray[np.floating], cut: Masks, phase: Floats, placement: Placement) -> Placement:
    """The placement with the best match of its speckle among simple beams, its axis corrected by the match's shift."""
    upright = undone(picture, placement.orientation).astype(np.float64)
    usable = undone(~cut, placement.orientation)
    axis = upright_place(placement.axis_px, picture.shape, placement.orientation)
    window = bright_window(upright, usable, _WINDOW)
    rows, columns = (np.arange(part.start, part.stop) for part in window)
    inside = usable[window]
    best: SpeckleMatch | None = None
    half = min(phase.shape) / 2
    v, u = (np.arange(n) - (n - 1) / 2 for n in phase.shape)
    for share in _BEAMS:
        lit_v, lit_u = np.abs(v) <= share * half * 1.2, np.abs(u) <= share * half * 1.2
        r2 = (v[lit_v][:, None] ** 2 + u[lit_u][None] ** 2) / (share * half) ** 2
        wave_y = np.exp(-2j * np.pi * (rows - axis[0])[:, None] / placement.scale_px * v[lit_v]).astype(np.complex64)
        wave_x = np.exp(-2j * np.pi * u[lit_u][:, None] * (columns - axis[1]) / placement.scale_px).astype(np.complex64)
        amplitude = np.exp(-(np.clip(r2, 1e-4, 50.0) ** 2)) if share < 1 else np.ones_like(r2)
        for stroke in _STROKES:
            field = amplitude * np.exp(2j * np.pi * stroke * phase[np.ix_(lit_v, lit_u)])
            predicted = np.abs(wave_y @ field.astype(np.complex64) @ wave_x) ** 2
            match = match_speckle(upright[window], predicted, inside, reach_px=_REACH_PX, around_px=_AROUND_PX)
            if best is None or match.correlation > best.correlation:
                best = match
    return replace(placement, speckle=best)


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
