"""What a spectrum is multiplied by on its way, made once and kept: transfer functions, pupils, the pixel's shape."""

from __future__ import annotations

from dataclasses import replace

import torch

from holoview.optics.propagate import phase_slope, relay_response
from holoview.optics.pupil import pupil
from holoview.optics.slm import pixel_response
from holoview.optics.slots import relay_pupil
from holoview.optics.source import pixel_wave
from holoview.plan import Plan

Tensor = torch.Tensor

_DARK = 1e-100  # of a pupil's transmission: below, its logarithm's slope is lost, and no light comes through


class Responses:
    """Responses of a plan on a device, each (P_y, P_x). Built in float64 on the CPU: not every device has it.

    Their storage is taken first and filled then: what is made on the way leaves no holes between them.
    """

    def __init__(self, plan: Plan, dtype: torch.dtype, device: torch.device) -> None:
        self.plan, self.dtype, self.device = plan, dtype, device
        self._lit = [λ for λ in range(len(plan.system.wavelengths_m)) if plan.lit(λ)]
        count, size = len(self._lit), plan.grid.padded
        self._planes = torch.empty(count, len(plan.planes_m), *size, dtype=dtype, device=device)
        self._first = torch.empty(count, *size, dtype=dtype, device=device)
        self._waves: dict[tuple[int, int], Tensor] = {}
        for i, λ in enumerate(self._lit):
            for k, z in enumerate(plan.planes_m):
                self._planes[i, k] = self._relay(1, λ, float(z))
            self._first[i] = 1 if plan.system.gap_m is None else self._relay(0, λ, plan.system.gap_m)
            if len(plan.slopes) == 1:
                self._first[i].mul_(self._pixel(λ, 0))

    def plane(self, wavelength: int, plane: int) -> Tensor:
        """H × pupil from the last modulator to a focal plane."""
        return self._planes[self._lit.index(wavelength), plane]

    def first(self, wavelength: int, source: int) -> Tensor:
        """From the repeated spectrum of modulator 1's pixels to the next modulator: the pixel's shape × H of the gap.

        With one modulator, the pixel's shape alone. The shape depends on the source's slope.
        """
        kept = self._first[self._lit.index(wavelength)]
        return kept if len(self.plan.slopes) == 1 else kept * self._pixel(wavelength, source)

    def transmission(self, wavelength: int) -> tuple[float, float]:
        """Share of the light of a pixel of modulator 1, and of the last one, that reaches the focal planes."""
        shape = self._pixel(wavelength, 0).abs().square()
        last = (shape * self.plane(wavelength, 0).abs().square()).sum() / shape.sum()
        gap = self.first(wavelength, 0).abs().square().sum() / shape.sum()
        return float(gap * last), float(last)

    def gap(self, wavelength: int) -> Tensor:
        """H × pupil between the modulators."""
        assert self.plan.system.gap_m is not None
        return self._relay(0, wavelength, self.plan.system.gap_m).to(self.device)

    def wave(self, wavelength: int, source: int) -> Tensor | None:
        """The illumination at the first sample of each pixel, (rows, columns); None on the axis, where it is 1."""
        key = (wavelength, source)
        if not self.plan.slopes[source, wavelength].any():
            return None
        if key not in self._waves:
            self._waves[key] = pixel_wave(self.plan, wavelength, source, self.dtype, self.device)
        return self._waves[key]

    def phase_slope(self, wavelength: int) -> Tensor:
        """∂(phase of H)/∂λ per metre of distance, real."""
        slope = phase_slope(float(self.plan.system.wavelengths_m[wavelength]), self.plan.grid)
        return slope.to(torch.float64 if self.dtype == torch.complex128 else torch.float32).to(self.device)

    def glass_slope(self, relay: int, wavelength: int) -> Tensor | None:
        """∂(ln pupil)/∂λ of a relay, 1/m; None where it has neither aberration nor apodisation.

        By central differences over 2·10⁻⁶·λ in float64. Stops are left out: their edges move with λ in whole samples.
        """
        cpu, step = torch.device("cpu"), 1e-6
        λ = self.plan.system.wavelengths_m[wavelength]
        here = pupil(self.plan, relay, wavelength, torch.complex128, cpu)
        if here is None:
            return None
        sides = []
        for sign in (1, -1):
            moved = self.plan.system.edit({"wavelengths": self.plan.system.wavelengths_m * (1 + sign * step)})
            side = pupil(replace(self.plan, system=moved), relay, wavelength, torch.complex128, cpu)
            assert side is not None
            sides.append(side)
        slope = (sides[0] - sides[1]) / (2 * step * λ * here)
        return torch.where(here.abs() > _DARK, slope, 0).to(self.dtype).to(self.device)

    def _pixel(self, wavelength: int, source: int) -> Tensor:
        sides = zip(self.plan.grid.padded, self.plan.slopes[source, wavelength], strict=True)
        y, x = (pixel_response(n, self.plan.grid.upsample, float(slope)) for n, slope in sides)
        return (y[:, None] * x[None, :]).to(self.dtype).to(self.device)

    def _relay(self, relay: int, wavelength: int, distance_m: float) -> Tensor:
        glass = relay_pupil(self.plan, relay, wavelength)
        step = self.plan.transfer(relay, wavelength, distance_m)
        return relay_response(step, self.plan.grid, glass, self.dtype, torch.device("cpu"))
