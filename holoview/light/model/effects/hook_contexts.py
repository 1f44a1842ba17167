"""The modulator, relay or camera on which a hook acts: wavelength, pitch, coordinates, and tools for its maps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch

from holoview.light.numerics.resample import (
    AffineRows,
    affine_warp,
    centred_indices,
    gaussian_blur,
    upsample_nearest,
    weighted_blur,
)
from holoview.light.numerics.sampling import first_of_part
from holoview.light.numerics.surfaces import zernike_sum

Tensor = torch.Tensor


@dataclass(frozen=True)
class Pose:
    """The position of a modulator or of the camera relative to its nominal one.

    A point that should be at r is at magnification · R(rotation)·r + shift.

    shift_m: (y, x), m.
    rotation_rad: about the centre; positive from +x towards +y.
    magnification: 1 when nominal.
    softness: fraction of a picture that was rectified by linear interpolation between pixels, which blurs it.
    """

    shift_m: tuple[float, float] = (0.0, 0.0)
    rotation_rad: float = 0.0
    magnification: float = 1.0
    softness: float = 0.0

    @property
    def is_identity(self) -> bool:
        """Whether the position is nominal."""
        return self == Pose()

    def inverse_affine(self, pitch_m: float) -> AffineRows:
        """Rows (y, x, 1) of the affine map from a point's position to its nominal position, in samples."""
        c, s = (f(self.rotation_rad) / self.magnification for f in (math.cos, math.sin))
        dy, dx = (shift / pitch_m for shift in self.shift_m)
        return (c, -s, -(c * dy - s * dx)), (s, c, -(s * dy + c * dx))

    def about(self, centre_m: tuple[float, float]) -> Pose:
        """The same position for points whose places count from `centre_m` (y, x), not from the centre."""
        if self.is_identity or not any(centre_m):
            return self
        (y, x), c, s = centre_m, *(self.magnification * f(self.rotation_rad) for f in (math.cos, math.sin))
        moved = (c * y + s * x - y, c * x - s * y - x)
        return replace(self, shift_m=(self.shift_m[0] + moved[0], self.shift_m[1] + moved[1]))


@dataclass(frozen=True)
class ModulatorContext:
    """A modulator at one wavelength.

    Maps have an entry for each pixel until an effect needs samples, which `sampled` makes.

    number: 0 for the first modulator.
    element: of a chain, the name of the element; empty for the light before the first one, and of a short form.
    wavelength_m, stroke_m, pitch_m: with the effects on the system.
    shape: (rows, columns) of pixels.
    upsample: samples along each side of a pixel.
    laser: number of the laser that is on, 0 for the shortest wavelength of the bench or session.
    frame: (rows, columns) of the modulator that these pixels are a part of; their own where None.
    centre_m: (y, x), where these pixels' centre is in that modulator.
    first_shown: share of the stroke (rows, columns) of the first pattern of all, for `settled_share`; None elsewhere.
    shown: share of the stroke (rows, columns) that the pixels show, for `transmission`; None elsewhere.
    """

    number: int
    wavelength_m: float
    stroke_m: float
    pitch_m: float
    shape: tuple[int, int]
    upsample: int
    laser: int = 0
    frame: tuple[int, int] | None = None
    centre_m: tuple[float, float] = (0.0, 0.0)
    first_shown: Tensor | None = None
    shown: Tensor | None = None
    element: str = ""

    @property
    def whole_shape(self) -> tuple[int, int]:
        """Rows and columns of the whole modulator."""
        return self.frame or self.shape

    @property
    def first_pixel(self) -> tuple[int, int]:
        """Row and column of the first pixel, counted in the whole modulator."""
        return first_of_part(self.whole_shape, self.shape, self.centre_m, self.pitch_m)

    def even(self) -> Tensor:
        """A map (rows, columns) of ones in double precision, on the processor."""
        return torch.ones(self.shape, dtype=torch.float64)

    def sampled(self, values: Tensor) -> Tensor:
        """A map of pixels as a map of samples, each pixel a square of equal ones; a map of samples unchanged."""
        is_sampled = tuple(values.shape) != self.shape
        return values if is_sampled or self.upsample == 1 else upsample_nearest(values, self.upsample)

    def positions(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Positions y (rows, 1) and x (1, columns) of a map's entries, in metres from the modulator's centre."""
        step = self.pitch_m if tuple(values.shape) == self.shape else self.pitch_m / self.upsample
        real = values.real.dtype
        return tuple(  # type: ignore[return-value]
            centred_indices(n, real, values.device).reshape(view) * step + centre
            for n, view, centre in zip(values.shape, ((-1, 1), (1, -1)), self.centre_m, strict=True)
        )

    def zernike(
        self,
        values: Tensor,
        terms: Mapping[int, Any],
        centre_m: tuple[Any, Any] = (0.0, 0.0),
        radius_m: Any = None,
    ) -> Tensor:
        """Σ c_j·Z_j over a circle, at a map's entries; beyond it the polynomials go on. terms: {Noll index j: c_j}.

        centre_m (y, x), radius_m: of the circle; that around the modulator where None. Each number may be a tensor.
        """
        y, x = (place - centre for place, centre in zip(self.positions(values), centre_m, strict=True))
        return zernike_sum(
            terms.items(),
            torch.hypot(y, x) / (self.circle_radius() if radius_m is None else radius_m),
            torch.atan2(y, x),
        )

    def circle_radius(self) -> float:
        """Radius of the circle around the modulator, m."""
        return math.hypot(*self.whole_shape) * self.pitch_m / 2

    def half_width(self) -> float:
        """Half the longer side of the modulator, m."""
        return max(self.whole_shape) * self.pitch_m / 2

    def blurred(self, values: Tensor, sigma_px: float | Tensor) -> Tensor:
        """The map, as samples, convolved with a Gaussian of `sigma_px` modulator pixels; edges are continued."""
        return gaussian_blur(self.sampled(values), sigma_px * self.upsample)

    def averaged_pixels(self, values: Tensor, neighbour: float | Tensor) -> Tensor:
        """A map of pixels of which each becomes a mean, in which one n pixels away weighs neighbour^(n²)."""
        return weighted_blur(values, neighbour)

    def warped(self, values: Tensor, pose: Pose) -> Tensor:
        """The map, as samples, of a modulator with this pose; linear between samples, edges are continued."""
        return affine_warp(self.sampled(values), pose.about(self.centre_m).inverse_affine(self.pitch_m / self.upsample))


@dataclass(frozen=True)
class RelayContext:
    """The Fourier plane of a relay at one wavelength.

    relay: 0 between the modulators, 1 behind the last one.
    sine_y, sine_x: direction sines λu of the frequencies, (rows, 1) and (1, columns).
    pupil_radius: of the nominal pupil, a direction sine: of the iris, or of the circle through the corners of a
    square stop; 1 without a stop.
    centre: direction sine (y, x) of the nominal pupil's centre.
    names: of the elements of a chain that the relay is; empty of a short form.
    """

    relay: int
    wavelength_m: float
    sine_y: Tensor
    sine_x: Tensor
    pupil_radius: float
    centre: tuple[float, float] = (0.0, 0.0)
    names: tuple[str, ...] = ()

    @property
    def sines_from_centre(self) -> tuple[Tensor, Tensor]:
        """Direction sines of the frequencies relative to the centre, (rows, 1) and (1, columns)."""
        return self.sine_y - self.centre[0], self.sine_x - self.centre[1]

    @property
    def radius(self) -> Tensor:
        """Distance from the centre in radii of the nominal pupil, (rows, columns)."""
        return torch.hypot(*self.sines_from_centre) / self.pupil_radius

    @property
    def angle(self) -> Tensor:
        """Azimuth around the centre in radians, from +x towards +y, (rows, columns)."""
        return torch.atan2(*self.sines_from_centre)

    def zernike(self, terms: Mapping[int, float]) -> Tensor:
        """Σ c_j·Z_j over the nominal pupil, beyond which the polynomials go on; terms: {Noll index j: c_j}."""
        return zernike_sum(terms.items(), self.radius, self.angle)

    def delayed(self, pupil: Tensor, opd_m: Tensor) -> Tensor:
        """The pupil times exp(2πi·opd/λ)."""
        phase = (2 * math.pi) * torch.remainder(opd_m / self.wavelength_m, 1.0)
        return pupil * torch.complex(torch.cos(phase), torch.sin(phase)).to(pupil.dtype)


@dataclass(frozen=True)
class CameraContext:
    """The camera in one capture.

    pitch_m: of its pixels, referred to the plane of the modulator.
    shape: (rows, columns).
    wavelength_m: of the laser that is on.
    laser: its number among the lasers of the session, 0 for the shortest wavelength.
    frame: (rows, columns) of the picture that this image is a part of; its own where None.
    centre_m: (y, x), where this image's centre is in that picture.
    """

    pitch_m: float
    shape: tuple[int, int]
    wavelength_m: float = 550e-9
    laser: int = 0
    frame: tuple[int, int] | None = None
    centre_m: tuple[float, float] = (0.0, 0.0)

    def positions(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Positions y (rows, 1) and x (1, columns) of the pixels from the centre, ±1 at the edges of the frame."""
        sizes = zip(self.shape, self.frame or self.shape, self.centre_m, strict=True)
        y, x = (
            (centred_indices(n, image.dtype, image.device) + centre / self.pitch_m) / (whole / 2)
            for n, whole, centre in sizes
        )
        return y[:, None], x[None, :]

    def blurred(self, image: Tensor, sigma_px: float | Tensor) -> Tensor:
        """The image convolved with a Gaussian of `sigma_px` pixels; edges are continued."""
        return gaussian_blur(image, sigma_px)

    def shifted(self, image: Tensor, shift_px: tuple[float, float]) -> Tensor:
        """The image shifted by (y, x) pixels, linear between pixels; edges are continued."""
        return affine_warp(image, ((1.0, 0.0, -shift_px[0]), (0.0, 1.0, -shift_px[1])))
