"""Camera intensity in the near field: modulators, gap, relays and free space, for the frequencies that relays pass.

    V = F[s·t₁],  E₁ = F⁻¹[V·H₁·P₁],  W = F[E₁·t₂],  E = F⁻¹[W·H₂·P₂],  I = |E|²      (one modulator: W = V)

s is the illumination, t₁ and t₂ are the modulators' complex transmissions, H₁ and H₂ the transfer functions of free
space over the gap and to the camera (angular spectrum, `optics.propagate`), P₁ and P₂ the pupils of the relays. F is
the discrete Fourier transform. Indices count from 0: relay 0 lies between the modulators, relay 1 behind the last one.
"""

from __future__ import annotations

from collections.abc import Hashable

import torch

from holoview.captures.camera_sampling import FrequencyBand, PixelGrid, sample_intensity
from holoview.captures.incoherent_component import IncoherentComponent
from holoview.captures.tensor_cache import TensorCache
from holoview.model.bench_parts import Relay
from holoview.model.effects.effect import MODULATOR_HOOKS
from holoview.model.effects.hook_contexts import RelayContext
from holoview.model.plan import Plan
from holoview.model.transfer import Transfer
from holoview.optics.propagate import nominal_pupil, transfer_function_at
from holoview.optics.slm import pixel_spectrum
from holoview.optics.torch_effects import TorchEffects

Tensor = torch.Tensor
Key = tuple[Hashable, ...]


class NearFieldModel:
    """Intensities on the camera at the first plane of a plan.

    plan: of the bench with its effects on distances, angles, wavelengths and apertures. effects: their other hooks.
    relays: the nominal relays 1 and 2, whose stops normalise pupil coordinates.
    cache: keeps intermediate fields; a key names all values that its field depends on.
    earlier: what was sent before a pattern, and first of all, each as its drive; None where no effect asks for it.
    """

    def __init__(
        self,
        plan: Plan,
        effects: TorchEffects,
        relays: tuple[Relay, Relay],
        pixel_grid: PixelGrid,
        dtype: torch.dtype,
        cache: TensorCache,
        earlier: tuple[Tensor, Tensor] | None = None,
    ) -> None:
        self.plan, self.effects, self.relays, self.pixel_grid = plan, effects, relays, pixel_grid
        self.dtype, self.cache, self.earlier = dtype, cache, earlier
        self.real_dtype = torch.float64 if dtype == torch.complex128 else torch.float32

    def intensity(self, drive: Tensor, component: IncoherentComponent, capture: int) -> Tensor:
        """|E|² (y, x) on the camera for unit power in one component.

        drive: patterns of the capture as fractions of the stroke, (modulator, y, x). capture: its index, for the cache.
        """
        spectrum, band, key = self._last_spectrum(drive, component, capture)
        pose_key = self.effects.cache_key("camera_pose", "camera_pose_at")
        key = (*key, "intensity", self._relay_key(1, component), pose_key)
        transfer = self._relay_transfer(1, component, band)

        def compute() -> Tensor:
            pose = self.effects.camera_pose(float(self.plan.planes_m[0]))
            return sample_intensity(spectrum * transfer, band, self.plan.grid, self.pixel_grid, pose)

        return self.cache.get(key, compute)

    # --- modulators -------------------------------------------------------------------------------------------------

    def _last_spectrum(
        self, drive: Tensor, component: IncoherentComponent, capture: int
    ) -> tuple[Tensor, FrequencyBand, Key]:
        """Spectrum behind the last modulator in the band of the last relay, that band, and the key of the spectrum."""
        last_band = self._band(1, component)
        first_key = self._first_key(component, capture)
        if self.plan.system.gap_m is None:
            return self._first_spectrum(drive[0], component, last_band, capture), last_band, first_key
        gap_band = self._band(0, component)
        arriving_key = (*first_key, "arriving", self._relay_key(0, component))
        key = (*arriving_key, self._modulator_key(1, component))

        def arriving_field() -> Tensor:
            spectrum = self._first_spectrum(drive[0], component, gap_band, capture)
            return gap_band.inverse(spectrum * self._relay_transfer(0, component, gap_band), self.plan.grid.shape)

        def last_spectrum() -> Tensor:
            field = self.cache.get(arriving_key, arriving_field)
            return last_band.forward(field * self._transmission(drive[1], 1, component, capture))

        return self.cache.get((*key, "last", last_band), last_spectrum), last_band, key

    def _first_spectrum(
        self, drive: Tensor, component: IncoherentComponent, band: FrequencyBand, capture: int
    ) -> Tensor:
        """Spectrum behind the first modulator."""
        key = ("first", *self._first_key(component, capture), band)
        return self.cache.get(key, lambda: self._compute_first_spectrum(drive, component, band, capture))

    def _compute_first_spectrum(
        self, drive: Tensor, component: IncoherentComponent, band: FrequencyBand, capture: int
    ) -> Tensor:
        """The FFT of the modulator's pixels, repeated, times the spectrum of one pixel.

        Where an effect has turned pixels into samples, the FFT of the samples.
        """
        field = component.illuminate(self.plan, self._transmission(drive, 0, component, capture), self.dtype)
        if tuple(field.shape) != tuple(drive.shape):
            return band.forward(field)
        grid, slopes = self.plan.grid, component.slopes(self.plan)
        rows_of_pixels, columns_of_pixels = (p // grid.upsample for p in grid.padded)
        (rows, response_y), (columns, response_x) = (self._pixel_response(axis, slopes[axis], band) for axis in (0, 1))
        lines = torch.fft.fft(field, n=columns_of_pixels, dim=1).index_select(1, columns) * response_x
        return torch.fft.fft(lines, n=rows_of_pixels, dim=0).index_select(0, rows) * response_y[:, None]

    def _pixel_response(self, axis: int, slope: float, band: FrequencyBand) -> tuple[Tensor, Tensor]:
        """For the band's frequencies along an axis: indices in the FFT of the pixels, and the spectrum of one pixel."""
        padded, upsample, k = self.plan.grid.padded[axis], self.plan.grid.upsample, band.frequency_indices[axis]
        indices = self.cache.get(("pixel indices", axis, upsample, band), lambda: k % (padded // upsample))
        response = self.cache.get(
            ("pixel spectrum", axis, upsample, slope, band),
            lambda: pixel_spectrum(padded, upsample, slope).to(self.dtype)[k],
        )
        return indices, response

    def _transmission(self, drive: Tensor, number: int, component: IncoherentComponent, capture: int) -> Tensor:
        """Complex transmission of a modulator: always of samples for the second, of pixels if possible for the first.

        It doesn't depend on the direction of the source.
        """

        def compute() -> Tensor:
            context = component.modulator_context(self.plan, number)
            earlier = [patterns[number].to(self.real_dtype) for patterns in self.earlier or ()]
            transmission = self.effects.modulator_transmission(
                drive.to(self.real_dtype), context, self.dtype, component.path_factor, *earlier
            )
            return context.sampled(transmission) if number else transmission

        key = ("transmission", capture, component.path_factor, self._modulator_key(number, component))
        return self.cache.get(key, compute)

    # --- relays -----------------------------------------------------------------------------------------------------

    def _distance_m(self, relay: int) -> float:
        return float(self.plan.planes_m[0]) if relay else float(self.plan.system.gap_m or 0.0)

    def _transfer(self, relay: int, component: IncoherentComponent) -> Transfer:
        return self.plan.transfer(relay, component.wavelength_index, self._distance_m(relay))

    def _band(self, relay: int, component: IncoherentComponent) -> FrequencyBand:
        return FrequencyBand.from_transfer(self._transfer(relay, component), self.plan.grid)

    def _relay_transfer(self, relay: int, component: IncoherentComponent, band: FrequencyBand) -> Tensor:
        """H × pupil in the band, (rows, columns)."""
        transfer = self._transfer(relay, component)
        ky, kx = band.frequency_indices

        def nominal_response() -> Tensor:
            response = transfer_function_at(transfer, ky, kx, torch.complex128)
            pupil = nominal_pupil(self.plan, relay, component.wavelength_index, torch.complex128, torch.device("cpu"))
            return response if pupil is None else response * pupil[ky][:, kx]

        def compute() -> Tensor:
            key = ("nominal", relay, transfer.wavelength_m, transfer.distance_m, self.plan.relays[relay], band)
            response = self.cache.get_invariant(key, nominal_response)
            sine_y, sine_x = (k.double() * s for k, s in zip((ky, kx), transfer.sine_step, strict=True))
            λ, nominal = transfer.wavelength_m, self.relays[relay]
            radius = nominal.pupil_radius_sine(λ, self.plan.nominal.modulators[0].pitch_m)
            context = RelayContext(relay, λ, sine_y[:, None], sine_x[None], radius, nominal.centre_na)
            pupil = self.effects.pupil(context, torch.complex128)
            return (response if pupil is None else response * pupil).to(self.dtype)

        return self.cache.get(("relay", self._relay_key(relay, component), band), compute)

    # --- keys of the cache: all that a result depends on --------------------------------------------------------------

    def _first_key(self, component: IncoherentComponent, capture: int) -> Key:
        return capture, component.path_factor, self._modulator_key(0, component), component.slopes(self.plan)

    def _modulator_key(self, number: int, component: IncoherentComponent) -> Hashable:
        hooks = self.effects.cache_key(*MODULATOR_HOOKS, acts_on=f"modulator {number + 1}", laser=component.laser)
        source = self.effects.cache_key("transmission", acts_on="source") if number == 0 else ()
        stroke_m = self.plan.system.modulators[number].stroke_m
        return number, component.wavelength_m(self.plan), stroke_m, hooks, source

    def _relay_key(self, relay: int, component: IncoherentComponent) -> Hashable:
        hooks = self.effects.cache_key("pupil", acts_on=f"relay {relay + 1}")
        return relay, component.wavelength_m(self.plan), self._distance_m(relay), self.plan.relays[relay], hooks
