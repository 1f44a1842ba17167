"""All that is sought (patterns, laser amplitudes, wavelengths), how each moves, and what a checkpoint keeps of it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.model.system import System
from holoview.optimise.adam import Adam, sqrt_decay
from holoview.optimise.level_gradients import curvature_weight
from holoview.optimise.losses import find_loss_space
from holoview.optimise.patterns import PatternVariables
from holoview.optimise.problem import EvaluationRequest, LossEvaluation
from holoview.optimise.settings import Settings
from holoview.optimise.wavelengths import project_wavelengths

Floats = NDArray[np.float64]

_LOG_AMPLITUDE_STEP = 0.02  # Adam's step of the amplitudes' logarithm, where they have no closed form
_MIN_WAVELENGTH_STEPS = 8  # steps of the wavelengths, in runs too short for one at every solution of the amplitudes
_MIN_RELATIVE_AMPLITUDE = 1e-6  # of the brightest laser: from nothing, a logarithm can't move


class OptimisationVariables:
    """Patterns, amplitudes (frame, wavelength) and wavelengths (wavelength,), and the moments that move them."""

    def __init__(self, system: System, settings: Settings, drive: torch.Tensor) -> None:
        self.settings = settings
        self.patterns = PatternVariables(system, settings, drive)
        self.amplitudes = np.array(system.amplitudes)
        self.wavelengths_m = np.array(system.wavelengths_m)
        self._is_nonlinear_loss = find_loss_space(settings.loss_for(system.observer)).is_encoded
        self._amplitude_adam = Adam(torch.from_numpy(self.amplitudes), settings.betas)
        self._wavelength_adam = Adam(torch.from_numpy(self.wavelengths_m), settings.betas)
        if "wavelengths" in settings.free:
            self.wavelengths_m = project_wavelengths(self.wavelengths_m, settings)
        self.wavelengths_adjusted = bool(np.any(self.wavelengths_m != system.wavelengths_m))

    @property
    def wavelength_iterations(self) -> int:
        """Iterations in which wavelengths move: half of them. Then the patterns' steps start over at full size."""
        return self.settings.iterations // 2 if "wavelengths" in self.settings.free else 0

    def evaluation_request(self, iteration: int) -> EvaluationRequest:
        """What the evaluation of an iteration has to bring."""
        free = self.settings.free
        due = iteration % self.settings.amplitudes_every == 0
        shifting = (
            iteration % max(1, min(self.settings.amplitudes_every, self.wavelength_iterations // _MIN_WAVELENGTH_STEPS))
            == 0
        )
        last = iteration == self.settings.iterations
        closed = "amplitudes" in free and (not self._is_nonlinear_loss or iteration == 0)
        return EvaluationRequest(
            path_gradient=not last,
            optimal_amplitudes=closed and (due or last),
            eyebox_variation=due or last,
            amplitude_gradient="amplitudes" in free and self._is_nonlinear_loss,
            wavelength_gradient=shifting and 0 < iteration < self.wavelength_iterations,
            level_step_m=self.patterns.level_step_m(),
            curvature_weight=curvature_weight(iteration / self.settings.iterations),
        )

    def step(self, found: LossEvaluation, iteration: int) -> bool:
        """Takes the iteration's steps; whether wavelengths moved."""
        if found.optimal_amplitudes is not None:
            self.amplitudes = found.optimal_amplitudes
        elif "amplitudes" in self.settings.free and self._is_nonlinear_loss and found.amplitude_gradient is not None:
            self._step_amplitudes(found.amplitude_gradient)
        if iteration == self.wavelength_iterations > 0:
            self.patterns.adam.reset()
        if "patterns" in self.settings.free and found.path_gradient is not None:
            self.patterns.step(found.path_gradient, self._pattern_step_size(iteration))
        if found.wavelength_gradient is None:
            return False
        self._step_wavelengths(found.wavelength_gradient, sqrt_decay(iteration, self.wavelength_iterations))
        return True

    def state_dict(self) -> dict[str, NDArray[np.floating]]:
        """Everything that the next step depends on, copied."""
        adam, amplitude, wavelength = self.patterns.adam, self._amplitude_adam, self._wavelength_adam
        return {
            "drive": self.patterns.drive.cpu().numpy().copy(),
            "first": adam.first_moment.cpu().numpy().copy(),
            "second": adam.second_moment.cpu().numpy().copy(),
            "amplitudes": self.amplitudes.copy(),
            "amplitude_moments": torch.stack([amplitude.first_moment, amplitude.second_moment]).numpy(),
            "wavelengths": self.wavelengths_m.copy(),
            "wavelength_moments": torch.stack([wavelength.first_moment, wavelength.second_moment]).numpy(),
            "steps": np.array([adam.step_count, amplitude.step_count, wavelength.step_count], dtype=np.float64),
        }

    def load_state_dict(self, state: dict[str, NDArray[np.floating]]) -> None:
        """Goes on from what `tensors` gave."""
        adam, device = self.patterns.adam, self.patterns.drive.device
        self.patterns.drive, adam.first_moment, adam.second_moment = (
            torch.from_numpy(state[name].copy()).to(device) for name in ("drive", "first", "second")
        )
        self.amplitudes = state["amplitudes"].astype(np.float64)
        self.wavelengths_m = state["wavelengths"].astype(np.float64)
        for moments, name in ((self._amplitude_adam, "amplitude"), (self._wavelength_adam, "wavelength")):
            moments.first_moment, moments.second_moment = torch.from_numpy(state[f"{name}_moments"].copy())
        adam.step_count, self._amplitude_adam.step_count, self._wavelength_adam.step_count = (
            int(n) for n in state["steps"]
        )

    def _pattern_step_size(self, iteration: int) -> float:
        """The patterns' step falls to zero; twice, where wavelengths move in the first half."""
        searching, total = self.wavelength_iterations, self.settings.iterations
        if iteration < searching:
            return sqrt_decay(iteration, searching)
        return sqrt_decay(iteration - searching, total - searching)

    def _step_amplitudes(self, slopes: Floats) -> None:
        lit = self.amplitudes > 0
        self.amplitudes = np.where(
            lit, np.maximum(self.amplitudes, _MIN_RELATIVE_AMPLITUDE * self.amplitudes.max()), 0.0
        )
        step = self._amplitude_adam.unit_step(torch.from_numpy(slopes * self.amplitudes)).numpy()
        self.amplitudes = self.amplitudes * np.exp(-_LOG_AMPLITUDE_STEP * step)

    def _step_wavelengths(self, slopes: Floats, fall: float) -> None:
        step = self._wavelength_adam.unit_step(torch.from_numpy(slopes)).numpy()
        self.wavelengths_m = project_wavelengths(
            self.wavelengths_m - fall * self.settings.wavelength_step_m * step, self.settings
        )
