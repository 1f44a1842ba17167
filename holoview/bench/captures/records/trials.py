"""How well captures are predicted under a hypothesis on their records: the correlation of speckle.

Changes of brightness and position by the bench must not count. A picture therefore becomes its contrast: the square
root of the light, divided by its blurred background. Beams, vignetting and the laser's power drop out, and few bright
grains don't dominate. Contrasts are compared at several blurs and at all small shifts. With p and q the power
spectra of two unrelated contrasts, each normalised to a sum of 1, the correlation ρ has the variance

    var ρ = κ · Σ_f p(f)·q(f) = 1/G,   κ = N·Σw⁴/(Σw²)²

(Bartlett's formula in the frequency domain; κ accounts for the window w on N pixels). G is the number of independent
speckle grains, and z = atanh ρ (Fisher) has the variance 1/G for any ρ.

`SpeckleComparison` compares two pictures, `TrialScore` holds the comparisons of one hypothesis, and `Trials` predicts
the captures under each hypothesis, every prediction once.

`central_captures` cuts captures to their middle: large modulators and many captures then cost no more to compare than
small ones.

In the near field light walks off sideways by distance × the sine of the steepest ray that the stops pass. With as much
margin around the compared pixels, a crop is predicted like the whole. On a Fourier bench every camera pixel sees all of
the modulator, whose levels can't be cut, nor binned, since phases wrap. But a Fourier sum is computed at any window of
the camera alone, so that a crop of the picture is predicted exactly.

Crops are centred on the axis, so that mirrored or turned records stay mirrored or turned.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.dataset import Captures, Floats
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.prepared_captures import stuck_pixel_mask
from holoview.bench.captures.records.corrections import CameraOrientation, Hypothesis, apply_corrections
from holoview.light.numerics.sampling import taper
from holoview.util.errors import UserError
from holoview.util.processes import process_cpu_count


def central_region(captures: Captures, side_px: int, further_px: int = 0) -> Captures:
    """The captures cut to about `side_px` modulator pixels across, with the margin beside.

    further_px: more margin, for light that hard edges of a stop spread beyond its steepest ray. On a Fourier bench the
    pictures are cut to as many speckles of the longest wavelength across, with the margin on either side.
    """
    if captures.is_fourier:
        shape = _speckles_px(captures, side_px + 2 * further_px)
        return captures if shape == captures.shape else cut_pictures(captures, picture_window(captures, shape))
    if captures.chain is not None:  # whose elements differ in shape
        return captures
    pitch_m = captures.slms[0].pitch_m
    margin = math.ceil(_walk_off_m(captures) / pitch_m) + further_px
    rows, columns = (_kept(n, side_px + 2 * margin) for n in captures.levels.shape[2:])
    if (rows, columns) == captures.levels.shape[2:]:
        return captures
    scale = pitch_m / captures.camera.pitch_m
    seen = [
        _kept(n, math.floor((kept - 2 * margin) * scale) if kept < whole else n)
        for n, kept, whole in zip(captures.shape, (rows, columns), captures.levels.shape[2:], strict=True)
    ]
    return cut_out(captures, (rows, columns), (seen[0], seen[1]))[0]


def cut_out(
    captures: Captures, shape: tuple[int, int], seen: tuple[int, int], offset: tuple[int, int] = (0, 0)
) -> tuple[Captures, tuple[slice, slice]]:
    """A part of modulators and pictures, and the rows and columns of its pictures in the present ones.

    shape, seen: (rows, columns) of its modulators and of its pictures. offset: (y, x) modulator pixels from the present
    centre to that of the part. Pictures are cut at the nearest camera pixel, and the rest is in `Captures.axis_m`.
    """
    pitch_m = captures.slms[0].pitch_m
    whole, scale = (captures.levels.shape[2], captures.levels.shape[3]), pitch_m / captures.camera.pitch_m
    part = (..., *central_slices(whole, shape, offset))
    offset_px = math.floor(offset[0] * scale + 0.5), math.floor(offset[1] * scale + 0.5)
    of_pictures = central_slices(captures.shape, seen, offset_px)
    before, first = captures.levels_before, captures.levels_first
    y, x = (there + n * pitch_m for there, n in zip(captures.centre_m, offset, strict=True))
    rest_px = (round(n * scale - px, _PLACE_DIGITS) for n, px in zip(offset, offset_px, strict=True))
    axis_y, axis_x = (a + px * captures.camera.pitch_m for a, px in zip(captures.axis_m, rest_px, strict=True))
    cut = captures.with_pictures(
        lambda pictures: pictures[..., *of_pictures],
        levels=captures.levels[part],
        levels_before=None if before is None else before[part],
        levels_first=None if first is None else first[part],
        frame=captures.frame or captures.shape,
        slm_frame=captures.slm_frame or whole,
        centre_m=(y, x),
        axis_m=(axis_y, axis_x),
    )
    return cut, of_pictures


def speckle_px(captures: Captures) -> tuple[float, float]:
    """Width (y, x) of a speckle of the longest wavelength on a Fourier bench, λf/(width of the modulator), in pixels.

    At least 1, because one pixel sees a smaller speckle.
    """
    light = float(captures.wavelength_m.max()) * (captures.focal_length_m or 0.0) / captures.camera.pitch_m
    y, x = (max(1.0, light / (n * captures.slms[0].pitch_m)) for n in captures.levels.shape[2:])
    return y, x


def _speckles_px(captures: Captures, count: int) -> tuple[int, int]:
    """The pixels (rows, columns) that so many speckles of a Fourier bench take, at most all."""
    rows, columns = (
        _kept(n, math.ceil(count * px)) for n, px in zip(captures.shape, speckle_px(captures), strict=True)
    )
    return rows, columns


def cut_pictures(captures: Captures, window: tuple[slice, slice]) -> Captures:
    """The captures of a Fourier bench with pictures cut to a window, which keeps its place in the whole pictures."""
    pitch_m = captures.camera.pitch_m
    beside = [(part.start + part.stop - n) / 2 * pitch_m for part, n in zip(window, captures.shape, strict=True)]
    return captures.with_pictures(
        lambda pictures: pictures[..., *window],
        frame=captures.frame or captures.shape,
        centre_m=(captures.centre_m[0] + beside[0], captures.centre_m[1] + beside[1]),
        axis_m=(captures.axis_m[0] - beside[0], captures.axis_m[1] - beside[1]),
    )


def picture_window(captures: Captures, shape: tuple[int, int]) -> tuple[slice, slice]:
    """The rows and columns of pictures in which causes are looked for: the middle, if pixels there count.

    Where some are left out, the place where the most count, of equal ones the nearest to the middle.
    """
    middle = central_slices(captures.shape, shape)
    if captures.usable is None:
        return middle
    sums = np.pad(captures.usable.sum(axis=0, dtype=np.int64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    (rows, columns) = shape
    counts = sums[rows:, columns:] - sums[:-rows, columns:] - sums[rows:, :-columns] + sums[:-rows, :-columns]
    y, x = np.nonzero(counts == counts.max())
    nearest = int(np.argmin((y - middle[0].start) ** 2 + (x - middle[1].start) ** 2))
    top, left = int(y[nearest]), int(x[nearest])
    return slice(top, top + rows), slice(left, left + columns)


def central_captures(captures: Captures, most: int) -> Captures:
    """The captures without those at either end, if there are more than about `most`.

    Neighbours stay neighbours, and a column from the last to the first stays one.
    """
    count = _kept(len(captures), most)
    first = (len(captures) - count) // 2
    return captures if count == len(captures) else captures.subset(range(first, first + count))


def _walk_off_m(captures: Captures) -> float:
    """Largest sideways walk of a ray from the first modulator to the camera."""
    pitch_m, longest = captures.slms[0].pitch_m, float(captures.wavelength_m.max())
    paths = ((captures.gap_m or 0.0, captures.relay1), (float(captures.distance_m.max()), captures.relay2))
    return sum(length * relay.first_order_sine(longest, pitch_m) for length, relay in paths if length)


def _kept(n: int, wanted: int) -> int:
    """At most `wanted` of n pixels, with as many left out on either side."""
    return n if wanted >= n else wanted + (n - wanted) % 2


def central_slices(
    whole: tuple[int, ...], kept: tuple[int, int], offset: tuple[int, int] = (0, 0)
) -> tuple[slice, slice]:
    """Rows and columns of the middle `kept` of `whole` pixels, or of a part by an offset (y, x) from there."""
    first = [(n - k) // 2 + by for n, k, by in zip(whole, kept, offset, strict=True)]
    return slice(first[0], first[0] + kept[0]), slice(first[1], first[1] + kept[1])


# --- trials -----------------------------------------------------------------------------------------------------------


Values = Mapping[str, Mapping[str, float]]


class _Key(NamedTuple):
    """What a prediction depends on: the patterns' digest, wavelength, distance and shape of the camera."""

    levels: bytes
    wavelength_m: float
    distance_m: float
    shape: tuple[int, int]


BLURS_PX = (0.7, 1.5, 3.0)
"""[px] Blurs of the compared pictures, which have about `SIDE_PX` rows. Evidence: factors of two from the pixel to the
grains of smooth patterns."""

SIDE_PX = 64
"""[px] Pictures are binned until the shorter side has fewer than twice as many pixels. Evidence: the cost; a grain of a
smooth pattern is a tenth of the picture."""

BACKGROUND = 0.125
"""[1] Blur of the background that is divided out, over the shorter side. Evidence: wider than grains, narrower than a
beam or vignetting."""

MAX_SHIFT = 0.08
"""[1] Movement of the pictures that doesn't count, over the shorter side. Evidence: beyond the shifts of misaligned
cameras and tilted light in the search study."""

TAPER = 0.08
"""[1] Width of the soft edge of the compared region, over the side. Evidence: as `MAX_SHIFT`, so that a moved picture
compares inside."""

FALSE_ALARMS = 1e-6
"""[1] Probability that pictures without any relation to the patterns show one of all tried corrections as better.
Evidence: a thousand sets of captures a day for a year give less than one."""

_PLACE_DIGITS = 6  # [px] After the point, of a place in pixels: a part at whole ones is exactly there
_MAX_CORRELATION = 0.9999  # atanh of 1 is infinite
_CACHE_MB = 64  # of each thread's predictor
_WAITING_BYTES = 256e6  # of rows that wait until they are predicted together
_MAX_THREADS = 4


@dataclass(frozen=True, eq=False)
class Contrast:
    """Spectra of one picture's contrast at every blur, (blur, y, x), of norm 1, and their powers."""

    spectra: NDArray[np.complex64]

    @cached_property
    def powers(self) -> NDArray[np.float32]:
        """|spectrum|², whose sum is 1 at each blur."""
        return np.square(np.abs(self.spectra))


@dataclass(frozen=True, eq=False)
class Match:
    """z = atanh ρ of one picture at every blur and shift, (blur, dy, dx); grains: G at each blur."""

    fisher_z: Floats
    grains: Floats


class SpeckleComparison:
    """Compares pictures of one shape (rows, columns)."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._bin = max(1, min(shape) // SIDE_PX)
        self.shape = (shape[0] // self._bin, shape[1] // self._bin)
        self._window = np.outer(*(taper(n, TAPER) for n in self.shape)).astype(np.float32)
        fy, fx = (scipy.fft.fftfreq(n) for n in self.shape)
        squared = fy[:, None] ** 2 + fx[None, :] ** 2
        blurs = np.array(BLURS_PX)[:, None, None]
        self._blur = np.exp(-2 * (np.pi * blurs) ** 2 * squared).astype(np.float32)
        w2 = np.square(self._window, dtype=np.float64)
        self._window_factor = w2.size * float(np.square(w2).sum()) / float(w2.sum()) ** 2
        reach = max(1, round(MAX_SHIFT * min(self.shape)))
        shifts = np.arange(-reach, reach + 1)
        self._to_rows = torch.from_numpy(np.exp(2j * np.pi * np.outer(shifts, fy)).astype(np.complex64))
        self._to_columns = torch.from_numpy(np.exp(2j * np.pi * np.outer(fx, shifts)).astype(np.complex64))

    def contrast(self, light: NDArray[np.floating]) -> Contrast:
        """The contrast of a picture of light (y, x) in any unit; without light it is zero."""
        rows, columns = (n * self._bin for n in self.shape)
        binned = light[:rows, :columns].reshape(self.shape[0], self._bin, self.shape[1], self._bin).mean(axis=(1, 3))
        amplitude = np.sqrt(np.maximum(binned, 0.0)).astype(np.float32)
        background = gaussian_filter(amplitude, BACKGROUND * min(self.shape), mode="nearest")
        floor = 1e-3 * float(background.max()) + 1e-30
        contrast = (amplitude - background) / np.maximum(background, floor)
        contrast -= np.average(contrast, weights=self._window)
        spectra = scipy.fft.fft2(contrast * self._window)[None] * self._blur
        norm = np.sqrt(np.square(np.abs(spectra)).sum(axis=(1, 2), keepdims=True))
        return Contrast((spectra / np.maximum(norm, 1e-30)).astype(np.complex64))

    def match(self, seen: Contrast, predicted: Contrast) -> Match:
        """The correlation at every shift of the seen picture.

        torch multiplies the matrices, because its threads are chosen where the work is: numpy's threads wait for each
        other most of the time where arrays are as small as these and other programs run.
        """
        cross = torch.from_numpy(np.conj(predicted.spectra) * seen.spectra)
        correlation = (self._to_rows @ cross @ self._to_columns).real.double().numpy()
        variance = self._window_factor * np.einsum("byx,byx->b", seen.powers, predicted.powers, dtype=np.float64)
        clipped = np.clip(correlation, -_MAX_CORRELATION, _MAX_CORRELATION)
        return Match(np.arctanh(clipped), 1.0 / np.maximum(variance, 1e-12))

    @property
    def shift_count(self) -> int:
        """How many shifts are tried."""
        return len(self._to_rows) ** 2


@dataclass(frozen=True, eq=False)
class TrialScore:
    """How well some captures are predicted under a hypothesis.

    fisher_z: atanh of the correlation of each capture at the common shift that fits all of them best, (capture, blur).
    grains: independent speckle grains, (capture, blur).
    """

    hypothesis: Hypothesis
    fisher_z: Floats
    grains: Floats

    @property
    def significance(self) -> Floats:
        """Mean z in standard deviations of unrelated pictures, for each blur."""
        total = self.grains.sum(axis=0)
        return (self.fisher_z * self.grains).sum(axis=0) / np.sqrt(total)

    @property
    def best_blur(self) -> int:
        """The blur at which the prediction is most significant."""
        return int(self.significance.argmax())

    @property
    def correlation(self) -> float:
        """Mean correlation at the best blur."""
        return float(np.tanh(self.fisher_z[:, self.best_blur].mean()))

    def gain_over(self, other: TrialScore) -> tuple[float, float]:
        """(mean gain in z, the same in standard deviations) over another hypothesis on the same captures.

        At this hypothesis's best blur. Unrelated predictions scatter with 1/G each.
        """
        blur = self.best_blur
        weight = 1.0 / (1.0 / self.grains[:, blur] + 1.0 / other.grains[:, blur])
        gain = float(((self.fisher_z[:, blur] - other.fisher_z[:, blur]) * weight).sum() / weight.sum())
        return gain, gain * float(np.sqrt(weight.sum()))

    def gains_over(self, other: TrialScore) -> Floats:
        """The gain of each capture and blur in standard deviations, (capture, blur)."""
        return (self.fisher_z - other.fisher_z) / np.sqrt(1.0 / self.grains + 1.0 / other.grains)


class Trials:
    """Predictions of captures for all hypotheses, each computed once.

    captures: as recorded. effects: of the nominal bench.
    """

    def __init__(self, captures: Captures, effects: Values) -> None:
        self.captures, self._effects = captures, effects
        light = captures.images.astype(np.float32) - np.float32(captures.camera.black_level)
        left_out = np.broadcast_to(stuck_pixel_mask(captures.images), light.shape)
        if captures.usable is not None:
            left_out = left_out | ~captures.usable
        self._light = _filled(light, left_out)
        without_pictures = np.broadcast_to(np.uint16(0), captures.images.shape)
        self._records = dataclasses.replace(captures, images=without_pictures, usable=None)
        self._comparisons: dict[tuple[int, int], SpeckleComparison] = {}
        self._predicted: dict[_Key, Contrast | None] = {}
        self._seen: dict[tuple[int, str], Contrast] = {}
        self._threads = min(process_cpu_count(), _MAX_THREADS)

    def score(self, hypotheses: Sequence[Hypothesis], indices: Sequence[int]) -> list[TrialScore]:
        """The score of each hypothesis on these pictures, in the order given.

        Hypotheses that no bench can have are left out.
        """
        keys = self._predict(hypotheses, indices)
        scores = []
        for hypothesis, of_one in zip(hypotheses, keys, strict=True):
            matches = [self._match(hypothesis, key, k) for key, k in zip(of_one, indices, strict=True)]
            known = [match for match in matches if match is not None]
            if len(known) == len(matches):
                scores.append(_at_common_shift(hypothesis, known))
        return scores

    @property
    def shift_count(self) -> int:
        """How many shifts a comparison tries."""
        return self._comparison(self.captures.shape).shift_count

    def coarseness(self, k: int) -> float:
        """Mean squared spatial frequency of a picture's contrast: small for smooth pictures, infinite for even ones."""
        power = self._contrast_seen((), k).powers[0]
        if not power.any():
            return np.inf
        fy, fx = (np.fft.fftfreq(n) for n in power.shape)
        return float(((fy[:, None] ** 2 + fx[None] ** 2) * power).sum() / max(float(power.sum()), 1e-30))

    def differing(self, first: Hypothesis, second: Hypothesis) -> list[int]:
        """The captures whose prediction or picture differs between two hypotheses."""
        every = range(len(self.captures))
        rows = [self._rows(one, every) for one in (first, second)]
        differ = _camera_orientations(first) != _camera_orientations(second)
        return [k for k, a, b in zip(every, *rows, strict=True) if differ or _key(a) != _key(b)]

    def _rows(self, hypothesis: Hypothesis, indices: Sequence[int]) -> list[Captures]:
        corrected = apply_corrections(self._records, hypothesis)
        return [corrected.subset([k]) for k in indices]

    def _comparison(self, shape: tuple[int, int]) -> SpeckleComparison:
        if shape not in self._comparisons:
            self._comparisons[shape] = SpeckleComparison(shape)
        return self._comparisons[shape]

    def _match(self, hypothesis: Hypothesis, key: _Key, k: int) -> Match | None:
        predicted = self._predicted[key]
        if predicted is None:
            return None
        return self._comparison(key.shape).match(self._contrast_seen(hypothesis, k), predicted)

    def _contrast_seen(self, hypothesis: Hypothesis, k: int) -> Contrast:
        orientations = _camera_orientations(hypothesis)
        key = (k, " ".join(c.choice for c in orientations))
        if key not in self._seen:
            light = self._light[k]
            for camera in orientations:
                light = camera.undone(light)
            self._seen[key] = self._comparison((light.shape[0], light.shape[1])).contrast(light)
        return self._seen[key]

    def _predict(self, hypotheses: Sequence[Hypothesis], indices: Sequence[int]) -> list[list[_Key]]:
        """Computes the contrasts that aren't known yet; returns the keys of each hypothesis's rows.

        A few hypotheses at a time, since rows of large modulators take some megabytes each.
        """
        keys, waiting, held = list[list[_Key]](), dict[_Key, Captures](), 0
        for hypothesis in hypotheses:
            rows = self._rows(hypothesis, indices)
            keys.append([_key(row) for row in rows])
            for key, row in zip(keys[-1], rows, strict=True):
                if key not in self._predicted and key not in waiting:
                    waiting[key] = row
                    held += row.levels.nbytes + row.images.nbytes
            if held > _WAITING_BYTES:
                self._predict_rows(waiting)
                waiting, held = {}, 0
        self._predict_rows(waiting)
        return keys

    def _predict_rows(self, rows: Mapping[_Key, Captures]) -> None:
        """Computes the contrasts of rows, those of one camera shape together."""
        for shape in dict.fromkeys(key.shape for key in rows):
            comparison, keys = self._comparison(shape), [key for key in rows if key.shape == shape]
            parts = [keys[n :: self._threads] for n in range(min(self._threads, len(keys)))]
            with ThreadPoolExecutor(len(parts)) as pool:
                jobs = [[rows[key] for key in part] for part in parts]
                contrasts = list(pool.map(partial(_predict_contrasts, self._effects, comparison), jobs))
            for part, found in zip(parts, contrasts, strict=True):
                self._predicted.update(zip(part, found, strict=True))


def _predict_contrasts(
    effects: Values, comparison: SpeckleComparison, rows: Sequence[Captures]
) -> list[Contrast | None]:
    """The predicted picture of each row; None for a wavelength or distance that no bench can have."""
    predictor = Predictor(_stack(rows), cache_mb=_CACHE_MB)
    contrasts: list[Contrast | None] = []
    for number in range(len(rows)):
        try:
            signal = predictor([number], effects).signal[0].numpy()
        except UserError:
            contrasts.append(None)
            continue
        contrasts.append(comparison.contrast(signal))
    return contrasts


def _camera_orientations(hypothesis: Hypothesis) -> list[CameraOrientation]:
    return [c for c in hypothesis if isinstance(c, CameraOrientation)]


def _key(row: Captures) -> _Key:
    digest = hashlib.sha256(row.levels.tobytes()).digest()
    return _Key(digest, float(row.wavelength_m[0]), float(row.distance_m[0]), row.shape)


def _stack(rows: Sequence[Captures]) -> Captures:
    """Captures of several rows of one capture each, with unit power and exposure."""
    first, ones = rows[0], np.ones(len(rows))
    return dataclasses.replace(
        first,
        levels=np.concatenate([row.levels for row in rows]),
        images=np.broadcast_to(first.images, (len(rows), *first.shape)),
        wavelength_m=np.concatenate([row.wavelength_m for row in rows]),
        distance_m=np.concatenate([row.distance_m for row in rows]),
        power=ones,
        exposure_s=ones,
    )


def _at_common_shift(hypothesis: Hypothesis, matches: Sequence[Match]) -> TrialScore:
    z, grains = np.stack([m.fisher_z for m in matches]), np.stack([m.grains for m in matches])
    total = np.einsum("kbyx,kb->byx", z, grains)
    best = total.reshape(total.shape[0], -1).argmax(axis=1)
    at_best = np.take_along_axis(z.reshape(*z.shape[:2], -1), best[None, :, None], axis=2)[..., 0]
    return TrialScore(hypothesis, at_best, grains)


def _filled(light: NDArray[np.float32], left_out: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Pictures (capture, y, x) with their surroundings in pixels that are left out, whose contrast nobody predicts."""
    if not left_out.any():
        return light
    light = light.copy()
    for picture, unknown in zip(light, left_out, strict=True):
        sigma_px, known = BACKGROUND * min(picture.shape), (~unknown).astype(np.float32)
        share = gaussian_filter(known, sigma_px, mode="nearest")
        around = gaussian_filter(picture * known, sigma_px, mode="nearest") / np.maximum(share, 1e-6)
        mean = picture[~unknown].mean() if not unknown.all() else 0.0
        picture[unknown] = np.where(share > 0.01, around, mean)[unknown]
    return light
