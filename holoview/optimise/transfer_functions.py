"""Precomputed factors of a beam's spectrum: transfer functions, pupils and the spectrum of a pixel's shape."""

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

_MIN_TRANSMISSION = 1e-100  # of a pupil: below, the derivative of its logarithm is rounding, and no light passes


class TransferFunctions:
    """The factors of a plan for each wavelength in use, complex (P_y, P_x) on the padded grid.

    They are computed in float64 on the CPU, since not every device has float64, and then moved to the device. Memory is
    allocated for all of them before the first is computed, so that temporary tensors don't fragment it.
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
        """Spectrum of the pixel's shape × H × pupil of the gap; with one modulator the spectrum of the shape alone.

        The shape's spectrum depends on the slope of the source's plane wave.
        """
        transfer = self._first_transfers[self._active_wavelengths.index(wavelength)]
        return transfer if len(self.plan.slopes) == 1 else transfer * self._pixel_spectrum(wavelength, source)

    def transmittances(self, wavelength: int) -> tuple[float, float]:
        """Fractions of the power of a pixel's light, from modulator 1 and from the last one, that reach the planes."""
        shape = self._pixel_spectrum(wavelength, 0).abs().square()
        last = (shape * self.to_plane(wavelength, 0).abs().square()).sum() / shape.sum()
        gap = self.from_first_modulator(wavelength, 0).abs().square().sum() / shape.sum()
        return float(gap * last), float(last)

    def across_gap(self, wavelength: int) -> Tensor:
        """H × pupil between the modulators."""
        assert self.plan.system.gap_m is not None
        return self._relay_transfer(0, wavelength, self.plan.system.gap_m).to(self.device)

    def illumination(self, wavelength: int, source: int) -> Tensor | None:
        """The plane wave at the first sample of each pixel, (rows, columns); None for a source on the axis: it is 1."""
        key = (wavelength, source)
        if not self.plan.slopes[source, wavelength].any():
            return None
        if key not in self._illuminations:
            self._illuminations[key] = pixel_wave(self.plan, wavelength, source, self.dtype, self.device)
        return self._illuminations[key]

    def phase_derivative(self, wavelength: int) -> Tensor:
        """∂(phase of H)/∂λ per metre of distance, real."""
        derivative = phase_wavelength_derivative(float(self.plan.system.wavelengths_m[wavelength]), self.plan.grid)
        return derivative.to(torch.float64 if self.dtype == torch.complex128 else torch.float32).to(self.device)

    def log_pupil_derivative(self, relay: int, wavelength: int) -> Tensor | None:
        """∂(ln pupil)/∂λ of a relay, 1/m; None where it has neither aberration nor apodisation.

        Central differences over 2·10⁻⁶·λ in float64. Stops don't contribute: their edges move with λ in whole samples.
        """
        cpu, step = torch.device("cpu"), 1e-6
        λ = self.plan.system.wavelengths_m[wavelength]
        pupil = nominal_pupil(self.plan, relay, wavelength, torch.complex128, cpu)
        if pupil is None:
            return None
        sides = []
        for sign in (1, -1):
            moved = self.plan.system.edit({"wavelengths": self.plan.system.wavelengths_m * (1 + sign * step)})
            side = nominal_pupil(replace(self.plan, system=moved), relay, wavelength, torch.complex128, cpu)
            assert side is not None
            sides.append(side)
        derivative = (sides[0] - sides[1]) / (2 * step * λ * pupil)
        return torch.where(pupil.abs() > _MIN_TRANSMISSION, derivative, 0).to(self.dtype).to(self.device)

    def _pixel_spectrum(self, wavelength: int, source: int) -> Tensor:
        axes = zip(self.plan.grid.padded, self.plan.slopes[source, wavelength], strict=True)
        y, x = (pixel_spectrum(n, self.plan.grid.upsample, float(slope)) for n, slope in axes)
        return (y[:, None] * x[None, :]).to(self.dtype).to(self.device)

    def _relay_transfer(self, relay: int, wavelength: int, distance_m: float) -> Tensor:
        pupil = pupil_with_effects(self.plan, relay, wavelength)
        transfer = self.plan.transfer(relay, wavelength, distance_m)
        return relay_transfer_function(transfer, self.plan.grid, pupil, self.dtype, torch.device("cpu"))
