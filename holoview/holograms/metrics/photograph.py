"""Photographs of a real bench as light: counts above black, the noise of the camera's pixels, what is saturated.

A photograph holds the speckle and the camera: its black level, shot and read noise, saturation, and the encoding of its
file. A dark picture (or several) tells black level and read noise, a data sheet or the photograph itself
(`numerics.photon_transfer`) the electrons a count. What isn't known is refused or said, never assumed in silence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import gammainc, gammaincc, gammaln

from holoview.holograms.files.image_reader import file_format, read_raster
from holoview.holograms.files.raster import Raster
from holoview.holograms.metrics.grains import ContrastEstimate, PixelNoise, grains_of
from holoview.holograms.metrics.speckle import Floats, SpecklePattern
from holoview.holograms.metrics.speckle_measurement import LaserImages, images_of_lasers
from holoview.light.colour import SRGB_TO_XYZ, observer_weights, srgb_decode
from holoview.light.model.fields import (
    FileContent,
    Maybe,
    Number,
    Several,
    Truth,
    Word,
    described_field,
    flag_of,
    validate,
    with_field_docs,
)
from holoview.light.numerics.photon_transfer import PhotonTransfer, transfer_of_pictures, transfer_of_repeats
from holoview.light.numerics.sample_bits import find_clipping
from holoview.light.numerics.sampling import Region, region_slices
from holoview.util.errors import UserError

MOST_SATURATED = 1e-3
"""Share of saturated pixels up to which a contrast is hardly changed: that of C = 1 by less than 1 %."""

_LEAST_LIGHT, _MOST_FITTED = 0.02, 200_000
_CHANNELS = ("red", "green", "blue")


@with_field_docs
@dataclass(frozen=True)
class CameraStatements:
    """What the user says of the camera of a photograph. Raises UserError for numbers out of range.

    Fields:
    """

    dark: tuple[Path, ...] = described_field(
        Several(FileContent()), "Pictures without light: black level and read noise.", default=()
    )
    black: float | None = described_field(
        Maybe(Number()), "The black level in counts, in place of --dark.", default=None
    )
    electrons_per_count: float | None = described_field(
        Maybe(Number(low=1e-9, high=1e9)), "Electrons a count; estimated if absent.", flag="gain", default=None
    )
    read_noise_electrons: float | None = described_field(
        Maybe(Number(low=0, high=1e9)),
        "Electrons r.m.s.; if absent, of --dark or of the photograph.",
        flag="read-noise",
        default=None,
    )
    repeat: Path | None = described_field(
        Maybe(FileContent()), "The same light once more, from which the gain is estimated.", default=None
    )
    is_linear: bool = described_field(
        Truth(), "An integer picture holds intensity, not an sRGB signal.", flag="linear", default=False
    )
    is_encoded: bool = described_field(
        Truth(), "Its numbers are an sRGB signal, which is undone.", flag="encoded", default=False
    )
    saturation: str = described_field(
        Word(("refuse", "keep", "undo")),
        "Of more than 0.1 % of the region: refuse it, keep it, or undo it by the law that fits the rest.",
        default="refuse",
    )
    accepts_jpeg: bool = described_field(
        Truth(), "Measure a JPEG all the same, whose blocks change speckle.", flag="jpeg", default=False
    )

    def __post_init__(self) -> None:
        validate(self, flag_of)


@dataclass(frozen=True, eq=False)
class Photograph:
    """Counts above black.

    light: (y, x) or (y, x, 3). saturated: (y, x), where a channel is. level: counts above black from which it is; None
    where nothing is. noise: of the pixels of each channel. notes: what was taken or estimated, as sentences.
    """

    name: str
    light: Floats
    saturated: NDArray[np.bool_]
    level: float | None
    noise: PixelNoise | None
    notes: tuple[str, ...] = field(default=())

    @property
    def luminance(self) -> Floats:
        """(y, x): the counts of a grey picture, or the luminance of one in colour, taken as linear sRGB."""
        return self.light if self.light.ndim == 2 else np.asarray(self.light @ SRGB_TO_XYZ[1])

    @property
    def luminance_noise(self) -> PixelNoise | None:
        """The noise of `luminance`: of a sum Σ w·s, Σ w²·(s/g + r²), at the mean light."""
        if self.noise is None or self.light.ndim == 2:
            return self.noise
        weights, means = SRGB_TO_XYZ[1], np.maximum(self.light.mean(axis=(0, 1)), 0.0)
        factor = float(np.square(weights) @ means / max(float(weights @ means), 1e-30))
        known = self.noise.electrons_per_count
        gain = None if known is None or factor == 0 else known / factor  # a black picture has no shot noise
        return PixelNoise(gain, self.noise.read_noise_counts * float(np.linalg.norm(weights)), self.noise.gain_error)

    @property
    def channels(self) -> LaserImages | None:
        """Red, green and blue of a picture in colour."""
        if self.light.ndim == 2:
            return None
        return LaserImages(_CHANNELS, _CHANNELS, SRGB_TO_XYZ.T, np.moveaxis(self.light, -1, 0), noise=self.noise)


def require_picture_of_camera(path: Path, accepts_jpeg: bool) -> None:
    """Raises UserError for a JPEG, whose blocks change speckle, unless it is accepted."""
    if file_format(path) == "JPEG" and not accepts_jpeg:
        raise UserError(
            str(path),
            "is a JPEG: its blocks of 8 × 8 pixels are rounded and change speckle",
            expected="PNG or TIFF as the camera wrote it",
            remedy="--jpeg measures it all the same",
        )


def read_photograph(path: Path, statements: CameraStatements) -> Photograph:
    """A photograph as light.

    Raises UserError for a JPEG and an encoded signal unless accepted, a black level that nothing tells, dark pictures
    or a repeat of another size, a read noise without a gain, and files that can't be read.
    """
    require_picture_of_camera(path, statements.accepts_jpeg)
    if statements.dark and statements.black is not None:
        raise UserError("--dark", "with --black", expected="one of them")
    if not statements.dark and statements.black is None:
        remedy = "give --dark DARK.tiff, taken with the lasers off, or --black COUNTS (0 if it was taken off)"
        raise UserError(str(path), "a black level that nothing tells", expected="a dark picture", remedy=remedy)
    raster = read_raster(path)
    counts, notes = _counts(path, raster, statements)
    darks = [_other_counts(file, "a dark picture", path, counts.shape, statements) for file in statements.dark]
    black, dark_variance = _black(darks, statements)
    light = counts - black
    saturated, level = _saturation(raster, counts, float(np.mean(black)))
    noise, told = _noise(path, light, saturated, dark_variance, statements, black)
    return Photograph(path.name, light, saturated, level, noise, (*raster.notes, *notes, *told))


def _counts(path: Path, raster: Raster, statements: CameraStatements) -> tuple[Floats, tuple[str, ...]]:
    """The numbers of a picture, (y, x) or (y, x, 3), linear in light."""
    values = raster.values[..., 0] if raster.values.shape[-1] == 1 else raster.values
    scale = float(raster.white or 255) if raster.encoded else 1.0
    if statements.is_linear and statements.is_encoded:
        raise UserError("--linear", "with --encoded", expected="one of them")
    if statements.is_encoded:
        if not raster.encoded:
            raise UserError("--encoded", f"with {path.name}, which holds light", expected="whole numbers")
        return srgb_decode(values) * scale, ("its sRGB curve was undone",)
    is_signal = raster.encoded and (raster.white is None or raster.profile is not None)
    if is_signal and not statements.is_linear:
        what = f"in the colour space {raster.profile.title}" if raster.profile else "of 8 bits"
        remedy = "--linear if they are the camera's counts, --encoded to undo an sRGB curve"
        raise UserError(str(path), f"whole numbers {what}, which are likely encoded", expected="light", remedy=remedy)
    if raster.encoded and not statements.is_linear:
        return values * scale, ("its numbers are taken as linear in light",)
    return values * scale, ()


def _other_counts(
    path: Path, what: str, photograph: Path, shape: tuple[int, ...], statements: CameraStatements
) -> Floats:
    """A further picture beside a photograph of a shape. what: it is. Raises UserError for one of another size."""
    require_picture_of_camera(path, statements.accepts_jpeg)
    raster = read_raster(path)
    values = raster.values[..., 0] if len(shape) == 2 and raster.values.shape[-1] == 1 else raster.values
    if values.shape != shape:
        raise UserError(str(path), f"{what} of {_size(values.shape)}", expected=f"{_size(shape)}, as {photograph} has")
    if statements.is_encoded:
        values = srgb_decode(values)
    return values * (float(raster.white or 255) if raster.encoded else 1.0)


def _size(shape: tuple[int, ...]) -> str:
    colours = "" if len(shape) == 2 else f" in {shape[2]} channels"
    return f"{shape[1]} × {shape[0]} pixels{colours}"


def _black(darks: Sequence[Floats], statements: CameraStatements) -> tuple[Floats | float, float | None]:
    """The black level, and the variance of a photograph's pixels about it, None where no dark picture tells.

    Of one dark picture the level is its mean, and the variance that of its pixels, fixed pattern included; of several
    each pixel has its own level, and the variance is that of read noise, once in the photograph and once in the level.
    """
    if not darks:
        return float(statements.black or 0.0), None
    if len(darks) == 1:
        return float(darks[0].mean()), float(darks[0].var())
    stack = np.stack(darks)
    read = float(stack.var(axis=0, ddof=1).mean())
    return stack.mean(axis=0), read * (1 + 1 / len(darks))


def _saturation(raster: Raster, counts: Floats, black: float) -> tuple[NDArray[np.bool_], float | None]:
    """Which pixels are saturated in a channel, and from which count above black."""
    levels = [clip.level for channel in np.moveaxis(np.atleast_3d(counts), -1, 0) if (clip := find_clipping(channel))]
    if raster.encoded:
        levels.append(float(raster.white or 255))
    if not levels:
        return np.zeros(counts.shape[:2], dtype=bool), None
    level = min(levels)
    saturated: NDArray[np.bool_] = np.asarray(np.atleast_3d(counts >= level * (1 - 1e-12)).any(axis=-1))
    return saturated, level - black if saturated.any() else None


def _noise(
    path: Path,
    light: Floats,
    saturated: NDArray[np.bool_],
    dark_variance: float | None,
    statements: CameraStatements,
    black: Floats | float,
) -> tuple[PixelNoise | None, list[str]]:
    """The noise of the pixels as stated or estimated, and how it is known."""
    gain, gain_error, notes = statements.electrons_per_count, 0.0, list[str]()
    if statements.is_encoded:
        if gain is not None or statements.read_noise_electrons is not None:
            raise UserError("--gain", "with --encoded", expected="counts that are linear in light")
        return None, ["the shot noise of an encoded picture isn't taken off"]
    read_variance = dark_variance
    if statements.read_noise_electrons is not None:
        if gain is None:
            raise UserError("--read-noise", "without --gain", expected="both: read noise is in electrons")
        read_variance = (statements.read_noise_electrons / gain) ** 2 + 1 / 12
    if gain is None:
        found = _transfer(path, light, saturated, statements, black)
        if found is None:
            notes.append(
                "the electrons a count can't be told from the picture: shot noise isn't taken off, and the contrast "
                "comes out too high; state --gain, or give a second picture of the same light as --repeat"
            )
        else:
            gain, gain_error = found.electrons_per_count, found.relative_error
            notes.append(f"{gain:.3g} electrons a count, ± {100 * gain_error:.0f} %, estimated from the noise itself")
            if read_variance is None:
                read_variance = found.read_noise_counts**2 + 1 / 12
    if read_variance is None:
        read_variance = 1 / 12
        notes.append("no dark picture and no --read-noise: read noise isn't taken off")
    return PixelNoise(gain, math.sqrt(read_variance), gain_error), notes


def _transfer(
    path: Path, light: Floats, saturated: NDArray[np.bool_], statements: CameraStatements, black: Floats | float
) -> PhotonTransfer | None:
    """Electrons a count from a second picture, or from the highest frequencies of this one; of green in colour.

    Raises UserError for a second picture of another size, and for a copy.
    """
    grey = light if light.ndim == 2 else light[..., 1]
    if statements.repeat is None:
        return transfer_of_pictures([grey], [~saturated])
    second = _other_counts(statements.repeat, "a picture", path, light.shape, statements) - black
    if np.array_equal(second, light):
        found = f"the same numbers as {path}"
        raise UserError(
            str(statements.repeat), found, expected="a second picture of the same light, with its own noise"
        )
    return transfer_of_repeats(grey, second if light.ndim == 2 else second[..., 1], ~saturated)


def check_saturation(photograph: Photograph, region: Region, statements: CameraStatements) -> tuple[str, ...]:
    """A sentence on saturated pixels in a region, none without any.

    Raises UserError for more than `MOST_SATURATED` of them unless they are to be kept or undone.
    """
    share = float(photograph.saturated[region_slices(region)].mean())
    if share == 0:
        return ()
    said = f"{share:.2%} of the region is saturated"
    if share <= MOST_SATURATED:
        return (f"{said}, which hardly matters",)
    if statements.saturation == "refuse":
        remedy = "expose less; --saturation undo fits the law of speckle to the rest, keep measures as it is"
        raise UserError(photograph.name, said, expected=f"at most {MOST_SATURATED:.1%}", remedy=remedy)
    if statements.saturation == "keep":
        return (f"{said}: the contrast comes out too low",)
    return (f"{said}: the contrast is that of the gamma law that fits the other pixels best",)


def censored_estimate(pattern: SpecklePattern, level: float) -> ContrastEstimate:
    """The contrast of speckle whose bright pixels are saturated, by the gamma law that is likeliest.

    level: intensity from which a pixel is saturated, in the unit of the image. Pixels below 2 % of the mean count as
    that dark, no more: noise spoils their logarithm. With shape N the contrast is 1/√N; the standard error follows from
    the curvature of the likelihood, n grains counting as n samples. Raises UserError where hardly a pixel isn't
    saturated.
    """
    values = pattern.counted / pattern.contrast.mean
    limits = np.broadcast_to(level / (np.asarray(pattern.unit) * pattern.contrast.mean), pattern.values.shape)
    limits = limits[pattern.usable]
    step = max(1, values.size // _MOST_FITTED)
    values, limits = values[::step], limits[::step]
    is_bright, is_dark = values >= limits * (1 - 1e-9), values < _LEAST_LIGHT
    between = values[~is_bright & ~is_dark]
    if np.unique(between).size < 2:
        raise UserError(
            "region",
            "no two levels between the dark and the saturated",
            expected="light that varies",
            remedy="expose less",
        )
    sums = between.size, float(np.log(between).sum()), float(between.sum())
    bright, dark = np.unique(limits[is_bright], return_counts=True), int(is_dark.sum())

    def cost(logarithms: Floats) -> float:
        shape, rate = math.exp(logarithms[0]), math.exp(logarithms[0] - logarithms[1])
        likely = sums[0] * (shape * math.log(rate) - float(gammaln(shape))) + (shape - 1) * sums[1] - rate * sums[2]
        likely += float(bright[1] @ np.log(np.maximum(gammaincc(shape, rate * bright[0]), 1e-300)))
        likely += dark * math.log(max(float(gammainc(shape, rate * _LEAST_LIGHT)), 1e-300))
        return -likely / values.size

    start = np.array([math.log(pattern.contrast.contrast**-2), 0.0])
    options = {"xatol": 1e-6, "fatol": 1e-12, "maxiter": 2000}
    found = minimize(cost, start, method="Nelder-Mead", options=options).x
    contrast, grains = math.exp(-found[0] / 2), grains_of(pattern)
    covariance = np.linalg.pinv(_curvature(cost, found)) / grains.count
    return ContrastEstimate(contrast, contrast / 2 * math.sqrt(max(covariance[0, 0], 0.0)), grains)


def _curvature(cost: Callable[[Floats], float], at: Floats, step: float = 1e-3) -> Floats:
    """Second derivatives (n, n) of a function by central differences."""
    steps = step * np.eye(len(at))
    return np.array(
        [
            [(cost(at + a + b) - cost(at + a - b) - cost(at - a + b) + cost(at - a - b)) / (4 * step**2) for b in steps]
            for a in steps
        ]
    )


def photographs_of_lasers(photographs: Sequence[Photograph], wavelengths_m: Sequence[float]) -> LaserImages:
    """Photographs of the lasers one by one, by a grey camera whose response is taken as equal for all.

    The noise is that of the photograph whose gain is known best. Raises UserError for another number of photographs
    than of lasers, sizes that differ, and pictures in colour.
    """
    first = photographs[0]
    if len(photographs) != len(wavelengths_m):
        raise UserError("--lasers", f"{len(wavelengths_m)} for {len(photographs)} photographs", expected="one for each")
    for photograph in photographs:
        if photograph.light.ndim != 2:
            raise UserError(photograph.name, "a picture in colour", expected="a grey one of one laser")
        if photograph.light.shape != first.light.shape:
            expected = f"{_size(first.light.shape)}, as {first.name}"
            raise UserError(photograph.name, _size(photograph.light.shape), expected=expected)
    known = [p.noise for p in photographs if p.noise is not None and p.noise.electrons_per_count is not None]
    noise = min(known, key=lambda of: of.gain_error) if known else first.noise
    wavelengths = np.array(wavelengths_m)
    images = images_of_lasers(
        wavelengths, observer_weights("eye", wavelengths), np.stack([p.light for p in photographs])
    )
    return replace(images, noise=noise)
