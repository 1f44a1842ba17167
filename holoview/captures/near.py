"""A capture's intensity in the near field: modulators, gap, relay, plane; only frequencies that pass are computed.

    V = F[s·t₁],  E₁ = F⁻¹[V·H_gap·P₁],  W = F[E₁·t₂],  E = F⁻¹[W·H_z·P₂],  I = |E|²      (one modulator: W = V)

t are the modulators' transmissions, s the illumination, H and P what free space and the relays do.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import torch

from holoview.captures.band import Band
from holoview.captures.cache import Cache
from holoview.captures.look import Pixels, intensity_at
from holoview.effects.apply import Applied
from holoview.effects.places import Aperture, Surface
from holoview.optics.propagate import transfer_at
from holoview.optics.pupil import pupil
from holoview.optics.slm import pixel_response
from holoview.optics.source import pixel_wave, plane_wave
from holoview.plan import Plan

Tensor = torch.Tensor


@dataclass(frozen=True)
class Beam:
    """One of what adds in intensity: a wavelength and a source direction of a plan, and a factor of optical paths."""

    wavelength: int
    source: int
    factor: float


class NearField:
    """Intensities at one plane on the camera. plan: of the bench as it is; irises: nominal apertures of both relays."""

    def __init__(
        self,
        plan: Plan,
        applied: Applied,
        irises: tuple[float | None, float | None],
        pixels: Pixels,
        dtype: torch.dtype,
        cache: Cache,
    ) -> None:
        self.plan, self.applied, self.irises, self.pixels = plan, applied, irises, pixels
        self.dtype, self.cache = dtype, cache
        self.real = torch.float64 if dtype == torch.complex128 else torch.float32

    def intensity(self, shares: Tensor, beam: Beam, capture: int) -> Tensor:
        """|E|² on the camera for shares of the stroke (modulator, y, x), one beam of unit power."""
        spectrum, band, key = self._behind(shares, beam, capture)
        key = (*key, "seen", self._relay_key(1, beam), self.applied.key("aim"))
        response = self._response(1, beam, band)

        def seen() -> Tensor:
            return intensity_at(spectrum * response, band, self.plan.grid, self.pixels, self.applied.aim())

        return self.cache.get(key, seen)

    # --- the way of the light ---------------------------------------------------------------------------------------

    def _behind(self, shares: Tensor, beam: Beam, capture: int) -> tuple[Tensor, Band, tuple[Hashable, ...]]:
        """Spectrum behind the last modulator in the last relay's band."""
        key: tuple[Hashable, ...] = (capture, beam.factor, self._light_key(0, beam), self._wave_key(beam))
        last = self._band(1, beam)
        if self.plan.system.gap_m is None:
            return self._first(shares[0], beam, last, capture), last, key
        band = self._band(0, beam)
        arriving_key = (*key, "arriving", self._relay_key(0, beam))
        key = (*arriving_key, self._light_key(1, beam))

        def arriving() -> Tensor:
            spectrum = self._first(shares[0], beam, band, capture) * self._response(0, beam, band)
            return band.inverse(spectrum, self.plan.grid.shape)

        def spectrum() -> Tensor:
            field = self.cache.get(arriving_key, arriving)
            return last.forward(field * self._light(shares[1], 1, beam, capture))

        return self.cache.get((*key, "last", last), spectrum), last, key

    def _first(self, share: Tensor, beam: Beam, band: Band, capture: int) -> Tensor:
        """Spectrum behind the first modulator, kept."""
        key = ("first", capture, beam.factor, self._light_key(0, beam), self._wave_key(beam), band)
        return self.cache.get(key, lambda: self._spectrum(share, beam, band, capture))

    def _spectrum(self, share: Tensor, beam: Beam, band: Band, capture: int) -> Tensor:
        """Spectrum behind the first modulator, of pixels as long as no effect needs samples."""
        light, grid = self._light(share, 0, beam, capture), self.plan.grid
        slopes = self.plan.slopes[beam.source, beam.wavelength]
        tilted = bool(slopes.any())
        if tuple(light.shape) != tuple(share.shape):
            if tilted:
                light = light * plane_wave(self.plan, beam.wavelength, beam.source, self.dtype, light.device)
            return band.forward(light)
        if tilted:
            light = light * pixel_wave(self.plan, beam.wavelength, beam.source, self.dtype, light.device)
        coarse = tuple(p // grid.upsample for p in grid.padded)
        (rows, above), (columns, along) = (self._pixel(axis, float(slopes[axis]), band) for axis in (0, 1))
        lines = torch.fft.fft(light, n=coarse[1], dim=1).index_select(1, columns) * along
        return torch.fft.fft(lines, n=coarse[0], dim=0).index_select(0, rows) * above[:, None]

    def _pixel(self, axis: int, slope: float, band: Band) -> tuple[Tensor, Tensor]:
        """For each frequency of a band's side: where it is in the spectrum of pixels, and what a pixel makes of it."""
        padded, upsample, k = self.plan.grid.padded[axis], self.plan.grid.upsample, band.indices[axis]
        place = self.cache.get(("place", axis, upsample, band), lambda: k % (padded // upsample))
        response = self.cache.get(
            ("pixel", axis, upsample, slope, band), lambda: pixel_response(padded, upsample, slope).to(self.dtype)[k]
        )
        return place, response

    def _surface(self, number: int, beam: Beam) -> Surface:
        system = self.plan.system
        modulator = system.modulators[number]
        return Surface(
            number=number,
            wavelength_m=float(system.wavelengths_m[beam.wavelength]),
            stroke_m=modulator.stroke_m,
            pitch_m=modulator.pitch_m,
            shape=modulator.shape,
            upsample=self.plan.grid.upsample,
        )

    def _light(self, share: Tensor, number: int, beam: Beam, capture: int) -> Tensor:
        """What a modulator makes of light, for every direction of the source; of samples but for the first."""

        def light() -> Tensor:
            surface = self._surface(number, beam)
            made = self.applied.light(share.to(self.real), surface, self.dtype, beam.factor)
            return surface.sampled(made) if number else made

        return self.cache.get(("light", capture, beam.factor, self._light_key(number, beam)), light)

    # --- relays -----------------------------------------------------------------------------------------------------

    def _distance(self, relay: int) -> float:
        system = self.plan.system
        return float(self.plan.planes_m[0]) if relay else float(system.gap_m or 0.0)

    def _band(self, relay: int, beam: Beam) -> Band:
        return Band.of(self.plan.transfer(relay, beam.wavelength, self._distance(relay)), self.plan.grid)

    def _response(self, relay: int, beam: Beam, band: Band) -> Tensor:
        """H × pupil in the band."""

        step = self.plan.transfer(relay, beam.wavelength, self._distance(relay))
        ky, kx = band.indices

        def nominal() -> Tensor:
            response = transfer_at(step, ky, kx, torch.complex128)
            glass = pupil(self.plan, relay, beam.wavelength, torch.complex128, torch.device("cpu"))
            return response if glass is None else response * glass[ky][:, kx]

        def make() -> Tensor:
            place = ("nominal", relay, step.wavelength_m, step.distance_m, self.plan.relays[relay], band)
            response = self.cache.fixed(place, nominal)
            sines = [k.double() * s for k, s in zip((ky, kx), step.sine_step, strict=True)]
            at = Aperture(relay, step.wavelength_m, sines[0][:, None], sines[1][None], self.irises[relay] or 1.0)
            added = self.applied.pupil(at, torch.complex128)
            return (response if added is None else response * added).to(self.dtype)

        return self.cache.get(("response", self._relay_key(relay, beam), band), make)

    # --- what results depend on -------------------------------------------------------------------------------------

    def _light_key(self, number: int, beam: Beam) -> Hashable:
        system = self.plan.system
        hooks = self.applied.key("response", "path", "transmission", "seat", where=f"modulator {number + 1}")
        source = self.applied.key("transmission", where="source") if number == 0 else ()
        return number, float(system.wavelengths_m[beam.wavelength]), system.modulators[number].stroke_m, hooks, source

    def _wave_key(self, beam: Beam) -> Hashable:
        return tuple(self.plan.slopes[beam.source, beam.wavelength].tolist())

    def _relay_key(self, relay: int, beam: Beam) -> Hashable:
        λ = float(self.plan.system.wavelengths_m[beam.wavelength])
        hooks = self.applied.key("pupil", where=f"relay {relay + 1}")
        return relay, λ, self._distance(relay), self.plan.relays[relay], hooks
