"""A capture's intensity in the near field: modulators, gap, relay, plane; only frequencies that pass are computed.

    V = F[s·t₁],  E₁ = F⁻¹[V·H_gap·P₁],  W = F[E₁·t₂],  E = F⁻¹[W·H_z·P₂],  I = |E|²      (one modulator: W = V)

t are the modulators' transmissions, s the illumination, H and P what free space and the relays do.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import torch

from holoview.captures.camera_sampling import PixelGrid, sample_intensity
from holoview.captures.frequency_band import FrequencyBand
from holoview.captures.tensor_cache import TensorCache
from holoview.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.model.plan import Plan
from holoview.optics.propagate import transfer_function_at
from holoview.optics.pupil import nominal_pupil
from holoview.optics.slm import pixel_spectrum
from holoview.optics.source import pixel_wave, plane_wave
from holoview.optics.torch_effects import TorchEffects

Tensor = torch.Tensor


@dataclass(frozen=True)
class IncoherentComponent:
    """One of what adds in intensity: a wavelength and a source direction of a plan, and a factor of optical paths."""

    wavelength_index: int
    source_index: int
    path_factor: float


class NearFieldModel:
    """Intensities at one plane on the camera. plan: of the bench as it is; irises: nominal apertures of both relays."""

    def __init__(
        self,
        plan: Plan,
        applied: TorchEffects,
        iris_nas: tuple[float | None, float | None],
        pixels: PixelGrid,
        dtype: torch.dtype,
        cache: TensorCache,
    ) -> None:
        self.plan, self.applied, self.irises, self.pixels = plan, applied, iris_nas, pixels
        self.dtype, self.cache = dtype, cache
        self.real = torch.float64 if dtype == torch.complex128 else torch.float32

    def intensity(self, stroke_fractions: Tensor, component: IncoherentComponent, capture: int) -> Tensor:
        """|E|² on the camera for shares of the stroke (modulator, y, x), one beam of unit power."""
        spectrum, band, key = self._last_spectrum(stroke_fractions, component, capture)
        key = (*key, "seen", self._relay_key(1, component), self.applied.cache_key("camera_pose"))
        response = self._relay_transfer(1, component, band)

        def seen() -> Tensor:
            return sample_intensity(spectrum * response, band, self.plan.grid, self.pixels, self.applied.camera_pose())

        return self.cache.get(key, seen)

    # --- the way of the light ---------------------------------------------------------------------------------------

    def _last_spectrum(
        self, shares: Tensor, component: IncoherentComponent, capture: int
    ) -> tuple[Tensor, FrequencyBand, tuple[Hashable, ...]]:
        """Spectrum behind the last modulator in the last relay's band."""
        key: tuple[Hashable, ...] = (
            capture,
            component.path_factor,
            self._modulator_key(0, component),
            self._illumination_key(component),
        )
        last = self._band(1, component)
        if self.plan.system.gap_m is None:
            return self._first_spectrum(shares[0], component, last, capture), last, key
        band = self._band(0, component)
        arriving_key = (*key, "arriving", self._relay_key(0, component))
        key = (*arriving_key, self._modulator_key(1, component))

        def arriving() -> Tensor:
            spectrum = self._first_spectrum(shares[0], component, band, capture) * self._relay_transfer(
                0, component, band
            )
            return band.inverse(spectrum, self.plan.grid.shape)

        def spectrum() -> Tensor:
            field = self.cache.get(arriving_key, arriving)
            return last.forward(field * self._modulated_field(shares[1], 1, component, capture))

        return self.cache.get((*key, "last", last), spectrum), last, key

    def _first_spectrum(
        self, share: Tensor, component: IncoherentComponent, band: FrequencyBand, capture: int
    ) -> Tensor:
        """Spectrum behind the first modulator, kept."""
        key = (
            "first",
            capture,
            component.path_factor,
            self._modulator_key(0, component),
            self._illumination_key(component),
            band,
        )
        return self.cache.get(key, lambda: self._compute_first_spectrum(share, component, band, capture))

    def _compute_first_spectrum(
        self, share: Tensor, component: IncoherentComponent, band: FrequencyBand, capture: int
    ) -> Tensor:
        """Spectrum behind the first modulator, of pixels as long as no effect needs samples."""
        light, grid = self._modulated_field(share, 0, component, capture), self.plan.grid
        slopes = self.plan.slopes[component.source_index, component.wavelength_index]
        tilted = bool(slopes.any())
        if tuple(light.shape) != tuple(share.shape):
            if tilted:
                light = light * plane_wave(
                    self.plan, component.wavelength_index, component.source_index, self.dtype, light.device
                )
            return band.forward(light)
        if tilted:
            light = light * pixel_wave(
                self.plan, component.wavelength_index, component.source_index, self.dtype, light.device
            )
        coarse = tuple(p // grid.upsample for p in grid.padded)
        (rows, above), (columns, along) = (self._pixel_spectrum(axis, float(slopes[axis]), band) for axis in (0, 1))
        lines = torch.fft.fft(light, n=coarse[1], dim=1).index_select(1, columns) * along
        return torch.fft.fft(lines, n=coarse[0], dim=0).index_select(0, rows) * above[:, None]

    def _pixel_spectrum(self, axis: int, slope: float, band: FrequencyBand) -> tuple[Tensor, Tensor]:
        """For each frequency of a band's side: where it is in the spectrum of pixels, and what a pixel makes of it."""
        padded, upsample, k = self.plan.grid.padded[axis], self.plan.grid.upsample, band.frequency_indices[axis]
        place = self.cache.get(("place", axis, upsample, band), lambda: k % (padded // upsample))
        response = self.cache.get(
            ("pixel", axis, upsample, slope, band), lambda: pixel_spectrum(padded, upsample, slope).to(self.dtype)[k]
        )
        return place, response

    def _surface(self, number: int, component: IncoherentComponent) -> ModulatorContext:
        system = self.plan.system
        modulator = system.modulators[number]
        return ModulatorContext(
            number=number,
            wavelength_m=float(system.wavelengths_m[component.wavelength_index]),
            stroke_m=modulator.stroke_m,
            pitch_m=modulator.pitch_m,
            shape=modulator.shape,
            upsample=self.plan.grid.upsample,
        )

    def _modulated_field(self, share: Tensor, number: int, component: IncoherentComponent, capture: int) -> Tensor:
        """What a modulator makes of light, for every direction of the source; of samples but for the first."""

        def light() -> Tensor:
            surface = self._surface(number, component)
            made = self.applied.modulator_transmission(share.to(self.real), surface, self.dtype, component.path_factor)
            return surface.sampled(made) if number else made

        return self.cache.get(("light", capture, component.path_factor, self._modulator_key(number, component)), light)

    # --- relays -----------------------------------------------------------------------------------------------------

    def _distance(self, relay: int) -> float:
        system = self.plan.system
        return float(self.plan.planes_m[0]) if relay else float(system.gap_m or 0.0)

    def _band(self, relay: int, component: IncoherentComponent) -> FrequencyBand:
        return FrequencyBand.from_transfer(
            self.plan.transfer(relay, component.wavelength_index, self._distance(relay)), self.plan.grid
        )

    def _relay_transfer(self, relay: int, component: IncoherentComponent, band: FrequencyBand) -> Tensor:
        """H × pupil in the band."""

        step = self.plan.transfer(relay, component.wavelength_index, self._distance(relay))
        ky, kx = band.frequency_indices

        def nominal() -> Tensor:
            response = transfer_function_at(step, ky, kx, torch.complex128)
            glass = nominal_pupil(self.plan, relay, component.wavelength_index, torch.complex128, torch.device("cpu"))
            return response if glass is None else response * glass[ky][:, kx]

        def make() -> Tensor:
            place = ("nominal", relay, step.wavelength_m, step.distance_m, self.plan.relays[relay], band)
            response = self.cache.get_invariant(place, nominal)
            sines = [k.double() * s for k, s in zip((ky, kx), step.sine_step, strict=True)]
            at = RelayContext(relay, step.wavelength_m, sines[0][:, None], sines[1][None], self.irises[relay] or 1.0)
            added = self.applied.pupil(at, torch.complex128)
            return (response if added is None else response * added).to(self.dtype)

        return self.cache.get(("response", self._relay_key(relay, component), band), make)

    # --- what results depend on -------------------------------------------------------------------------------------

    def _modulator_key(self, number: int, component: IncoherentComponent) -> Hashable:
        system = self.plan.system
        hooks = self.applied.cache_key(
            "stroke_response", "optical_path", "transmission", "slm2_pose", acts_on=f"modulator {number + 1}"
        )
        source = self.applied.cache_key("transmission", acts_on="source") if number == 0 else ()
        return (
            number,
            float(system.wavelengths_m[component.wavelength_index]),
            system.modulators[number].stroke_m,
            hooks,
            source,
        )

    def _illumination_key(self, component: IncoherentComponent) -> Hashable:
        return tuple(self.plan.slopes[component.source_index, component.wavelength_index].tolist())

    def _relay_key(self, relay: int, component: IncoherentComponent) -> Hashable:
        λ = float(self.plan.system.wavelengths_m[component.wavelength_index])
        hooks = self.applied.cache_key("pupil", acts_on=f"relay {relay + 1}")
        return relay, λ, self._distance(relay), self.plan.relays[relay], hooks
