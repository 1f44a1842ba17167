"""A capture's intensity on a Fourier bench: the camera in the back focal plane of a lens behind one modulator.

    E(x) = Σ_j t_j · exp(−2πi·x·r_j/(λf)) · sinc(p·x/(λf)),  I = |E|²

The sum over the modulator's pixels is taken at the camera's pixels, wherever these lie; a pixel of pitch p is a square,
which gives the sinc. Out of focus by d, light from r has gone a path −d·|r|²/(2f²) further (paraxially).
"""

from __future__ import annotations

import math
from collections.abc import Hashable

import torch

from holoview.captures.camera_sampling import PixelGrid
from holoview.captures.near_field_model import IncoherentComponent
from holoview.captures.tensor_cache import TensorCache
from holoview.model.effects.hook_contexts import ModulatorContext, Pose
from holoview.model.plan import Plan
from holoview.numerics.chirp_z import chirp_z_transform
from holoview.numerics.resample import affine_warp, centred_indices
from holoview.optics.slm import phasor
from holoview.optics.source import pixel_wave, plane_wave
from holoview.optics.torch_effects import TorchEffects

Tensor = torch.Tensor


class FourierBenchModel:
    """Intensities on the camera. plan: of the bench as it is, its plane at focal_length_m + defocus."""

    def __init__(
        self,
        plan: Plan,
        applied: TorchEffects,
        focal_length_m: float,
        iris_na: float | None,
        pixels: PixelGrid,
        dtype: torch.dtype,
        cache: TensorCache,
    ) -> None:
        self.plan, self.applied, self.focal_length_m, self.iris_na = plan, applied, focal_length_m, iris_na
        self.pixels, self.dtype, self.cache = pixels, dtype, cache
        self.real = torch.float64 if dtype == torch.complex128 else torch.float32

    def intensity(self, stroke_fractions: Tensor, component: IncoherentComponent, capture: int) -> Tensor:
        """|E|² on the camera for shares of the stroke (1, y, x), one beam of unit power, mean pixel of 1 in all."""
        system = self.plan.system
        slopes = tuple(self.plan.slopes[component.source_index, component.wavelength_index].tolist())
        λ, plane = float(system.wavelengths_m[component.wavelength_index]), float(self.plan.planes_m[0])
        hooks = self.applied.cache_key("stroke_response", "optical_path", "transmission", "camera_pose")
        relay = system.relay2
        key: Hashable = (
            "fourier",
            capture,
            component.path_factor,
            λ,
            plane,
            slopes,
            system.modulators[0].stroke_m,
            relay,
            hooks,
        )
        return self.cache.get(key, lambda: self._camera_intensity(stroke_fractions[0], component, λ))

    def _camera_intensity(self, share: Tensor, component: IncoherentComponent, λ: float) -> Tensor:
        light, pose = self._modulated_field(share, component, λ), self.applied.camera_pose()
        if pose.rotation_rad == 0:
            return self._intensity_at_pixels(light, λ, self.pixels, pose)
        finer = self._oversampled_pixels(light, λ, pose)
        straight = self._intensity_at_pixels(light, λ, finer, Pose())
        (a, b, c), (d, e, f) = pose.inverse_affine(finer.pitch_m)
        scale = self.pixels.pitch_m / finer.pitch_m
        source = ((a * scale, b * scale, c), (d * scale, e * scale, f))
        return affine_warp(straight, source, mode="bicubic", shape=self.pixels.shape)

    def _modulated_field(self, share: Tensor, component: IncoherentComponent, λ: float) -> Tensor:
        """The field behind the modulator, of pixels or samples."""
        modulator = self.plan.system.modulators[0]
        pitch_m, shape, upsample = modulator.pitch_m, modulator.shape, self.plan.grid.upsample
        at = ModulatorContext(0, λ, modulator.stroke_m, pitch_m, shape, upsample)
        light = self.applied.modulator_transmission(share.to(self.real), at, self.dtype, component.path_factor)
        if self.plan.slopes[component.source_index, component.wavelength_index].any():
            wave = pixel_wave if tuple(light.shape) == shape else plane_wave
            light = light * wave(
                self.plan, component.wavelength_index, component.source_index, self.dtype, light.device
            )
        defocus = float(self.plan.planes_m[0]) - self.focal_length_m
        if defocus:
            y, x = at.positions(light)
            light = light * phasor(-defocus * (y.square() + x.square()) / (2 * self.focal_length_m**2), λ, self.dtype)
        return light

    def _intensity_at_pixels(self, light: Tensor, λ: float, pixels: PixelGrid, pose: Pose) -> Tensor:
        """|E|² at pixels in rows and columns of the modulator's directions; zero where a stop is in the way."""
        modulator = self.plan.system.modulators[0]
        pitch_m = modulator.pitch_m * modulator.shape[0] / light.shape[0]
        rows, field, sines = pose.inverse_affine(pixels.pitch_m), light, []
        for axis in (0, 1):
            place = centred_indices(pixels.shape[axis], torch.float64, light.device) * rows[axis][axis] + rows[axis][2]
            sine = place * (pixels.pitch_m / self.focal_length_m)
            cycles = sine * (pitch_m / λ)
            step = rows[axis][axis] * pixels.pitch_m / self.focal_length_m * pitch_m / λ
            field = chirp_z_transform(field.transpose(-2, -1), float(cycles[0]), step, pixels.shape[axis])
            envelope = torch.special.sinc(cycles) / light.shape[axis] ** 0.5
            field = field * envelope.to(self.real)
            sines.append(sine)
        return (field.real.square() + field.imag.square()) * self._stop_mask(*sines)

    def _stop_mask(self, sine_y: Tensor, sine_x: Tensor) -> Tensor:
        """1 where the iris and the DC block let light through to the camera."""
        radius2 = sine_y.square()[:, None] + sine_x.square()[None, :]
        passes = torch.ones_like(radius2, dtype=torch.bool)
        if self.iris_na is not None:
            passes &= radius2 <= self.iris_na**2
        if self.plan.system.relay2.dc_block_na is not None:
            passes &= radius2 > self.plan.system.relay2.dc_block_na**2
        return passes.to(self.real)

    def _oversampled_pixels(self, light: Tensor, λ: float, pose: Pose) -> PixelGrid:
        """Pixels over the camera, with some to spare, that sample the finest speckle four times."""
        extent = max(light.shape) * self.plan.system.modulators[0].pitch_m
        speckle = λ * self.focal_length_m / extent
        pitch_m = min(self.pixels.pitch_m, speckle / 4)
        seen = math.hypot(*self.pixels.shape) * self.pixels.pitch_m + 2 * math.hypot(*pose.shift_m)
        side = 1.05 * seen / pose.magnification / pitch_m
        return PixelGrid(pitch_m, (math.ceil(side), math.ceil(side)))
