"""The modulators' patterns as unknowns: where they begin, what the modulator shows of them, how they move."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage

from holoview.model.system import System
from holoview.optics.slm import nearest_level
from holoview.optimise.adam import Adam
from holoview.optimise.level_gradients import steps_to_neighbour_level
from holoview.optimise.settings import Settings

Tensor = torch.Tensor

_SMOOTH_PIXELS = 8.0  # width of the filter of a smooth start
_SMOOTH_RMS_RAD = 0.5  # r.m.s. phase of it


def initial_drive(system: System, settings: Settings) -> Tensor:
    """Patterns (frame, modulator, y, x) in 0…1 to begin with.

    random: uniform over the stroke, which fills the eyebox with speckle. smooth: half the stroke with a little
    low-pass noise, which leaves the eyebox almost empty: the optimum that it leads to has less speckle for that reason.
    """
    generator = torch.Generator().manual_seed(settings.seed)
    drive = torch.rand(system.drive_shape, generator=generator)
    if settings.begin == "random":
        return drive
    noise = ndimage.gaussian_filter(drive.numpy() - 0.5, (0, 0, _SMOOTH_PIXELS, _SMOOTH_PIXELS), mode="wrap")
    noise *= _drive_per_rad(system, _SMOOTH_RMS_RAD) / noise.std()
    return torch.from_numpy(np.clip(0.5 + noise, 0, 1).astype(np.float32))


def _drive_per_rad(system: System, phase_rad: float) -> NDArray[np.float64]:
    """Share of each modulator's stroke that is this phase at the middle wavelength, (1, modulator, 1, 1)."""
    strokes = np.array([modulator.stroke_m for modulator in system.modulators])
    middle = float(np.median(system.wavelengths_m))
    return (phase_rad * middle / (2 * math.pi * strokes)).reshape(1, -1, 1, 1)


class PatternVariables:
    """Drive patterns under Adam, held inside the stroke."""

    def __init__(self, system: System, settings: Settings, drive: Tensor) -> None:
        self.drive = drive
        self.adam = Adam(drive, settings.betas)
        self._modulators = system.modulators
        strokes = torch.tensor([modulator.stroke_m for modulator in system.modulators], dtype=torch.float32)
        self._stroke_m = strokes.reshape(1, -1, 1, 1).to(drive.device)
        self._step_size = torch.from_numpy(_drive_per_rad(system, settings.step_rad).astype(np.float32)).to(
            drive.device
        )

    def displayed_drive(self) -> Tensor:
        """The stroke fractions that the modulators show for the present drive."""
        columns = [nearest_level(self.drive[:, i], modulator) for i, modulator in enumerate(self._modulators)]
        return torch.stack(columns, dim=1)

    def optical_path_m(self, shown: Tensor) -> Tensor:
        """Optical path (m) of stroke fractions."""
        return shown * self._stroke_m

    def level_step_m(self) -> Tensor | None:
        """Optical path to the neighbouring level of each pixel; None on modulators without levels."""
        jumps = steps_to_neighbour_level(self.drive, self._modulators)
        return None if jumps is None else jumps * self._stroke_m

    def step(self, gradient: Tensor, scale: float) -> None:
        """One step against ∂L/∂opd (consumed), `fall` times the first step's size."""
        step = self.adam.unit_step(gradient.mul_(self._stroke_m))
        self.drive = (self.drive - scale * self._step_size * step).clamp_(0, 1)
