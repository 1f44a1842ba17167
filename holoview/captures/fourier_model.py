"""Camera intensity on a Fourier bench: the camera in the back focal plane of a lens behind one modulator.

    E(x) = Σ_j t_j · exp(−2πi·x·r_j/(λf)) · sinc(p·x/(λf)),  I = |E|²

t_j is the field behind the modulator at r_j, p the pitch of these points, f the focal length. The sum over the
modulator's pixels is evaluated directly at the camera's pixels; a modulator pixel is a uniform square, hence the sinc
(Goodman, Introduction to Fourier Optics, 3rd ed., section 5.2). A defocus d adds the optical path −d·|r|²/(2f²), in the
paraxial approximation.
"""

from __future__ import annotations

import math

import torch

from holoview.captures.camera_model import CameraModel, IncoherentComponent
from holoview.captures.camera_sampling import PixelGrid, squared_magnitude
from holoview.model.effects.effect import MODULATOR_HOOKS
from holoview.model.effects.hook_contexts import Pose
from holoview.numerics.fourier import chirp_z_transform
from holoview.numerics.resample import band_limited_warp, centred_indices
from holoview.optics.bench import illuminated
from holoview.optics.slm import phasor

Tensor = torch.Tensor
_SAMPLES_PER_SPECKLE = 4  # for the interpolation that a rotated camera needs
_SPARE_SAMPLES = 14  # that interpolation needs at the edges
_SPARE_WIDTH = 1.05  # of the finer grid, against the circle around the camera


class FourierBenchModel(CameraModel):
    """Intensities on the camera in the focal plane of a lens. The plan has its plane at focal_length_m + defocus."""

    def intensity(self, drive: Tensor, component: IncoherentComponent, capture: int) -> Tensor:
        """|E|² (y, x) on the camera for unit power in one component.

        Without stops and the sinc its mean over one period of the spectrum is 1. drive: the pattern of the capture as
        fractions of the stroke, (1, y, x). capture: its index, for the cache.
        """
        behind = (
            "behind the modulator",
            capture,
            component.path_factor,
            self.wavelength_m(component),
            self.slopes(component),
            self.plan.system.modulators[0].stroke_m,
            self.effects.cache_key(*MODULATOR_HOOKS, laser=component.laser),
        )
        plane_m, relay = float(self.plan.planes_m[0]), self.plan.system.relay2
        pose = self.effects.cache_key("camera_pose", "camera_pose_at", laser=component.laser)

        def compute() -> Tensor:
            field = self.cache.get(behind, lambda: self._field(drive, component))
            return self._camera_intensity(self._defocused(field, component), component)

        return self.cache.get(("fourier", *behind, plane_m, relay, pose), compute)

    def _camera_intensity(self, field: Tensor, component: IncoherentComponent) -> Tensor:
        λ = self.wavelength_m(component)
        pose = self.effects.camera_pose(float(self.plan.planes_m[0]) - self.focal_length_m)
        if pose.rotation_rad == 0:
            return self._intensity_at_pixels(field, λ, self.pixel_grid, pose)
        finer = self._finer_grid(field, λ, pose)
        unrotated = self._intensity_at_pixels(field, λ, finer, Pose())
        (a, b, c), (d, e, f) = pose.inverse_affine(finer.pitch_m)
        scale = self.pixel_grid.pitch_m / finer.pitch_m
        source = ((a * scale, b * scale, c), (d * scale, e * scale, f))
        return band_limited_warp(unrotated, source, self.pixel_grid.shape)

    def _field(self, drive: Tensor, component: IncoherentComponent) -> Tensor:
        """The field behind the modulator, of pixels or samples."""
        transmission = self.transmission(drive, 0, component)
        return illuminated(self.plan, component.wavelength, component.source, transmission)

    def _defocused(self, field: Tensor, component: IncoherentComponent) -> Tensor:
        """The field behind the modulator with the phase of the defocus, a function of y times one of x."""
        defocus_m = float(self.plan.planes_m[0]) - self.focal_length_m
        if not defocus_m:
            return field
        context = self.context(0, component)
        for position in context.positions(field):
            path_m = -defocus_m * position.square() / (2 * self.focal_length_m**2)
            field = field * phasor(path_m, context.wavelength_m, self.dtype)
        return field

    def _intensity_at_pixels(self, field: Tensor, λ: float, pixel_grid: PixelGrid, pose: Pose) -> Tensor:
        """|E|² at pixels whose rows and columns are parallel to the modulator's; zero where a stop blocks the light."""
        modulator = self.plan.system.modulators[0]
        pitch_m = modulator.pitch_m * modulator.shape[0] / field.shape[0]
        affine, light, sines = pose.inverse_affine(pixel_grid.pitch_m), field, []
        for axis in (0, 1):
            pixels = centred_indices(pixel_grid.shape[axis], torch.float64, field.device)
            scale, offset = affine[axis][axis], affine[axis][2]
            sine = (pixels * scale + offset) * (pixel_grid.pitch_m / self.focal_length_m)
            cycles = sine * (pitch_m / λ)  # per point of the field
            step = scale * pixel_grid.pitch_m / self.focal_length_m * pitch_m / λ
            light = chirp_z_transform(light.transpose(-2, -1), float(cycles[0]), step, pixel_grid.shape[axis])
            envelope = torch.special.sinc(cycles) / field.shape[axis] ** 0.5
            light = light * envelope.to(self.real_dtype)
            sines.append(sine)
        return squared_magnitude(light) * self._stop_mask(λ, *sines)

    def _stop_mask(self, λ: float, sine_y: Tensor, sine_x: Tensor) -> Tensor:
        """1 where the stops pass light to the camera, 0 elsewhere, (rows, columns)."""
        sine2 = sine_y.square()[:, None] + sine_x.square()[None, :]
        passes = torch.ones_like(sine2, dtype=torch.bool)
        y, x = (sine - centre for sine, centre in zip((sine_y, sine_x), self.relays[1].centre_na, strict=True))
        if self.relays[1].iris_na is not None:
            passes &= y.square()[:, None] + x.square()[None, :] <= self.relays[1].iris_na ** 2
        if self.relays[1].square is not None:
            half = self.relays[1].square.half_side_sine(λ, self.plan.system.modulators[0].pitch_m)
            passes &= (y.abs()[:, None] < half) & (x.abs()[None, :] < half)
        if self.plan.system.relay2.dc_block_na is not None:
            passes &= sine2 > self.plan.system.relay2.dc_block_na**2
        return passes.to(self.real_dtype)

    def _finer_grid(self, field: Tensor, λ: float, pose: Pose) -> PixelGrid:
        """A square grid that covers the rotated camera, with at least _SAMPLES_PER_SPECKLE samples in a speckle."""
        modulator_width_m = max(field.shape) * self.plan.system.modulators[0].pitch_m
        speckle_m = λ * self.focal_length_m / modulator_width_m
        pitch_m = min(self.pixel_grid.pitch_m, speckle_m / _SAMPLES_PER_SPECKLE)
        reach_m = math.hypot(*self.pixel_grid.shape) * self.pixel_grid.pitch_m + 2 * math.hypot(*pose.shift_m)
        samples = math.ceil(_SPARE_WIDTH * reach_m / pose.magnification / pitch_m) + _SPARE_SAMPLES
        return PixelGrid(pitch_m, (samples, samples))
