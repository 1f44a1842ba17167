"""A complex field as the target of a hologram: its light at any plane, in its own colours and its true size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.fields.wavefield import Wavefield
from holoview.light.colour import observer_weights, xyz_to_linear_srgb
from holoview.light.model.bench_parts import Relay
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System, bench_of_field
from holoview.light.optics.bench import pupil_without_effects, relay_response
from holoview.light.optics.free_space import AngularSpectrum, SampleWindow
from holoview.util import units
from holoview.util.errors import UserError

_NEAREST = 1e-3  # of a wavelength: largest difference from the wavelength of the laser that shows the field


@dataclass(frozen=True, eq=False)
class FieldTarget:
    """A field whose middle is that of the modulators, in the plane at `at_m` behind the last one, m.

    field: lit. amplitudes: (frame, wavelength), powers of its lasers as of `System.amplitudes`.
    """

    field: Wavefield
    amplitudes: NDArray[np.float64]
    at_m: float = 0.0

    @property
    def source(self) -> str:
        """The name of the field."""
        return self.field.name or "a field"

    def images(self, system: System, planes_m: NDArray[np.float64]) -> NDArray[np.float32]:
        """The pictures (plane, y, x, 3), linear sRGB, in planes (plane,) m of a system, on the system's samples.

        The light is seen without the stops of the system, by the system's observer. An eye is focused on the planes.
        """
        window = _samples_of(system)
        xyz = np.zeros((len(planes_m), *window.shape, 3))
        weights = self.amplitudes[..., None] * observer_weights(system.observer, self.field.wavelengths_m)
        plan = None if system.eye is None else make_plan(self._bench_seen_by_eye(system, window), planes_m)
        for laser in range(len(self.field.wavelengths_m)):
            spectrum = None if plan is None else _padded_spectrum(plan, self._light(laser, 0.0, window))
            for index, plane_m in enumerate(planes_m.tolist()):
                if plan is None or spectrum is None:
                    light = self._light(laser, plane_m, window)
                else:
                    light = _seen_by_eye(plan, laser, index, spectrum)
                power = light.abs().square().numpy()
                xyz[index] += np.tensordot(power, weights[:, laser] / self.field.frames, axes=(0, 0))
        stack: NDArray[np.float32] = xyz_to_linear_srgb(xyz).astype(np.float32)
        return stack

    def _bench_seen_by_eye(self, system: System, window: SampleWindow) -> System:
        """The bench of the light in the plane of the last modulator, on a system's samples, seen by its eye."""
        lasers = {"wavelengths_m": self.field.wavelengths_m, "amplitudes": self.amplitudes}
        return bench_of_field(system, window.pitch_m[0], window.shape, relay2=Relay(), **lasers)

    def fields(self, system: System, plane_m: float) -> NDArray[np.complex64]:
        """The field (frame, wavelength, y, x) of each laser of a system, in one of its planes, on its samples.

        The amplitude includes the power of the laser. Raises UserError where the field lacks a laser's wavelength, and
        with an eye, on whose retina the fields have no reference phase.
        """
        if system.eye is not None:
            raise UserError(
                "fields",
                "with an eye",
                expected="a system without one, or its picture as the target",
                remedy='take the eye away: --set eye=""',
            )
        window = _samples_of(system)
        found = []
        for λ in system.wavelengths_m:
            laser = int(np.abs(self.field.wavelengths_m - λ).argmin())
            if abs(self.field.wavelengths_m[laser] / λ - 1) > _NEAREST:
                known = ", ".join(units.format_rounded(float(w), "nm") for w in self.field.wavelengths_m)
                raise UserError(
                    self.source,
                    f"light of {known}",
                    expected=f"also of {units.format_rounded(float(λ), 'nm')}, a laser of the system",
                    remedy="give the system the field's wavelengths",
                )
            powers = torch.from_numpy(np.sqrt(self.amplitudes[:, laser]))
            found.append(self._light(laser, plane_m, window) * powers[:, None, None])
        stacked: NDArray[np.complex64] = torch.stack(found, dim=1).to(torch.complex64).numpy()
        return stacked

    def _light(self, laser: int, plane_m: float, window: SampleWindow) -> torch.Tensor:
        """The field (frame, y, x) of one laser in a plane, complex128."""
        values = torch.from_numpy(self.field.values[:, laser].astype(np.complex128))
        λ, pitch_m = float(self.field.wavelengths_m[laser]), self.field.pitch_m
        return AngularSpectrum.make(self.field.shape, pitch_m, λ, plane_m - self.at_m, window).propagate(values)


def _padded_spectrum(plan: Plan, light: torch.Tensor) -> torch.Tensor:
    """The spectrum (frame, P_y, P_x) of a field (frame, y, x) in the padded grid of a plan."""
    padded = light.new_zeros((len(light), *plan.grid.padded))
    padded[(..., *plan.grid.inside)] = light
    return torch.fft.fft2(padded)


def _seen_by_eye(plan: Plan, laser: int, plane: int, spectrum: torch.Tensor) -> torch.Tensor:
    """The field (frame, y, x) on the retina of the eye that is focused on the plane of an index."""
    ky, kx = (torch.fft.fftfreq(n, 1 / n).round().long() for n in plan.grid.padded)
    pupil = pupil_without_effects(plan, 1, laser, plan.planes[plane].eye)
    seen = torch.fft.ifft2(spectrum * relay_response(plan.transfer(1, laser, plane), ky, kx, pupil, torch.complex128))
    return seen[(..., *plan.grid.inside)]


def _samples_of(system: System) -> SampleWindow:
    """The samples of a system's simulation grid."""
    grid = make_plan(system).grid
    return SampleWindow(grid.shape, (grid.pitch_m, grid.pitch_m))
