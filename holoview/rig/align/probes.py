"""Patterns that make dots whose place tells the geometry.

A probe is a block of pixels at r with the phase of a lens that focuses at the distance L and of a grating of spatial
frequency ν (the carrier). In the near field its dot lies at r + L·λν: its place tells where the modulator is, and how
it moves with ν tells L. On a Fourier bench with focal length f and defocus z it lies at f·λν − (z/f)·r. Where the dot
lies doesn't depend on how the modulator's phase follows its levels, only how bright it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import SlmSpec
from holoview.rig.description import RigDescription
from holoview.rig.devices import Levels

Points = NDArray[np.float64]
_LENS_SHARE, _CARRIER_SHARE = 0.45, 0.3  # of the steepest direction that passes; together below 1
_SPOTS_APART = 2.5  # spacing of dots in widths of a dot
FEWEST_PX, DOTS_ACROSS, _MOST_ACROSS = 6, 4, 16


@dataclass(frozen=True)
class Probes:
    """A pattern and the dots that it makes.

    levels: (y, x), as displayed. centre_m: (dot, 2), r of each dot's block. frequency: (dot, 2), its ν in 1/m.
    width_m: of a dot. spacing_m: between neighbouring dots; infinite for a single one.
    """

    levels: Levels
    centre_m: Points
    frequency: Points
    width_m: float
    spacing_m: float = math.inf


@dataclass(frozen=True)
class Optics:
    """What probes of one modulator need to know. sine: of the steepest direction that passes. All in m."""

    slm: SlmSpec
    shape: tuple[int, int]
    wavelength_m: float
    sine: float
    focal_length_m: float | None

    @property
    def carrier(self) -> float:
        """Spatial frequency (1/m) of the gratings."""
        return _CARRIER_SHARE * self.sine / self.wavelength_m

    def lens_px(self, distance_m: float) -> int:
        """Pixels across a lenslet that focuses at a distance."""
        widest = 2 * _LENS_SHARE * self.sine * distance_m / self.slm.pitch_m
        return int(np.clip(widest, FEWEST_PX, max(min(self.shape) // DOTS_ACROSS, FEWEST_PX)))

    def dot_m(self, distance_m: float) -> float:
        """Width of the dot of a lenslet."""
        return self.wavelength_m * distance_m / (self.lens_px(distance_m) * self.slm.pitch_m)


def optics_of(rig: RigDescription, number: int, wavelength_m: float) -> Optics:
    """The optics of modulator 0 or 1 of a rig, nominally."""
    slm, bench = rig.bench.slms[number], rig.bench
    relays = (bench.relay1, bench.relay2) if number + 1 < len(bench.slms) else (bench.relay2,)
    sines = [wavelength_m / (2 * slm.pitch_m), *(r.axis_sine(wavelength_m, slm.pitch_m) for r in relays)]
    return Optics(slm, rig.slm_shape, wavelength_m, min(sines), bench.focal_length_m)


def flat_levels(optics: Optics) -> Levels:
    """A pattern without any phase."""
    return np.zeros(optics.shape, _levels_type(optics))


def single_lens(optics: Optics, at: tuple[float, float], distance_m: float) -> Probes:
    """One lenslet at `at` (y, x), m, as wide as the directions allow, on a flat modulator."""
    y, x = _pixels(optics)
    lens = -np.pi / (optics.wavelength_m * distance_m) * ((y - at[0]) ** 2 + (x - at[1]) ** 2)
    half = optics.lens_px(distance_m) / 2 * optics.slm.pitch_m
    inside = (np.abs(y - at[0]) < half) & (np.abs(x - at[1]) < half)
    levels = _levels(np.where(inside, lens, 0.0), optics)
    return Probes(levels, np.array([at]), np.zeros((1, 2)), optics.dot_m(distance_m))


def lens_array(optics: Optics, distance_m: float, carrier: tuple[float, float]) -> Probes:
    """Lenslets side by side over the modulator, all with the same carrier (y, x) in 1/m."""
    pitch, aperture = optics.slm.pitch_m, optics.lens_px(distance_m)
    apart = max(aperture, math.ceil(_SPOTS_APART * optics.dot_m(distance_m) / pitch))
    apart = max(apart, math.ceil(max(optics.shape) / _MOST_ACROSS))
    counts = [max(n // apart, 1) for n in optics.shape]
    places = [(np.arange(count) - (count - 1) / 2) * apart * pitch for count in counts]
    offset = [np.abs(axis[..., None] - own) for axis, own in zip(_pixels(optics), places, strict=True)]
    nearest = [own[distance.argmin(axis=-1)] for own, distance in zip(places, offset, strict=True)]
    y, x = (axis - own for axis, own in zip(_pixels(optics), nearest, strict=True))
    phase = -np.pi / (optics.wavelength_m * distance_m) * (y**2 + x**2)
    inside = (np.abs(y) <= aperture / 2 * pitch) & (np.abs(x) <= aperture / 2 * pitch)
    grating = 2 * np.pi * sum(ν * axis for ν, axis in zip(carrier, _pixels(optics), strict=True))
    levels = _levels(np.where(inside, phase + grating, 0.0), optics)
    centres = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 2)
    return Probes(
        levels, centres, np.tile(np.array(carrier), (len(centres), 1)), optics.dot_m(distance_m), apart * pitch
    )


def grating(optics: Optics, carrier: tuple[float, float], part: tuple[int, int] = (0, 0)) -> Probes:
    """A grating for a Fourier bench, over the modulator, or the half of it on one side, with the rest flat.

    carrier: (y, x) in 1/m. part: (±1, 0) for the half with the higher or lower rows, (0, ±1) for that of columns.
    """
    assert optics.focal_length_m is not None
    axes, extent = _pixels(optics), np.array(optics.shape) * optics.slm.pitch_m
    inside = np.ones(optics.shape, bool)
    for side, axis in zip(part, axes, strict=True):
        inside &= (side * axis > 0) if side else True
    phase = 2 * np.pi * sum(ν * axis for ν, axis in zip(carrier, axes, strict=True))
    width = extent / (1 + np.abs(part))
    spot_m = optics.wavelength_m * optics.focal_length_m / float(width.min())
    centre = np.array(part) * extent / 4
    return Probes(_levels(np.where(inside, phase, 0.0), optics), centre[None], np.array([carrier]), spot_m)


def _pixels(optics: Optics) -> tuple[Points, Points]:
    """Positions (y, 1) and (1, x) of the pixels from the modulator's centre, m."""
    y, x = (np.asarray((np.arange(n) - (n - 1) / 2) * optics.slm.pitch_m, dtype=np.float64) for n in optics.shape)
    return y[:, None], x[None, :]


def _levels(phase: Points, optics: Optics) -> Levels:
    """The levels nearest to a phase in radians, nominally; a modulator of less than a wave uses all that it has."""
    slm = optics.slm
    waves = np.remainder(phase / (2 * np.pi), 1.0)
    steps = waves * min(optics.wavelength_m / slm.opd_range_m, 1.0) * (slm.num_levels - 1)
    return np.rint(steps).astype(_levels_type(optics))


def _levels_type(optics: Optics) -> type[np.unsignedinteger]:
    return np.uint8 if optics.slm.num_levels <= 256 else np.uint16
