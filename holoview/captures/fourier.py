"""A capture's intensity on a Fourier bench: the camera in the back focal plane of a lens behind one modulator.

    E(x) = Σ_j t_j · exp(−2πi·x·r_j/(λf)) · sinc(p·x/(λf)),  I = |E|²

The sum over the modulator's pixels is taken at the camera's pixels, wherever these lie; a pixel of pitch p is a square,
which gives the sinc. Out of focus by d, light from r has gone a path −d·|r|²/(2f²) further (paraxially).
"""

from __future__ import annotations

import math
from collections.abc import Hashable

import torch

from holoview.captures.cache import Cache
from holoview.captures.look import Pixels
from holoview.captures.near import Beam
from holoview.effects.apply import Applied
from holoview.effects.places import Pose, Surface
from holoview.optics.resample import centred, warped
from holoview.optics.slm import phasor
from holoview.optics.source import pixel_wave, plane_wave
from holoview.optics.zoom import fourier_sums
from holoview.plan import Plan

Tensor = torch.Tensor


class FourierBench:
    """Intensities on the camera. plan: of the bench as it is, its plane at focal_length_m + defocus."""

    def __init__(
        self,
        plan: Plan,
        applied: Applied,
        focal_length_m: float,
        iris_na: float | None,
        pixels: Pixels,
        dtype: torch.dtype,
        cache: Cache,
    ) -> None:
        self.plan, self.applied, self.focal_length_m, self.iris_na = plan, applied, focal_length_m, iris_na
        self.pixels, self.dtype, self.cache = pixels, dtype, cache
        self.real = torch.float64 if dtype == torch.complex128 else torch.float32

    def intensity(self, shares: Tensor, beam: Beam, capture: int) -> Tensor:
        """|E|² on the camera for shares of the stroke (1, y, x), one beam of unit power, mean pixel of 1 in all."""
        system = self.plan.system
        slopes = tuple(self.plan.slopes[beam.source, beam.wavelength].tolist())
        λ, plane = float(system.wavelengths_m[beam.wavelength]), float(self.plan.planes_m[0])
        hooks = self.applied.key("response", "path", "transmission", "aim")
        relay = system.relay2
        key: Hashable = ("fourier", capture, beam.factor, λ, plane, slopes, system.modulators[0].stroke_m, relay, hooks)
        return self.cache.get(key, lambda: self._seen(shares[0], beam, λ))

    def _seen(self, share: Tensor, beam: Beam, λ: float) -> Tensor:
        light, pose = self._light(share, beam, λ), self.applied.aim()
        if pose.rotation_rad == 0:
            return self._power(light, λ, self.pixels, pose)
        finer = self._fine(light, λ, pose)
        straight = self._power(light, λ, finer, Pose())
        (a, b, c), (d, e, f) = pose.inverse(finer.pitch_m)
        scale = self.pixels.pitch_m / finer.pitch_m
        source = ((a * scale, b * scale, c), (d * scale, e * scale, f))
        return warped(straight, source, mode="bicubic", shape=self.pixels.shape)

    def _light(self, share: Tensor, beam: Beam, λ: float) -> Tensor:
        """The field behind the modulator, of pixels or samples."""
        modulator = self.plan.system.modulators[0]
        pitch_m, shape, upsample = modulator.pitch_m, modulator.shape, self.plan.grid.upsample
        at = Surface(0, λ, modulator.stroke_m, pitch_m, shape, upsample)
        light = self.applied.light(share.to(self.real), at, self.dtype, beam.factor)
        if self.plan.slopes[beam.source, beam.wavelength].any():
            wave = pixel_wave if tuple(light.shape) == shape else plane_wave
            light = light * wave(self.plan, beam.wavelength, beam.source, self.dtype, light.device)
        defocus = float(self.plan.planes_m[0]) - self.focal_length_m
        if defocus:
            y, x = at.places(light)
            light = light * phasor(-defocus * (y.square() + x.square()) / (2 * self.focal_length_m**2), λ, self.dtype)
        return light

    def _power(self, light: Tensor, λ: float, pixels: Pixels, pose: Pose) -> Tensor:
        """|E|² at pixels in rows and columns of the modulator's directions; zero where a stop is in the way."""
        modulator = self.plan.system.modulators[0]
        pitch_m = modulator.pitch_m * modulator.shape[0] / light.shape[0]
        rows, field, sines = pose.inverse(pixels.pitch_m), light, []
        for axis in (0, 1):
            place = centred(pixels.shape[axis], torch.float64, light.device) * rows[axis][axis] + rows[axis][2]
            sine = place * (pixels.pitch_m / self.focal_length_m)
            cycles = sine * (pitch_m / λ)
            step = rows[axis][axis] * pixels.pitch_m / self.focal_length_m * pitch_m / λ
            field = fourier_sums(field.transpose(-2, -1), float(cycles[0]), step, pixels.shape[axis])
            envelope = torch.special.sinc(cycles) / light.shape[axis] ** 0.5
            field = field * envelope.to(self.real)
            sines.append(sine)
        return (field.real.square() + field.imag.square()) * self._passes(*sines)

    def _passes(self, sine_y: Tensor, sine_x: Tensor) -> Tensor:
        """1 where the iris and the DC block let light through to the camera."""
        radius2 = sine_y.square()[:, None] + sine_x.square()[None, :]
        passes = torch.ones_like(radius2, dtype=torch.bool)
        if self.iris_na is not None:
            passes &= radius2 <= self.iris_na**2
        if self.plan.system.relay2.dc_block_na is not None:
            passes &= radius2 > self.plan.system.relay2.dc_block_na**2
        return passes.to(self.real)

    def _fine(self, light: Tensor, λ: float, pose: Pose) -> Pixels:
        """Pixels over the camera, with some to spare, that sample the finest speckle four times."""
        extent = max(light.shape) * self.plan.system.modulators[0].pitch_m
        speckle = λ * self.focal_length_m / extent
        pitch_m = min(self.pixels.pitch_m, speckle / 4)
        seen = math.hypot(*self.pixels.shape) * self.pixels.pitch_m + 2 * math.hypot(*pose.shift_m)
        side = 1.05 * seen / pose.magnification / pitch_m
        return Pixels(pitch_m, (math.ceil(side), math.ceil(side)))
