"""Captures: the data measured on one bench in SI units, and the nominal bench that they describe.

The nominal bench is the bench that the laboratory believes in. Diagnosis and calibration find out how the real bench
differs from it.

`turned` and `undone` mirror or turn a picture in one of the eight ways that need no resampling.

A turned picture has its first row at the top; `rotate_90` is anticlockwise. Positions are (y, x) from the centre.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.bench_parts import Modulator, Relay, Sampling
from holoview.light.model.effects.effect import DataProperties
from holoview.light.model.effects.registry import chain_parts
from holoview.light.model.system import System
from holoview.light.numerics.sampling import first_of_part

_Images = NDArray[Any]

_UNDO: dict[str, Callable[[_Images], _Images]] = {
    "none": lambda a: a,
    "flip_x": lambda a: a[..., :, ::-1],
    "flip_y": lambda a: a[..., ::-1, :],
    "rotate_180": lambda a: a[..., ::-1, ::-1],
    "transpose": lambda a: np.swapaxes(a, -1, -2),
    "rotate_90": lambda a: np.rot90(a, -1, (-2, -1)),
    "rotate_270": lambda a: np.rot90(a, 1, (-2, -1)),
    "anti_transpose": lambda a: np.swapaxes(a, -1, -2)[..., ::-1, ::-1],
}

ORIENTATIONS = tuple(_UNDO)
"""The names of the orientations; the first changes nothing."""

SHAPE_KEEPING = ORIENTATIONS[:4]
"""The orientations that keep the numbers of rows and columns."""

_INVERSE = {"rotate_90": "rotate_270", "rotate_270": "rotate_90"}

_MATRICES: dict[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "none": ((1, 0), (0, 1)),
    "flip_x": ((1, 0), (0, -1)),
    "flip_y": ((-1, 0), (0, 1)),
    "rotate_180": ((-1, 0), (0, -1)),
    "transpose": ((0, 1), (1, 0)),
    "rotate_90": ((0, -1), (1, 0)),
    "rotate_270": ((0, 1), (-1, 0)),
    "anti_transpose": ((0, -1), (-1, 0)),
}


def undone(images: _Images, orientation: str) -> _Images:
    """Images (…, y, x) the right way up that have an orientation; a view of the same memory."""
    return _UNDO[orientation](images)


def turned(images: _Images, orientation: str) -> _Images:
    """Upright images (…, y, x) in an orientation; a view of the same memory."""
    return _UNDO[inverse_orientation(orientation)](images)


def inverse_orientation(orientation: str) -> str:
    """The orientation that undoes another orientation."""
    return _INVERSE.get(orientation, orientation)


def orientation_matrix(orientation: str) -> NDArray[np.float64]:
    """The matrix (2, 2) that takes a position (y, x) to its place in the orientation."""
    return np.array(_MATRICES[orientation], dtype=np.float64)


def nearest_orientation(matrix: NDArray[np.float64]) -> str:
    """The orientation whose matrix is most like a given one (2, 2), whatever its scale."""
    return max(ORIENTATIONS, key=lambda orientation: float((orientation_matrix(orientation) * matrix).sum()))


def oriented_shape(shape: tuple[int, int], orientation: str) -> tuple[int, int]:
    """Rows and columns of an upright shape in an orientation."""
    return shape if orientation in SHAPE_KEEPING else (shape[1], shape[0])


# --- captures ---------------------------------------------------------------------------------------------------------


Floats = NDArray[np.float64]
Masks = NDArray[np.bool_]
Real = TypeVar("Real", bound=np.floating)
_CLEAR = Relay()


@dataclass(frozen=True)
class SlmSpec:
    """A modulator whose grey levels 0 … num_levels − 1 nominally add 0 … opd_range_m of optical path in equal steps.

    shares: of an amplitude modulator with uneven steps, the share of its range that each level shows; else empty.
    """

    pitch_m: float
    num_levels: int
    opd_range_m: float
    shares: tuple[float, ...] = ()

    def shares_of(self, levels: NDArray[Any]) -> Floats:
        """The shares, 0 … 1, of the stroke or range that levels show; between whole levels linear."""
        if not self.shares:
            return np.asarray(levels / float(self.num_levels - 1))
        return np.interp(levels, np.arange(self.num_levels), self.shares)

    def levels_of(self, shares: NDArray[Any]) -> Floats:
        """The levels nearest to shares of the stroke or range."""
        if not self.shares:
            return np.rint(np.asarray(shares) * (self.num_levels - 1))
        own = np.array(self.shares)
        return np.searchsorted((own[1:] + own[:-1]) / 2, shares).astype(np.float64)


@lru_cache(maxsize=16)  # a search asks for the nominal bench of the same modulators thousands of times
def _nominal_modulator(slm: SlmSpec, shape: tuple[int, int]) -> Modulator:
    levels = np.linspace(0.0, 1.0, slm.num_levels)
    return Modulator(pitch_m=slm.pitch_m, shape=shape, stroke_m=slm.opd_range_m, levels=levels)


@dataclass(frozen=True)
class Camera:
    """The camera's data sheet values.

    pitch_m: pixel pitch, divided by the magnification from the modulator's plane to the sensor; on a Fourier bench the
    sensor's own.
    bit_depth: bits of a raw image; a pixel saturates at 2^bit_depth − 1 counts.
    electrons_per_count: photo-electrons that raise a pixel by one count.
    read_noise: standard deviation in electrons.
    black_level: counts of a pixel without light.
    integrates: whether a pixel measures the mean light over its area, as real ones do, or the light at its middle, as
    some simulations have it. None: nobody stated it.
    """

    pitch_m: float
    bit_depth: int
    electrons_per_count: float
    read_noise: float
    black_level: float
    integrates: bool | None = None

    @property
    def saturation(self) -> int:
        """Counts of a saturated pixel."""
        return int(2**self.bit_depth) - 1

    @property
    def dark_noise(self) -> float:
        """Standard deviation (counts) of a pixel without light: read noise and quantisation."""
        return float(self.noise_variance(np.zeros(1))[0]) ** 0.5

    def noise_variance(self, signal: NDArray[Real]) -> NDArray[Real]:
        """Variance (counts²) of a pixel with an expected signal s of any shape, in counts above the black level.

        σ² = (g·max(s, 0) + r²)/g² + 1/12 with g electrons per count: shot noise, read noise r, and quantisation to
        whole counts. The data type of `signal` is kept.
        """
        electrons = np.maximum(signal, 0.0) * self.electrons_per_count
        variance = (electrons + self.read_noise**2) / self.electrons_per_count**2 + 1 / 12
        return variance.astype(signal.dtype, copy=False)


@dataclass(frozen=True)
class Captures:
    """Patterns, camera images and settings of N captures, with the nominal geometry of the bench.

    levels: (N, modulator, y, x), the grey levels that were sent. Of a chain, those of each element that shows some, in
    order, in the first rows and columns: shapes may differ (`patterns`).
    images: (N, y, x), raw counts.
    wavelength_m: (N,), in vacuum.
    distance_m: (N,), from the last modulator to the camera; on a Fourier bench the defocus from the focal plane.
    power: (N,), laser power that was set, in any unit.
    exposure_s: (N,), exposure times.
    gap_m: distance between the two modulators; None with one modulator.
    relay1: the nominal stops between the modulators; clear with one modulator.
    relay2: the stops between the last modulator and the camera, on a Fourier bench in front of the camera.
    focal_length_m: of the lens of a Fourier bench, which has the camera in its back focal plane; None for near field.
    corrections: mistakes in the records that have been put right in these captures, in words.
    estimated: sentences on settings that nobody stated and that were estimated from the pictures.
    lasers_m: wavelengths of the captures that these are a subset of, ascending; empty where these are all.
    frame: (rows, columns) of the whole pictures, where `images` holds only a part; None otherwise.
    slm_frame: (rows, columns) of the whole modulators, where `levels` holds only a part; None otherwise.
    centre_m: (y, x), where the centre of that part is, in pictures and, where `slm_frame` is stated, in modulators.
    axis_m: (y, x), where the zero order of a Fourier bench is, or the centre of a near field's modulators, from the
    centre of the pictures; the latter differ only in parts of larger pictures.
    usable: (N, y, x), False for pixels that every fit and measure leaves out; None where all count.
    levels_before: shape as `levels`: for each capture the levels that the modulators showed before it, that is those of
    the capture taken before; the first capture of a measurement has its own levels here. If a modulator hadn't settled
    the values lie between whole levels. None if each capture's predecessor is the one before it in this data set.
    chain: the nominal bench where it is a chain of elements, whose distances and stops the other fields don't tell.
    levels_first: (modulator, y, x), the levels of the first capture of the measurement; None if that capture is the
    first of this data set.
    """

    levels: NDArray[np.unsignedinteger]
    images: NDArray[np.uint16]
    wavelength_m: Floats
    distance_m: Floats
    power: Floats
    exposure_s: Floats
    slms: tuple[SlmSpec, ...]
    camera: Camera
    gap_m: float | None = None
    relay1: Relay = _CLEAR
    relay2: Relay = _CLEAR
    focal_length_m: float | None = None
    corrections: tuple[str, ...] = ()
    estimated: tuple[str, ...] = ()
    lasers_m: tuple[float, ...] = ()
    frame: tuple[int, int] | None = None
    slm_frame: tuple[int, int] | None = None
    centre_m: tuple[float, float] = (0.0, 0.0)
    axis_m: tuple[float, float] = (0.0, 0.0)
    usable: Masks | None = None
    levels_before: NDArray[np.unsignedinteger] | Floats | None = None
    levels_first: NDArray[np.unsignedinteger] | None = None
    chain: System | None = None

    def __len__(self) -> int:
        return len(self.levels)

    @property
    def slm_names(self) -> tuple[str, ...]:
        """The modulators in words: modulator 1 and modulator 2, of a chain the names of its elements."""
        if self.chain is not None:
            return tuple(self.chain.drive_shapes)
        return tuple(f"modulator {number + 1}" for number in range(len(self.slms)))

    @property
    def first_pixel(self) -> tuple[int, int]:
        """Row and column of the first modulator pixel, counted in the whole modulator."""
        shape = (self.levels.shape[2], self.levels.shape[3])
        return first_of_part(self.slm_frame or shape, shape, self.slm_centre_m, self.slms[0].pitch_m)

    @property
    def slm_centre_m(self) -> tuple[float, float]:
        """(y, x), where the centre of the modulators' part is; of whole modulators (0, 0)."""
        return (0.0, 0.0) if self.slm_frame is None else self.centre_m

    @property
    def picture_centre_m(self) -> tuple[float, float]:
        """(y, x), where the centre of the pictures' part is in whole pictures."""
        if self.is_fourier:
            return self.centre_m
        return self.centre_m[0] - self.axis_m[0], self.centre_m[1] - self.axis_m[1]

    @property
    def is_fourier(self) -> bool:
        """Whether the camera is in the focal plane of a lens."""
        return self.focal_length_m is not None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of an image."""
        return self.images.shape[1], self.images.shape[2]

    @property
    def wavelengths_m(self) -> Floats:
        """The distinct wavelengths in ascending order."""
        return np.unique(self.wavelength_m)

    @property
    def laser_number(self) -> NDArray[np.intp]:
        """(N,): number of the laser that is on, 0 for the shortest wavelength; the nearest for other wavelengths."""
        lasers = np.array(self.lasers_m or self.wavelengths_m)
        return np.asarray(np.abs(self.wavelength_m[:, None] - lasers[None, :]).argmin(axis=1))

    @property
    def upsample(self) -> int:
        """Simulation samples per modulator pixel and axis: camera pixels per modulator pixel, limited to 2 … 16."""
        if self.chain is not None:
            return self.chain.sampling.upsample
        return max(2, min(16, round(self.slms[0].pitch_m / self.camera.pitch_m)))

    def data_properties(self) -> DataProperties:
        """The properties of these data on which it depends whether an effect can show (`Needs`)."""
        irises = (self.relay1.has_aperture, self.relay2.has_aperture)
        wavelengths, planes, powers = (
            len(np.unique(values)) for values in (self.wavelength_m, self.distance_m, self.power)
        )
        lasers = len(self.lasers_m) or wavelengths
        elements = () if self.chain is None else chain_parts(self.chain)
        own = (len(self.slms), irises, self.is_fourier)
        return DataProperties(wavelengths, planes, powers, *own, lasers=lasers, elements=elements)

    def subset(self, indices: Sequence[int] | NDArray[np.integer]) -> Captures:
        """The captures of these indices, in that order, on the same bench."""
        chosen = np.asarray(indices)
        names = ("levels", "images", "wavelength_m", "distance_m", "power", "exposure_s")
        lasers = self.lasers_m or tuple(self.wavelengths_m.tolist())
        before = np.stack([self._levels_before(int(k)) for k in chosen]) if len(chosen) else self.levels[:0]
        parts = {name: getattr(self, name)[chosen] for name in names}
        parts["usable"] = None if self.usable is None else self.usable[chosen]
        first = self.levels[0] if self.levels_first is None and len(self) else self.levels_first
        return dataclasses.replace(self, **parts, lasers_m=lasers, levels_before=before, levels_first=first)

    def with_pictures(self, change: Callable[[_Images], _Images], **others: Any) -> Captures:
        """The captures with pictures (capture, y, x), and what is left out of them, cut or turned. others: fields."""
        usable = None if self.usable is None else change(self.usable)
        return dataclasses.replace(self, images=change(self.images), usable=usable, **others)

    def usable_pixels(self, capture: int) -> Masks:
        """The pixels (y, x) of a picture that aren't left out, whether saturated or not."""
        return np.ones(self.shape, bool) if self.usable is None else self.usable[capture]

    @property
    def saturated_shares(self) -> Floats:
        """(N,): share of the pixels that aren't left out that are saturated."""
        pictures = zip(self.images, map(self.usable_pixels, range(len(self))), strict=True)
        return np.array([float((image[usable] >= self.camera.saturation).mean()) for image, usable in pictures])

    def drive(self, capture: int) -> Floats:
        """The patterns of one capture as fractions of the stroke, 0 … 1, (modulator, y, x)."""
        return self._shares_of(self.levels[capture])

    def patterns(self, drive: Any) -> dict[str, Any]:
        """The patterns (rows, columns) of a chain's elements by their names, from those of `drive`."""
        assert self.chain is not None
        shapes = self.chain.drive_shapes
        return {n: own[: shape[1], : shape[2]] for own, (n, shape) in zip(drive, shapes.items(), strict=True)}

    def drive_before(self, capture: int) -> Floats:
        """As `drive`, of the capture that was taken before, in the order of the file; for the first its own drive."""
        return self._shares_of(self._levels_before(capture))

    @property
    def first_drive(self) -> Floats:
        """As `drive`, of the first capture of all."""
        return self._shares_of(self.levels[0] if self.levels_first is None else self.levels_first)

    def _shares_of(self, levels: NDArray[Any]) -> Floats:
        """Levels (modulator, y, x) as fractions of the stroke or range."""
        return np.stack([slm.shares_of(own) for slm, own in zip(self.slms, levels, strict=True)])

    def _levels_before(self, capture: int) -> NDArray[np.unsignedinteger] | Floats:
        if self.levels_before is not None:
            return self.levels_before[capture]
        return self.levels[max(capture % len(self) - 1, 0)]

    def nominal_system(
        self, wavelengths_m: Sequence[float] | None = None, planes_m: Sequence[float] | None = None
    ) -> System:
        """The nominal bench at these wavelengths and planes (all of the captures' when None), with a `mono` observer.

        planes_m: distances from the last modulator; on a Fourier bench focal_length_m + defocus, from the lens.
        """
        wavelengths = self.wavelengths_m if wavelengths_m is None else np.asarray(wavelengths_m, dtype=np.float64)
        distances = np.unique(self.distance_m) + (self.focal_length_m or 0.0)
        planes = distances if planes_m is None else np.asarray(planes_m, dtype=np.float64)
        if self.chain is not None:
            lasers = {"wavelengths": wavelengths, "amplitudes": np.ones((1, len(wavelengths)))}
            return self.chain.edit({**lasers, "planes": planes})
        shape = (self.levels.shape[2], self.levels.shape[3])
        return System(
            wavelengths_m=wavelengths,
            amplitudes=np.ones((1, len(wavelengths))),
            modulators=tuple(_nominal_modulator(slm, shape) for slm in self.slms),
            gap_m=self.gap_m,
            planes_m=planes,
            relay1=self.relay1,
            relay2=Relay() if self.is_fourier else self.relay2,
            observer="mono",
            sampling=Sampling(upsample=self.upsample),
        )


def join_captures(parts: Sequence[Captures]) -> Captures:
    """Several captures of one bench together, in their order.

    Where a part states the patterns before its captures, as a subset does, these are kept.
    """
    names = ("levels", "images", "wavelength_m", "distance_m", "power", "exposure_s")
    together: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    if any(part.levels_before is not None for part in parts):
        lasts = [parts[0].levels[:1], *(part.levels[-1:] for part in parts[:-1])]
        before = [
            np.concatenate([last, part.levels[:-1]]) if part.levels_before is None else part.levels_before
            for last, part in zip(lasts, parts, strict=True)
        ]
        together["levels_before"] = np.concatenate(before)
    if any(part.usable is not None for part in parts):
        together["usable"] = np.concatenate([[part.usable_pixels(k) for k in range(len(part))] for part in parts])
    return dataclasses.replace(parts[0], **together)
