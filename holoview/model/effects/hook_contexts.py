"""What hooks work on: a modulator's surface, a relay's aperture, the camera's sensor; and how something lies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch

from holoview.model.effects.old_names import old_method
from holoview.numerics.resample import affine_warp, centred_indices, gaussian_blur, upsample_nearest
from holoview.numerics.zernike import zernike

Tensor = torch.Tensor


@dataclass(frozen=True)
class Pose:
    """How something lies against where it should be: moved by shift_m (y, x), turned about its centre, magnified.

    What should be at r is at magnification · R(rotation) r + shift; a positive rotation turns +x towards +y.
    softness: share of a picture that was brought there by linear interpolation between pixels, which blurs.
    """

    shift_m: tuple[float, float] = (0.0, 0.0)
    rotation_rad: float = 0.0
    magnification: float = 1.0
    softness: float = 0.0

    @property
    def is_identity(self) -> bool:
        """Whether it lies where it should."""
        return self == Pose()

    def inverse_affine(self, pitch_m: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Rows (y, x, 1) of the affine map, in samples from the centre, from a place to what is there."""
        c, s = (f(self.rotation_rad) / self.magnification for f in (math.cos, math.sin))
        dy, dx = (shift / pitch_m for shift in self.shift_m)
        return (c, -s, -(c * dy - s * dx)), (s, c, -(s * dy + c * dx))


@dataclass(frozen=True)
class ModulatorContext:
    """A modulator at one wavelength. number: 0 for the first. stroke_m, pitch_m: of the bench as it is.

    Maps are of pixels (rows, columns) until an effect needs samples, `upsample` for each side of a pixel.
    """

    number: int
    wavelength_m: float
    stroke_m: float
    pitch_m: float
    shape: tuple[int, int]
    upsample: int

    def sampled(self, values: Tensor) -> Tensor:
        """The map of samples, each pixel a square of equal ones; as it is where it has been that already."""
        return (
            values
            if tuple(values.shape) != self.shape or self.upsample == 1
            else upsample_nearest(values, self.upsample)
        )

    def positions(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Positions y (…, 1) and x (1, …) in metres of the entries of a map, from the centre."""
        step = self.pitch_m if tuple(values.shape) == self.shape else self.pitch_m / self.upsample
        real = values.real.dtype
        return tuple(  # type: ignore[return-value]
            centred_indices(n, real, values.device).reshape(view) * step
            for n, view in zip(values.shape, ((-1, 1), (1, -1)), strict=True)
        )

    places = old_method("places", "positions", positions)

    def zernike(self, values: Tensor, terms: Mapping[int, float]) -> Tensor:
        """Σ c_j·Z_j of {Noll index: c_j} over the circle around the modulator, for the entries of a map."""
        y, x = self.positions(values)
        radius = math.hypot(*self.shape) * self.pitch_m / 2
        return _zernike_sum(torch.hypot(y, x) / radius, torch.atan2(y, x), terms)

    def half_width(self) -> float:
        """Half the longer side (m), the length that positions are compared with."""
        return max(self.shape) * self.pitch_m / 2

    def blurred(self, values: Tensor, sigma_px: float | Tensor) -> Tensor:
        """The map of samples convolved with a Gaussian of `sigma_px` modulator pixels; edges go on outwards."""
        return gaussian_blur(self.sampled(values), sigma_px * self.upsample)

    def warped(self, values: Tensor, pose: Pose) -> Tensor:
        """The map of samples as it arrives from a modulator that lies so: each sample the mean of what it sees."""
        return affine_warp(self.sampled(values), pose.inverse_affine(self.pitch_m / self.upsample))


@dataclass(frozen=True)
class RelayContext:
    """A relay's Fourier plane at one wavelength: direction sines y (rows, 1) and x (1, columns) of its frequencies.

    relay: 0 between the modulators, 1 from the last one to the planes. iris_na: nominal, 1 where there is no iris.
    """

    relay: int
    wavelength_m: float
    sine_y: Tensor
    sine_x: Tensor
    iris_na: float

    @property
    def radius(self) -> Tensor:
        """Distance from the centre over the iris's nominal radius."""
        return torch.hypot(self.sine_y, self.sine_x) / self.iris_na

    @property
    def angle(self) -> Tensor:
        """Azimuth, from +x towards +y."""
        return torch.atan2(self.sine_y, self.sine_x)

    def zernike(self, terms: Mapping[int, float]) -> Tensor:
        """Σ c_j·Z_j of {Noll index: c_j} over the nominal iris, zero outside it."""
        return _zernike_sum(self.radius, self.angle, terms)

    def delayed(self, pupil: Tensor, opd_m: Tensor) -> Tensor:
        """The pupil with an optical path added."""
        phase = (2 * math.pi) * torch.remainder(opd_m / self.wavelength_m, 1.0)
        return pupil * torch.complex(torch.cos(phase), torch.sin(phase)).to(pupil.dtype)


@dataclass(frozen=True)
class CameraContext:
    """The camera: pixels of pitch_m (referred to the modulator's plane), rows and columns."""

    pitch_m: float
    shape: tuple[int, int]

    def positions(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Positions y (rows, 1) and x (1, columns) from the centre, ±1 at the picture's edges."""
        y, x = (centred_indices(n, image.dtype, image.device) / (n / 2) for n in self.shape)
        return y[:, None], x[None, :]

    places = old_method("places", "positions", positions)

    def blurred(self, image: Tensor, sigma_px: float | Tensor) -> Tensor:
        """The image convolved with a Gaussian of `sigma_px` pixels; edges go on outwards."""
        return gaussian_blur(image, sigma_px)

    def shifted(self, image: Tensor, shift_px: tuple[float, float]) -> Tensor:
        """The image moved by (y, x) pixels, linear between pixels; edges go on outwards."""
        return affine_warp(image, ((1.0, 0.0, -shift_px[0]), (0.0, 1.0, -shift_px[1])))


def _zernike_sum(radius: Tensor, angle: Tensor, terms: Mapping[int, float]) -> Tensor:
    total = torch.zeros_like(radius)
    for noll, value in terms.items():
        total = total + value * zernike(noll, radius, angle)
    return total
