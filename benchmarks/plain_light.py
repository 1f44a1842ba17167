"""Pictures of benches with the faults of real ones, by numpy and SciPy alone: shares nothing with holoview's model.

Light before the first modulator is a beam (disc, Gaussian or ellipse anywhere on it) with a wavefront over the beam and
dust. A modulator pixel shows one phase on its active part; what is between the active parts reflects unmodulated.

Far field (`far_field`): each pixel is cut into squares over which the light is taken as constant; their Fourier
transforms are added at places across each of the camera's pixels, by a chirp z-transform along each axis.

Near field (`near_field`): `fine` × `fine` samples a pixel, each a small square (whose transform is a factor of the
spectrum), the angular spectrum in a window from which no light can come round, irises of which a frequency on the edge
passes in part; a camera pixel is the mean of its samples. Transforms leave out what is dark: samples beside modulators
and camera, and frequencies that no iris passes. Of small benches twice as many samples and twice the window
change the light by 0.03 %.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import gaussian_filter
from scipy.signal import CZT

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

FINE, SMALL_FINE = 4, 8
"""Samples a pixel and axis in the near field, of benches above `SMALL_PX` and of small ones."""
SMALL_PX = 256
PARTS = 2
"""Squares a pixel and axis in the far field."""
PLACES, SHARES = (values / 2 for values in np.polynomial.legendre.leggauss(4))
"""Across a camera pixel in the far field, in pixels from its middle: the mean of light with a period of two pixels is
right to 1e-6."""


@dataclass(frozen=True)
class Beam:
    """amplitude exp(−ρ^edge), ρ² = ((y − y₀)·stretch)² + ((x − x₀)/stretch)² over radius². Lengths in pixels."""

    radius: float
    edge: float = 2.0
    centre: tuple[float, float] = (0.0, 0.0)
    stretch: float = 1.0

    def amplitude(self, y: Floats, x: Floats) -> Floats:
        """At (rows, 1) and (1, columns) from the modulator's centre."""
        square = ((y - self.centre[0]) * self.stretch) ** 2 + ((x - self.centre[1]) / self.stretch) ** 2
        return np.exp(-((square / self.radius**2) ** (self.edge / 2)))


@dataclass(frozen=True)
class Bench:
    """What the bench really is; SI units, pixels where it says px.

    wave: {(n, m): rad r.m.s.} of Zernike polynomials over the circle of `wave_radius_px` around the beam's centre;
    m < 0: sines. tilt: turns a pixel of the light before modulator 1 (y, x). stroke_m: optical path of the last level.
    unmodulated: amplitude of a share of the light beside the modulated one, on all pixels. fill: active share of a
    pixel's area (far field). dust: opaque discs (y, x, radius) px on modulator 1. focal_length_m: None in the near
    field. axis_px: where the zero order, or the modulators' centre, is from the picture's centre, camera pixels (y, x).
    iris: sine of both relays' irises (near field). second_px: where modulator 2 is, (y, x).
    """

    shape: tuple[int, int]
    camera: tuple[int, int]
    pitch_m: float
    camera_pitch_m: float
    stroke_m: float
    num_levels: int = 256
    beam: Beam | None = None
    wave: dict[tuple[int, int], float] = field(default_factory=dict)
    wave_radius_px: float = 1.0
    tilt: tuple[float, float] = (0.0, 0.0)
    unmodulated: complex = 0.0
    fill: float = 1.0
    dust: tuple[tuple[float, float, float], ...] = ()
    focal_length_m: float | None = None
    axis_px: tuple[float, float] = (0.0, 0.0)
    distance_m: float = 0.0
    gap_m: float | None = None
    iris: float = 0.03
    second_px: tuple[float, float] = (0.0, 0.0)
    blur_px: float = 0.0

    def light(self, y: Floats, x: Floats) -> Complex:
        """Before modulator 1 at (rows, 1) and (1, columns), pixels from its centre."""
        by, bx = self.beam.centre if self.beam else (0.0, 0.0)
        phase = zernike_sum(self.wave, (y - by) / self.wave_radius_px, (x - bx) / self.wave_radius_px)
        phase = phase + 2 * np.pi * (self.tilt[0] * y + self.tilt[1] * x)
        amplitude = self.beam.amplitude(y, x) if self.beam else np.ones(np.broadcast_shapes(y.shape, x.shape))
        for dy, dx, radius in self.dust:
            amplitude = amplitude * ((y - dy) ** 2 + (x - dx) ** 2 > radius**2)
        return amplitude * np.exp(1j * phase)

    def picture(self, levels: Sequence[NDArray[np.unsignedinteger]], wavelength_m: float) -> Floats:
        """The mean light of each camera pixel (y, x) for the levels of each modulator."""
        phases = [2 * np.pi * self.stroke_m / wavelength_m * a / (self.num_levels - 1) for a in levels]
        near_or_far = near_field if self.focal_length_m is None else far_field
        light = near_or_far(self, [np.exp(1j * p) for p in phases], wavelength_m)
        return gaussian_filter(light, self.blur_px, mode="nearest", truncate=6.0) if self.blur_px else light


def centred(n: int) -> Floats:
    """n places around 0, one apart."""
    return np.arange(n) - (n - 1) / 2


# --- wavefronts -------------------------------------------------------------------------------------------------------


def zernike(n: int, m: int, y: Floats, x: Floats) -> Floats:
    """R_n^|m|(ρ)·cos(mθ), or sin for m < 0, of unit r.m.s. over the unit circle; θ from the x axis towards y."""
    rho, order = np.hypot(y, x), abs(m)
    radial = np.zeros_like(rho)
    for k in range((n - order) // 2 + 1):
        top = (-1) ** k * math.factorial(n - k)
        below = math.factorial(k) * math.factorial((n + order) // 2 - k) * math.factorial((n - order) // 2 - k)
        radial = radial + top / below * rho ** (n - 2 * k)
    if m == 0:
        return math.sqrt(n + 1) * radial
    theta = np.arctan2(y, x)
    return math.sqrt(2 * (n + 1)) * radial * (np.cos(m * theta) if m > 0 else np.sin(order * theta))


def zernike_sum(terms: dict[tuple[int, int], float], y: Floats, x: Floats) -> Floats:
    """The wavefront in radians, at (rows, 1) and (1, columns)."""
    total = np.zeros(np.broadcast_shapes(y.shape, x.shape))
    for (n, m), size in terms.items():
        total = total + size * zernike(n, m, y, x)
    return total


# --- far field --------------------------------------------------------------------------------------------------------


def far_field(bench: Bench, modulated: Sequence[Complex], wavelength_m: float) -> Floats:
    """The picture in the focal plane of a lens: of modulator 1 alone."""
    assert bench.focal_length_m is not None
    period_px = wavelength_m * bench.focal_length_m / (bench.pitch_m * bench.camera_pitch_m)
    between = 1 if bench.fill < 1 else 0  # the frame around the active square reflects, without modulation
    pixels = (1 - abs(bench.unmodulated)) * modulated[0] + bench.unmodulated - between
    light = np.zeros(bench.camera)
    for places, share in zip(itertools.product(PLACES, PLACES), np.outer(SHARES, SHARES).ravel(), strict=True):
        along = zip(bench.camera, bench.axis_px, places, strict=True)
        k = [(centred(n) - axis + place) / period_px for n, axis, place in along]  # periods a modulator pixel
        field_there = _squares_transformed(bench, pixels, math.sqrt(bench.fill), k)
        if between:
            field_there = field_there + _squares_transformed(bench, np.ones_like(pixels), 1.0, k)
        light += share * np.abs(field_there) ** 2
    return np.asarray(light / math.prod(bench.shape))


def _squares_transformed(bench: Bench, pixels: Complex, side: float, k: Sequence[Floats]) -> Complex:
    """Σ over pixels and their parts of light·pixel·exp(−2πi k·r), each a square; side: of the pixels' active part."""
    total: Complex = np.zeros((len(k[0]), len(k[1])), np.complex128)
    within = ((np.arange(PARTS) + 0.5) / PARTS - 0.5) * side
    y, x = centred(bench.shape[0])[:, None], centred(bench.shape[1])[None, :]
    for dy in within:
        for dx in within:
            field_there = pixels * bench.light(y + dy, x + dx)
            for axis, moved in ((0, dy), (1, dx)):
                field_there = _sum_at(field_there, axis, k[axis], moved) * _along(np.sinc(k[axis] * side / PARTS), axis)
            total += field_there * (side / PARTS) ** 2
    return total


def _sum_at(values: Complex, axis: int, k: Floats, moved: float) -> Complex:
    """Σ_j values_j·exp(−2πi k·(j − centre + moved)) along an axis, at equidistant k."""
    count, step = values.shape[axis], k[1] - k[0]
    transform = CZT(count, len(k), np.exp(-2j * np.pi * step), np.exp(2j * np.pi * k[0]))
    return np.asarray(transform(values, axis=axis) * _along(np.exp(2j * np.pi * k * ((count - 1) / 2 - moved)), axis))


def _along(values: NDArray[np.generic], axis: int) -> NDArray[np.generic]:
    return values[:, None] if axis == 0 else values[None, :]


# --- near field -------------------------------------------------------------------------------------------------------


def near_field(bench: Bench, modulated: Sequence[Complex], wavelength_m: float) -> Floats:
    """The picture in a plane behind one or two modulators, of camera pixels as wide as 1, 2 or 4 samples."""
    fine = SMALL_FINE if max(bench.shape) <= SMALL_PX else FINE
    reach_m = (bench.distance_m + (bench.gap_m or 0.0)) * math.tan(math.asin(bench.iris))
    beyond = math.ceil(reach_m / bench.pitch_m * fine) + 32 * fine  # where light comes round, nobody looks
    wider = 2 if fine == SMALL_FINE else 1
    size = [2 * fft.next_fast_len(wider * (n * fine + beyond) // 2 + 1) for n in bench.shape]
    cell = wavelength_m * fine / (bench.pitch_m * min(size))  # of the frequencies, as a sine
    every = [fft.fftfreq(n, bench.pitch_m / fine) * wavelength_m for n in size]
    window = _Window(size, [np.flatnonzero(np.abs(sines) < bench.iris + cell) for sines in every])
    sines = [_along(sines[kept], axis) for axis, (sines, kept) in enumerate(zip(every, window.kept, strict=True))]
    cells = np.sinc(sines[0] * bench.pitch_m / fine / wavelength_m) * np.sinc(
        sines[1] * bench.pitch_m / fine / wavelength_m
    )
    square = sines[0] ** 2 + sines[1] ** 2
    passes = np.clip((bench.iris - np.sqrt(square)) / cell + 0.5, 0, 1)
    cosine = np.sqrt(np.maximum(1 - square, 0))
    samples = [n * fine for n in bench.shape]
    first = window.middle(samples)
    y, x = (
        _along(centred(n)[k : k + m] / fine, axis)
        for axis, (n, k, m) in enumerate(zip(size, first, samples, strict=True))
    )
    spectrum = window.spectrum(bench.light(y, x) * _transmission(bench, modulated[0], fine), first) * cells
    if bench.gap_m is not None:
        wave = passes * np.exp(2j * np.pi * bench.gap_m / wavelength_m * cosine)
        there = [k + round(moved * fine) for k, moved in zip(first, bench.second_px, strict=True)]
        light = window.light(spectrum * wave, there, samples)
        spectrum = window.spectrum(light * _transmission(bench, modulated[1], fine), there)
    path_m = bench.distance_m * cosine
    for sine, moved in zip(sines, bench.axis_px, strict=True):
        path_m = path_m - sine * moved * bench.camera_pitch_m
    side = round(bench.camera_pitch_m / bench.pitch_m * fine)
    rows, columns = bench.camera
    seen = [rows * side, columns * side]
    light = window.light(spectrum * (passes * np.exp(2j * np.pi * path_m / wavelength_m)), window.middle(seen), seen)
    return np.asarray((np.abs(light) ** 2).reshape(rows, side, columns, side).mean(axis=(1, 3)))


@dataclass(frozen=True)
class _Window:
    """Dark but for some samples in it; of its frequencies those that the irises may pass. Both as (y, x)."""

    size: Sequence[int]
    kept: Sequence[NDArray[np.intp]]

    def middle(self, samples: Sequence[int]) -> list[int]:
        """Where so many samples in the middle begin."""
        return [(n - inner) // 2 for n, inner in zip(self.size, samples, strict=True)]

    def spectrum(self, light: Complex, first: Sequence[int]) -> Complex:
        """The kept frequencies of light that begins at `first`."""
        for axis in (0, 1):
            light = fft.fft(self._padded(light, axis, np.arange(light.shape[axis]) + first[axis]), axis=axis)
            light = light.take(self.kept[axis], axis)
        return light

    def light(self, spectrum: Complex, first: Sequence[int], samples: Sequence[int]) -> Complex:
        """So many samples of the light from `first` on."""
        for axis in (0, 1):
            spectrum = fft.ifft(self._padded(spectrum, axis, self.kept[axis]), axis=axis)
            spectrum = spectrum.take(np.arange(samples[axis]) + first[axis], axis)
        return spectrum

    def _padded(self, values: Complex, axis: int, places: NDArray[np.intp]) -> Complex:
        padded = np.zeros([self.size[k] if k == axis else n for k, n in enumerate(values.shape)], np.complex128)
        padded[(slice(None), places) if axis else places] = values
        return padded


def _transmission(bench: Bench, modulated: Complex, fine: int) -> Complex:
    """A modulator's samples."""
    return np.kron((1 - abs(bench.unmodulated)) * modulated + bench.unmodulated, np.ones((fine, fine)))


# --- patterns and cameras ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sensor:
    """electrons: a count. stray: counts without the lasers' light, at the picture's centre, and their slopes (y, x)
    from the centre to an edge."""

    bits: int = 8
    electrons: float = 10.0
    read_noise: float = 8.0
    black: float = 4.0
    stray: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def counts(self, rng: np.random.Generator, light: Floats) -> NDArray[np.uint16]:
        """light: in counts above the black level."""
        y, x = (_along(centred(n) / (n / 2), axis) for axis, n in enumerate(light.shape))
        whole = light + np.maximum(self.stray[0] + self.stray[1] * y + self.stray[2] * x, 0)
        electrons = rng.poisson(np.minimum(whole * self.electrons, 1e9)) + rng.normal(0, self.read_noise, light.shape)
        counts = np.rint(electrons / self.electrons + self.black)
        return np.clip(counts, 0, 2**self.bits - 1).astype(np.uint16)


def smooth_levels(
    rng: np.random.Generator, shape: tuple[int, int], smooth_px: float, levels: int = 256
) -> NDArray[np.uint8]:
    """Random levels of equal frequency, smooth over some pixels."""
    noise = gaussian_filter(rng.standard_normal(shape), smooth_px)
    rank = noise.ravel().argsort().argsort().reshape(shape)
    return (rank * levels // rank.size).astype(np.uint8)


def hologram_levels(rng: np.random.Generator, shape: tuple[int, int], kind: str) -> NDArray[np.uint8]:
    """A phase pattern whose far field is `blobs`, `lines` or `spots` beside the axis, by Gerchberg and Saxton."""
    y, x = (_along(fft.fftfreq(n), axis) for axis, n in enumerate(shape))
    target = np.zeros(shape)
    for _ in range({"blobs": 5, "lines": 14, "spots": 40}[kind]):
        distance, direction = rng.uniform(0.12, 0.3), rng.uniform(0, 2 * np.pi)
        cy, cx = distance * np.sin(direction), distance * np.cos(direction)
        if kind == "spots":
            target[round(cy * shape[0]) % shape[0], round(cx * shape[1]) % shape[1]] = rng.uniform(0.5, 1)
        elif kind == "blobs":
            target += np.exp(-((y - cy) ** 2 + (x - cx) ** 2) / rng.uniform(0.02, 0.06) ** 2)
        else:
            turn, length = rng.uniform(0, np.pi), rng.uniform(0.03, 0.1)
            along = (y - cy) * np.sin(turn) + (x - cx) * np.cos(turn)
            across = (y - cy) * np.cos(turn) - (x - cx) * np.sin(turn)
            target += (np.abs(along) < length) * (np.abs(across) < 0.012)
    field_now = fft.ifft2(np.sqrt(target) * np.exp(2j * np.pi * rng.random(shape)))
    for _ in range(25):
        spectrum = fft.fft2(np.exp(1j * np.angle(field_now)))
        field_now = fft.ifft2(np.sqrt(target) * np.exp(1j * np.angle(spectrum)))
    return np.asarray(np.round(np.angle(field_now) / (2 * np.pi) % 1 * 255), dtype=np.uint8)
