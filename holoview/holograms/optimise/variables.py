"""The optimisation variables (patterns, amplitudes, wavelengths), their Adam steps and their checkpoint form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage

from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.adam import Adam
from holoview.holograms.optimise.lasers import next_amplitudes
from holoview.holograms.optimise.level_gradients import curvature_weight, steps_to_neighbour_level
from holoview.holograms.optimise.problem import EvaluationRequest, LossEvaluation
from holoview.holograms.optimise.settings import Settings, find_loss_space
from holoview.holograms.optimise.wavelengths import FreeWavelengths
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import checked_drive
from holoview.light.optics.slm import nearest_level

Tensor = torch.Tensor
Floats = NDArray[np.float64]

_LOG_AMPLITUDE_STEP = 0.02  # Adam's step of the amplitudes' logarithm, for a loss that isn't quadratic in them
_MIN_RELATIVE_AMPLITUDE = 1e-6  # of the brightest laser: the logarithm of 0 couldn't move
_SMOOTH_SIGMA_PX = 8.0  # standard deviation of the Gaussian filter of smooth initial patterns
_SMOOTH_RMS_RAD = 0.5  # their r.m.s. phase


class OptimisationVariables:
    """Patterns, amplitudes (frame, wavelength) and wavelengths (wavelength,) m, each with Adam's moments."""

    def __init__(self, system: System, settings: Settings, drive: torch.Tensor) -> None:
        self.settings = settings
        self.patterns = PatternVariables(system, settings, drive)
        self.amplitudes, self._are_on = np.array(system.amplitudes), system.amplitudes > 0
        self.wavelengths = FreeWavelengths(system.wavelengths_m, settings)
        self._is_nonlinear_loss = find_loss_space(settings.loss_for(system.observer)).is_encoded
        self._amplitude_adam = Adam(torch.from_numpy(self.amplitudes), settings.betas)

    def begin_again(self, settings: Settings, hologram: Hologram) -> None:
        """Begins a run with other settings of iterations and step from a hologram of the same bench."""
        self.settings = self.wavelengths.settings = settings
        self.amplitudes = next_amplitudes(hologram.system.amplitudes, self._are_on)
        self._amplitude_adam.reset()
        self.patterns.begin_again(settings, torch.from_numpy(hologram.drive))

    def evaluation_request(self, iteration: int) -> EvaluationRequest:
        """The quantities that the evaluation of an iteration has to compute."""
        amplitudes_due = iteration % self.settings.amplitudes_every == 0
        is_last = iteration == self.settings.iterations
        free_amplitudes = "amplitudes" in self.settings.free
        solvable = free_amplitudes and (not self._is_nonlinear_loss or iteration == 0)
        return EvaluationRequest(
            path_gradient=not is_last,
            optimal_amplitudes=solvable and (amplitudes_due or is_last),
            eyebox_variation=amplitudes_due or is_last,
            amplitude_gradient=free_amplitudes and self._is_nonlinear_loss,
            wavelength_gradient=self.wavelengths.are_due(iteration),
            level_step_m=self.patterns.level_step_m(),
            curvature_weight=curvature_weight(iteration / self.settings.iterations),
        )

    def step(self, evaluation: LossEvaluation, iteration: int) -> bool:
        """Takes the steps of an iteration. Returns whether the wavelengths moved."""
        free, amplitude_gradient = self.settings.free, evaluation.amplitude_gradient
        if evaluation.optimal_amplitudes is not None:
            self.amplitudes = evaluation.optimal_amplitudes
        elif "amplitudes" in free and self._is_nonlinear_loss and amplitude_gradient is not None:
            self._step_amplitudes(amplitude_gradient)
        if iteration == self.wavelengths.iterations > 0:
            self.patterns.adam.reset()
        if "patterns" in free and evaluation.path_gradient is not None:
            self.patterns.step(evaluation.path_gradient, self.wavelengths.pattern_step_scale(iteration))
        if evaluation.wavelength_gradient is None:
            return False
        self.wavelengths.step(evaluation.wavelength_gradient, iteration)
        return True

    def state_dict(self) -> dict[str, NDArray[np.floating]]:
        """Copies of everything that the next step depends on."""
        adam, amplitude, wavelength = self.patterns.adam, self._amplitude_adam, self.wavelengths.adam
        return {
            "drive": self.patterns.drive.cpu().numpy().copy(),
            "first": adam.first_moment.cpu().numpy().copy(),
            "second": adam.second_moment.cpu().numpy().copy(),
            "amplitudes": self.amplitudes.copy(),
            "amplitude_moments": torch.stack([amplitude.first_moment, amplitude.second_moment]).numpy(),
            "wavelengths": self.wavelengths.values_m.copy(),
            "wavelength_moments": self.wavelengths.moments(),
            "steps": np.array([adam.step_count, amplitude.step_count, wavelength.step_count], dtype=np.float64),
        }

    def load_state_dict(self, state: dict[str, NDArray[np.floating]]) -> None:
        """Restores what `state_dict` gave."""
        adam, device = self.patterns.adam, self.patterns.drive.device
        self.patterns.drive, adam.first_moment, adam.second_moment = (
            torch.from_numpy(state[name].copy()).to(device) for name in ("drive", "first", "second")
        )
        self.amplitudes = state["amplitudes"].astype(np.float64)
        amplitude = self._amplitude_adam
        amplitude.first_moment, amplitude.second_moment = torch.from_numpy(state["amplitude_moments"].copy())
        adam.step_count, amplitude.step_count = (int(n) for n in state["steps"][:2])
        self.wavelengths.load(state, "steps", 2)

    def _step_amplitudes(self, gradient: Floats) -> None:
        """A step of the amplitudes' logarithms, whose gradient is a·∂L/∂a; lasers that are off stay off."""
        least = _MIN_RELATIVE_AMPLITUDE * self.amplitudes.max()
        self.amplitudes = np.where(self.amplitudes > 0, np.maximum(self.amplitudes, least), 0.0)
        step = self._amplitude_adam.unit_step(torch.from_numpy(gradient * self.amplitudes)).numpy()
        self.amplitudes = self.amplitudes * np.exp(-_LOG_AMPLITUDE_STEP * step)


# --- patterns --------------------------------------------------------------------------------------------------------


def first_drive(system: System, settings: Settings, start: Any) -> Tensor:
    """The drive with which an optimisation begins: `start`, or `initial_drive`. Raises UserError if it doesn't fit."""
    if start is None:
        return initial_drive(system, settings)
    return torch.tensor(checked_drive(system, start), dtype=torch.float32)


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
        self._per_rad = _drive_per_rad(system, 1.0)
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

    def begin_again(self, settings: Settings, drive: Tensor) -> None:
        """Begins again from another drive, with the steps of other settings."""
        self.drive.copy_(drive)
        self.adam.reset()
        self._step_size.copy_(torch.from_numpy(self._per_rad * settings.step_rad))

    def go_back(self, drive: Tensor, factor: float) -> None:
        """Begins again from another drive, with steps that are `factor` times those before."""
        self.drive.copy_(drive)
        self.step_factor *= factor
        self.adam.reset()

    def step(self, gradient: Tensor, scale: float) -> None:
        """One step against the gradient ∂L/∂opd, which it overwrites, `scale` times the first step's size."""
        self.move(gradient, self.step_numbers(scale))

    def step_numbers(self, scale: float) -> tuple[float, float, float]:
        """Counts a step. Returns Adam's corrections of its two moments, and the step's size over the first one's."""
        return *self.adam.count_step(), self.step_factor * scale

    def move(self, gradient: Tensor, numbers: Sequence[float] | Tensor) -> None:
        """The step of `step_numbers`, which may lie on the device; overwrites the gradient, and the drive in place."""
        first, second, size = numbers
        step = self.adam.corrected_step(gradient.mul_(self._stroke_m), first, second)
        self.drive.sub_(size * self._step_size * step).clamp_(0, 1)
