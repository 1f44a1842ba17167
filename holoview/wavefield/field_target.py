"""A complex field as the target of a hologram: its light at any plane, in its own colours and its true size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.colour import observer_weights, xyz_to_linear_srgb
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optics.free_space import AngularSpectrum, Window
from holoview.util import units
from holoview.util.errors import UserError
from holoview.wavefield.wavefield import Wavefield

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

        The light is seen without the stops of the system, by the system's observer. Raises UserError with an eye,
        through whose pupil the light would have to be seen.
        """
        if system.eye is not None:
            raise UserError(
                "target",
                "a field with an eye",
                expected="a system without one",
                remedy='take the eye away: --set eye=""',
            )
        window = _samples_of(system)
        stack = np.empty((len(planes_m), *window.shape, 3), np.float32)
        weights = self.amplitudes[..., None] * observer_weights(system.observer, self.field.wavelengths_m)
        for index, plane_m in enumerate(planes_m):
            xyz = np.zeros((*window.shape, 3))
            for laser in range(len(self.field.wavelengths_m)):
                light = self._light(laser, float(plane_m), window).abs().square().numpy()
                xyz += np.tensordot(light, weights[:, laser] / self.field.frames, axes=(0, 0))
            stack[index] = xyz_to_linear_srgb(xyz)
        return stack

    def fields(self, system: System, plane_m: float) -> NDArray[np.complex64]:
        """The field (frame, wavelength, y, x) of each laser of a system, in one of its planes, on its samples.

        The amplitude includes the power of the laser. Raises UserError where the field lacks a laser's wavelength.
        """
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

    def _light(self, laser: int, plane_m: float, window: Window) -> torch.Tensor:
        """The field (frame, y, x) of one laser in a plane, complex128."""
        values = torch.from_numpy(self.field.values[:, laser].astype(np.complex128))
        λ, pitch_m = float(self.field.wavelengths_m[laser]), self.field.pitch_m
        return AngularSpectrum.make(self.field.shape, pitch_m, λ, plane_m - self.at_m, window).propagate(values)


def _samples_of(system: System) -> Window:
    """The samples of a system's simulation grid."""
    grid = make_plan(system).grid
    return Window(grid.shape, (grid.pitch_m, grid.pitch_m))
