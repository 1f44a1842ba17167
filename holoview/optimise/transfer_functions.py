"""What a spectrum is multiplied by on its way, made once and kept: transfer functions, pupils, the pixel's shape."""

from __future__ import annotations

from dataclasses import replace

import torch

from holoview.model.plan import Plan
from holoview.optics.frame_inputs import pupil_with_effects
from holoview.optics.propagate import phase_wavelength_derivative, relay_transfer_function
from holoview.optics.pupil import nominal_pupil
from holoview.optics.slm import pixel_spectrum
from holoview.optics.source import pixel_wave

Tensor = torch.Tensor

_DARK = 1e-100  # of a pupil's transmission: below, its logarithm's slope is lost, and no light comes through


class TransferFunctions:
    """Responses of a plan on a device, each (P_y, P_x). Built in float64 on the CPU: not every device has it.

    Their storage is taken first and filled then: what is made on the way leaves no holes between them.
    """

    def __init__(self, plan: Plan, dtype: torch.dtype, device: torch.device) -> None:
        self.plan, self.dtype, self.device = plan, dtype, device
        self._active_wavelengths = [λ for λ in range(len(plan.system.wavelengths_m)) if plan.lit(λ)]
        count, size = len(self._active_wavelengths), plan.grid.padded
        self._plane_transfers = torch.empty(count, len(plan.planes_m), *size, dtype=dtype, device=device)
        self._first_transfers = torch.empty(count, *size, dtype=dtype, device=device)
        self._illuminations: dict[tuple[int, int], Tensor] = {}
        for i, λ in enumerate(self._active_wavelengths):
            for k, z in enumerate(plan.planes_m):
                self._plane_transfers[i, k] = self._relay_transfer(1, λ, float(z))
            self._first_transfers[i] = 1 if plan.system.gap_m is None else self._relay_transfer(0, λ, plan.system.gap_m)
            if len(plan.slopes) == 1:
                self._first_transfers[i].mul_(self._pixel_spectrum(λ, 0))

    def to_plane(self, wavelength: int, plane: int) -> Tensor:
        """H × pupil from the last modulator to a focal plane."""
        return self._plane_transfers[self._active_wavelengths.index(wavelength), plane]

    def from_first_modulator(self, wavelength: int, source: int) -> Tensor:
        """From the repeated spectrum of modulator 1's pixels to the next modulator: the pixel's shape × H of the gap.

        With one modulator, the pixel's shape alone. The shape depends on the source's slope.
        """
        kept = self._first_transfers[self._active_wavelengths.index(wavelength)]
        return kept if len(self.plan.slopes) == 1 else kept * self._pixel_spectrum(wavelength, source)

    def transmittances(self, wavelength: int) -> tuple[float, float]:
        """Share of the light of a pixel of modulator 1, and of the last one, that reaches the focal planes."""
        shape = self._pixel_spectrum(wavelength, 0).abs().square()
        last = (shape * self.to_plane(wavelength, 0).abs().square()).sum() / shape.sum()
        gap = self.from_first_modulator(wavelength, 0).abs().square().sum() / shape.sum()
        return float(gap * last), float(last)

    def across_gap(self, wavelength: int) -> Tensor:
        """H × pupil between the modulators."""
        assert self.plan.system.gap_m is not None
        return self._relay_transfer(0, wavelength, self.plan.system.gap_m).to(self.device)

    def illumination(self, wavelength: int, source: int) -> Tensor | None:
        """The illumination at the first sample of each pixel, (rows, columns); None on the axis, where it is 1."""
        key = (wavelength, source)
        if not self.plan.slopes[source, wavelength].any():
            return None
        if key not in self._illuminations:
            self._illuminations[key] = pixel_wave(self.plan, wavelength, source, self.dtype, self.device)
        return self._illuminations[key]

    def phase_derivative(self, wavelength: int) -> Tensor:
        """∂(phase of H)/∂λ per metre of distance, real."""
        slope = phase_wavelength_derivative(float(self.plan.system.wavelengths_m[wavelength]), self.plan.grid)
        return slope.to(torch.float64 if self.dtype == torch.complex128 else torch.float32).to(self.device)

    def log_pupil_derivative(self, relay: int, wavelength: int) -> Tensor | None:
        """∂(ln pupil)/∂λ of a relay, 1/m; None where it has neither aberration nor apodisation.

        By central differences over 2·10⁻⁶·λ in float64. Stops are left out: their edges move with λ in whole samples.
        """
        cpu, step = torch.device("cpu"), 1e-6
        λ = self.plan.system.wavelengths_m[wavelength]
        here = nominal_pupil(self.plan, relay, wavelength, torch.complex128, cpu)
        if here is None:
            return None
        sides = []
        for sign in (1, -1):
            moved = self.plan.system.edit({"wavelengths": self.plan.system.wavelengths_m * (1 + sign * step)})
            side = nominal_pupil(replace(self.plan, system=moved), relay, wavelength, torch.complex128, cpu)
            assert side is not None
            sides.append(side)
        slope = (sides[0] - sides[1]) / (2 * step * λ * here)
        return torch.where(here.abs() > _DARK, slope, 0).to(self.dtype).to(self.device)

    def _pixel_spectrum(self, wavelength: int, source: int) -> Tensor:
        sides = zip(self.plan.grid.padded, self.plan.slopes[source, wavelength], strict=True)
        y, x = (pixel_spectrum(n, self.plan.grid.upsample, float(slope)) for n, slope in sides)
        return (y[:, None] * x[None, :]).to(self.dtype).to(self.device)

    def _relay_transfer(self, relay: int, wavelength: int, distance_m: float) -> Tensor:
        glass = pupil_with_effects(self.plan, relay, wavelength)
        step = self.plan.transfer(relay, wavelength, distance_m)
        return relay_transfer_function(step, self.plan.grid, glass, self.dtype, torch.device("cpu"))
