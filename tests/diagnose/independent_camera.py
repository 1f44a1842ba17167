"""What is wrong with the camera of the independent program, and with what lies before it; plain numpy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import fourier_gaussian

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

_STOPS = 12  # of a moving camera: points of Gauss and Legendre's rule, exact for lines of some ten pixels


@dataclass(frozen=True)
class Fringes:
    """Plane interference fringes of a wedged plate before the camera, period and direction at a wavelength.

    period_px: camera pixels from one maximum to the next at `at_m`, in proportion to the wavelength at others.
    towards_rad: direction across the fringes, from +x (columns) towards +y (rows). depth: of the shortest wavelength
    and of the longest, others between. thickness_m: of the plate where the picture's centre is, optical, which gives
    the phase. is_moire: instead, the period is the same at all wavelengths, and so is the phase.
    """

    period_px: float
    towards_rad: float
    depth: tuple[float, float]
    at_m: float = 550e-9
    thickness_m: float = 0.73e-3
    is_moire: bool = False

    def seen(self, light: Floats, wavelength_m: float, ends_m: tuple[float, float]) -> Floats:
        """The light (y, x) with the fringes on it. ends_m: the shortest and the longest wavelength."""
        rows, columns = np.indices(light.shape)
        y, x = rows - (light.shape[0] - 1) / 2, columns - (light.shape[1] - 1) / 2
        across = x * np.cos(self.towards_rad) + y * np.sin(self.towards_rad)
        wavelength_m, seen_m = (self.at_m if self.is_moire else wavelength_m), wavelength_m
        turns = 2 * self.thickness_m / wavelength_m + across / (self.period_px * wavelength_m / self.at_m)
        return light * (1 + np.interp(seen_m, ends_m, self.depth) * np.cos(2 * np.pi * turns))


@dataclass(frozen=True)
class Room:
    """Light of a lamp beside the picture, which grows evenly across it.

    least, most: at the corners, shares of the full well in a second. towards_rad: where the lamp is, from +x (columns)
    towards +y (rows).
    """

    least: float = 0.0
    most: float = 0.0
    towards_rad: float = 0.0

    def light(self, shape: tuple[int, ...]) -> Floats:
        """Light of each camera pixel (y, x) in a second."""
        rows, columns = np.indices(shape)
        across = rows * np.sin(self.towards_rad) + columns * np.cos(self.towards_rad)
        return self.least + (self.most - self.least) * (across - across.min()) / (across.max() - across.min())


@dataclass(frozen=True)
class Motion:
    """The camera moves evenly during each exposure: so many samples of the field, from +x (columns) towards +y."""

    length: float
    towards_rad: float

    def light(self, seen: Complex, y: Floats, x: Floats) -> Floats:
        """As of `CameraFaults`, where y and x are those of the camera in the middle of the exposure."""
        node, weight = np.polynomial.legendre.leggauss(_STOPS if self.length else 1)
        total = np.zeros((len(y), len(x)))
        for along, share in zip(node * self.length / 2, weight / 2, strict=True):
            at = along * np.sin(self.towards_rad), along * np.cos(self.towards_rad)
            total += share * np.abs(field_at(seen, y - at[0], x - at[1])) ** 2
        return total


@dataclass(frozen=True)
class Rail:
    """The stage on which the camera travels from the last modulator to its planes.

    travel: how far it goes for each metre that is asked of it. off_axis_px: camera samples by which it has walked
    sideways, (y, x), for each millimetre it went. larger: by how much pictures are larger for each millimetre.
    """

    travel: float = 1.0
    off_axis_px: tuple[float, float] = (0.0, 0.0)
    larger: float = 0.0

    def positions(self, y: Floats, x: Floats, distance_m: float) -> tuple[Floats, Floats]:
        """Where the light comes from, in samples, that is seen at (y) and (x) this far from the modulator."""
        millimetres = distance_m * 1e3
        size = 1 + self.larger * millimetres
        found = []
        for at, walked in zip((y, x), self.off_axis_px, strict=True):
            middle = at.mean()
            found.append(middle + (at - middle - walked * millimetres) / size)
        return found[0], found[1]


@dataclass(frozen=True)
class Shading:
    """A lens before the camera, whose light falls off with cos⁴ of the angle to its axis.

    focal_px: its focal length in camera pixels. axis_px: where its axis meets the camera, (y, x) from the middle.
    """

    focal_px: float
    axis_px: tuple[float, float] = (0.0, 0.0)

    def seen(self, light: Floats) -> Floats:
        """The light (y, x) behind the lens."""
        rows, columns = np.indices(light.shape)
        away = np.hypot(
            rows - (light.shape[0] - 1) / 2 - self.axis_px[0], columns - (light.shape[1] - 1) / 2 - self.axis_px[1]
        )
        return light * np.cos(np.arctan2(away, self.focal_px)) ** 4


@dataclass(frozen=True)
class CameraFaults:
    """What is wrong with the camera. blur_px: Gaussian σ of its picture, camera pixels."""

    blur_px: float = 0.0
    shading: Shading | None = None
    fringes: Fringes | None = None
    motion: Motion | None = None
    room: Room = field(default_factory=Room)
    rail: Rail = field(default_factory=Rail)

    def light(self, seen: Complex, y: NDArray[np.int_], x: NDArray[np.int_], distance_m: float) -> Floats:
        """The light of a field `seen` at positions (y) and (x), in samples from its first, that has gone so far."""
        if self.motion is None and self.rail == Rail():
            return np.abs(seen[np.ix_(y, x)]) ** 2
        return (self.motion or Motion(0.0, 0.0)).light(seen, *self.rail.positions(y, x, distance_m))

    def picture(self, light: Floats, wavelength_m: float, ends_m: tuple[float, float]) -> Floats:
        """The light on the camera's pixels (y, x) as they record it. ends_m: the shortest and longest wavelength."""
        if self.blur_px:
            margin = int(np.ceil(8 * self.blur_px))
            spectrum = fourier_gaussian(np.fft.fft2(np.pad(light, margin, mode="edge")), self.blur_px)
            light = np.maximum(np.fft.ifft2(spectrum).real, 0)[margin:-margin, margin:-margin]
        light = light if self.shading is None else self.shading.seen(light)
        return light if self.fringes is None else self.fringes.seen(light, wavelength_m, ends_m)


def field_at(field: Complex, y: Floats, x: Floats) -> Complex:
    """A periodic field between its samples, at all positions (y) and (x) in samples: the sum of its waves."""
    waves = np.fft.fft2(field) / field.size
    bright = np.abs(waves) > 1e-12 * np.abs(waves).max()
    rows, columns = bright.any(axis=1), bright.any(axis=0)
    fy, fx = (np.fft.fftfreq(n) for n in field.shape)
    to_y = np.exp(2j * np.pi * y[:, None] * fy[rows][None, :])
    to_x = np.exp(2j * np.pi * fx[columns][:, None] * x[None, :])
    return to_y @ waves[np.ix_(rows, columns)] @ to_x
