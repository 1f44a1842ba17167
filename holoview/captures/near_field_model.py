"""Camera intensity in the near field: modulators, gap, relays and free space, for the frequencies that relays pass.

The elements of the bench are those of `optics.bench`, in the order of `engine.frame`. Each stage gives its light with a
key that names all values it depends on, so that light is computed only if its key isn't in the cache.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import lru_cache

import torch

from holoview.captures.camera_model import CameraModel, IncoherentComponent, Key
from holoview.captures.camera_sampling import FrequencyBand, sample_intensity
from holoview.engine.frame import relay_behind, spectrum_behind_modulators
from holoview.model.effects.hook_contexts import RelayContext
from holoview.model.plan import Grid
from holoview.model.transfer import Transfer
from holoview.optics.bench import PixelAxis, illuminated, plane_wave, relay_response, spectrum_of_pixels
from holoview.optics.propagate import nominal_pupil

Tensor = torch.Tensor


class NearFieldModel(CameraModel):
    """Intensities on the camera behind relays and free space."""

    def intensity(self, drive: Tensor, component: IncoherentComponent, capture: int) -> Tensor:
        """|E|² (y, x) on the camera for unit power in one component.

        drive: patterns of the capture as fractions of the stroke, (modulator, y, x). capture: its index, for the cache.
        """
        stages, distance_m = _Stages(self, drive, component, capture), float(self.plan.planes_m[0])
        last = spectrum_behind_modulators(stages, component.wavelength, 0, component.source)
        seen = stages.transmit(last, 1, component.wavelength, distance_m)
        pose_key = self.effects.cache_key("camera_pose", "camera_pose_at")

        def compute() -> Tensor:
            pose = self.effects.camera_pose(distance_m)
            return sample_intensity(seen.values(), self.band(1, component), self.plan.grid, self.pixel_grid, pose)

        return self.cache.get((*seen.key, "intensity", pose_key), compute)

    # --- relays -----------------------------------------------------------------------------------------------------

    def band(self, relay: int, component: IncoherentComponent) -> FrequencyBand:
        """The frequencies that pass a relay."""
        return FrequencyBand.from_transfer(self._transfer(relay, component), self.plan.grid)

    def relay_key(self, relay: int, component: IncoherentComponent) -> Hashable:
        """Names all values that the factor of a relay depends on."""
        hooks = self.effects.cache_key("pupil", acts_on=f"relay {relay + 1}")
        return relay, self.wavelength_m(component), self._distance_m(relay), self.plan.relays[relay], hooks

    def relay_factor(self, relay: int, component: IncoherentComponent) -> Tensor:
        """Transfer function × pupil in the band of a relay, (rows, columns)."""
        transfer, band = self._transfer(relay, component), self.band(relay, component)
        ky, kx = band.frequency_indices

        def without_effects() -> Tensor:
            pupil = nominal_pupil(self.plan, relay, component.wavelength, torch.complex128, torch.device("cpu"))
            return relay_response(transfer, ky, kx, pupil, torch.complex128)

        def compute() -> Tensor:
            key = ("nominal", relay, transfer.wavelength_m, transfer.distance_m, self.plan.relays[relay], band)
            response = self.cache.get_invariant(key, without_effects)
            sine_y, sine_x = (k.double() * s for k, s in zip((ky, kx), transfer.sine_step, strict=True))
            λ, nominal = transfer.wavelength_m, self.relays[relay]
            radius = nominal.pupil_radius_sine(λ, self.plan.nominal.modulators[0].pitch_m)
            context = RelayContext(relay, λ, sine_y[:, None], sine_x[None], radius, nominal.centre_na)
            pupil = self.effects.pupil(context, torch.complex128)
            return (response if pupil is None else response * pupil).to(self.dtype)

        return self.cache.get(("relay", self.relay_key(relay, component), band), compute)

    def _distance_m(self, relay: int) -> float:
        return float(self.plan.planes_m[0]) if relay else float(self.plan.system.gap_m or 0.0)

    def _transfer(self, relay: int, component: IncoherentComponent) -> Transfer:
        return self.plan.transfer(relay, component.wavelength, self._distance_m(relay))


@dataclass(frozen=True)
class _Light:
    """A field (y, x) or a spectrum in a relay's band. key: names all values that it depends on."""

    key: Key
    values: Callable[[], Tensor]


class _Stages:
    """The stages of `engine.frame` for one component of a capture. Arguments as of `NearFieldModel.intensity`."""

    def __init__(self, model: NearFieldModel, drive: Tensor, component: IncoherentComponent, capture: int) -> None:
        self.plan, self._model, self._drive = model.plan, model, drive
        self._component, self._capture = component, capture

    def illuminate(self, wavelength: int, source: int) -> _Light:
        """The plane wave that illuminates the first modulator."""
        key, dtype = (self._capture, self._model.slopes(self._component)), self._model.dtype
        return _Light(key, lambda: plane_wave(self.plan, wavelength, source, dtype, torch.device("cpu")))

    def modulate(self, field: _Light, frame: int, modulator: int, wavelength: int) -> _Light:
        """field × the modulator's transmission: samples, or for the first modulator pixels if effects leave them."""
        key = (*field.key, self._model.modulator_key(modulator, self._component))
        if modulator == 0:  # the wave is needed at pixels or at samples, as the transmission is
            source = self._component.source
            return _Light(key, lambda: illuminated(self.plan, wavelength, source, self._transmission(0)))
        return _Light(key, lambda: field.values() * self._transmission(1))

    def spectrum(self, field: _Light, modulator: int) -> _Light:
        """The spectrum in the band of the next relay."""
        band = self._model.band(relay_behind(self.plan, modulator), self._component)
        key = (*field.key, "spectrum", band)

        def compute() -> Tensor:
            light, grid = field.values(), self.plan.grid
            if modulator or tuple(light.shape) != self.plan.system.modulators[0].shape:
                return band.forward(light)
            slopes = self._model.slopes(self._component)
            return spectrum_of_pixels(light, [_pixel_axis(grid, i, slopes[i], band, light.dtype) for i in (0, 1)])

        return _Light(key, lambda: self._model.cache.get(key, compute))

    def transmit(self, spectrum: _Light, relay: int, wavelength: int, distance_m: float) -> _Light:
        """spectrum × transfer function × pupil."""
        key = (*spectrum.key, self._model.relay_key(relay, self._component))
        return _Light(key, lambda: spectrum.values() * self._model.relay_factor(relay, self._component))

    def field(self, spectrum: _Light, relay: int) -> _Light:
        """The field at the second modulator."""
        key, band = (*spectrum.key, "field"), self._model.band(relay, self._component)
        return _Light(
            key,
            lambda: self._model.cache.get(key, lambda: band.inverse(spectrum.values(), self.plan.grid.shape)),
        )

    def _transmission(self, number: int) -> Tensor:
        """Complex transmission of a modulator: of samples for the second, of pixels if possible for the first."""
        model, component = self._model, self._component

        def compute() -> Tensor:
            found = model.transmission(self._drive, number, component)
            return model.context(number, component).sampled(found) if number else found

        return model.cache.get(("transmission", self._capture, model.modulator_key(number, component)), compute)


@lru_cache(maxsize=256)
def _pixel_axis(grid: Grid, axis: int, slope: float, band: FrequencyBand, dtype: torch.dtype) -> PixelAxis:
    return PixelAxis.at(grid, axis, slope, band.frequency_indices[axis], dtype)
