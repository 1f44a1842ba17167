"""The modulator patterns as variables: initial values, quantisation to levels, the Adam step."""

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

_SMOOTH_SIGMA_PX = 8.0  # standard deviation of the Gaussian filter of smooth initial patterns
_SMOOTH_RMS_RAD = 0.5  # their r.m.s. phase


def initial_drive(system: System, settings: Settings) -> Tensor:
    """Initial patterns (frame, modulator, y, x) in 0…1, of the kind `settings.begin`.

    "random": uniform over the stroke, which fills the eyebox with speckle. "smooth": half the stroke with weak low-pass
    noise, which leaves the eyebox almost empty; the optimum found from there has less speckle for that reason.
    """
    generator = torch.Generator().manual_seed(settings.seed)
    drive = torch.rand(system.drive_shape, generator=generator)
    if settings.begin == "random":
        return drive
    noise = ndimage.gaussian_filter(drive.numpy() - 0.5, (0, 0, _SMOOTH_SIGMA_PX, _SMOOTH_SIGMA_PX), mode="wrap")
    noise *= _drive_per_rad(system, _SMOOTH_RMS_RAD) / noise.std()
    return torch.from_numpy(np.clip(0.5 + noise, 0, 1).astype(np.float32))


def _drive_per_rad(system: System, phase_rad: float) -> NDArray[np.float64]:
    """The fraction of each modulator's stroke that gives a phase at the middle wavelength, (1, modulator, 1, 1)."""
    strokes = np.array([modulator.stroke_m for modulator in system.modulators])
    middle_m = float(np.median(system.wavelengths_m))
    return (phase_rad * middle_m / (2 * math.pi * strokes)).reshape(1, -1, 1, 1)


class PatternVariables:
    """Drive patterns (frame, modulator, y, x) that Adam moves inside 0…1 of the stroke. step_factor: of all steps."""

    def __init__(self, system: System, settings: Settings, drive: Tensor) -> None:
        self.drive = drive
        self.adam = Adam(drive, settings.betas)
        self._modulators = system.modulators
        strokes = torch.tensor([modulator.stroke_m for modulator in system.modulators], dtype=torch.float32)
        self._stroke_m = strokes.reshape(1, -1, 1, 1).to(drive.device)
        step_size = _drive_per_rad(system, settings.step_rad).astype(np.float32)
        self._step_size = torch.from_numpy(step_size).to(drive.device)
        self.step_factor = 1.0

    def displayed_drive(self) -> Tensor:
        """The stroke fractions that the modulators show: the drive at its nearest level."""
        shown = [nearest_level(self.drive[:, i], modulator) for i, modulator in enumerate(self._modulators)]
        return torch.stack(shown, dim=1)

    def optical_path_m(self, shown: Tensor) -> Tensor:
        """Optical path (m) of stroke fractions (frame, modulator, y, x)."""
        return shown * self._stroke_m

    def level_step_m(self) -> Tensor | None:
        """Signed optical path (m) from each pixel's level to its neighbour; None if no modulator has levels."""
        steps = steps_to_neighbour_level(self.drive, self._modulators)
        return None if steps is None else steps * self._stroke_m

    def go_back(self, drive: Tensor, factor: float) -> None:
        """Begins again from another drive, with steps that are `factor` times those before."""
        self.drive, self.step_factor = drive, self.step_factor * factor
        self.adam.reset()

    def step(self, gradient: Tensor, scale: float) -> None:
        """One step against the gradient ∂L/∂opd, which it overwrites, `scale` times the first step's size."""
        step = self.adam.unit_step(gradient.mul_(self._stroke_m))
        self.drive = (self.drive - self.step_factor * scale * self._step_size * step).clamp_(0, 1)
