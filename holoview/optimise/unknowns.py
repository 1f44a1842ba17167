"""All that is sought (patterns, laser amplitudes, wavelengths), how each moves, and what a checkpoint keeps of it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.optimise.adam import Adam, fall
from holoview.optimise.losses import find_loss
from holoview.optimise.patterns import Patterns
from holoview.optimise.problem import Evaluation, Wanted
from holoview.optimise.quantise import stiffness
from holoview.optimise.settings import Settings
from holoview.optimise.wavelengths import allowed
from holoview.system import System

Floats = NDArray[np.float64]

_AMPLITUDE_RATE = 0.02  # Adam's step of the amplitudes' logarithm, where they have no closed form
_LEAST_SHIFTS = 8  # steps of the wavelengths, in runs too short for one at every solution of the amplitudes
_DIMMEST = 1e-6  # of the brightest laser: from nothing, a logarithm can't move


class Unknowns:
    """Patterns, amplitudes (frame, wavelength) and wavelengths (wavelength,), and the moments that move them."""

    def __init__(self, system: System, settings: Settings, drive: torch.Tensor) -> None:
        self.settings = settings
        self.patterns = Patterns(system, settings, drive)
        self.amplitudes = np.array(system.amplitudes)
        self.wavelengths_m = np.array(system.wavelengths_m)
        self._curved = find_loss(settings.loss_for(system.observer)).encoded
        self._amplitude_adam = Adam(torch.from_numpy(self.amplitudes), settings.betas)
        self._wavelength_adam = Adam(torch.from_numpy(self.wavelengths_m), settings.betas)
        if "wavelengths" in settings.free:
            self.wavelengths_m = allowed(self.wavelengths_m, settings)
        self.wavelengths_moved = bool(np.any(self.wavelengths_m != system.wavelengths_m))

    @property
    def searching(self) -> int:
        """Iterations in which wavelengths move: half of them. Then the patterns' steps start over at full size."""
        return self.settings.iterations // 2 if "wavelengths" in self.settings.free else 0

    def wanted(self, iteration: int) -> Wanted:
        """What the evaluation of an iteration has to bring."""
        free = self.settings.free
        due = iteration % self.settings.amplitudes_every == 0
        shifting = iteration % max(1, min(self.settings.amplitudes_every, self.searching // _LEAST_SHIFTS)) == 0
        last = iteration == self.settings.iterations
        closed = "amplitudes" in free and (not self._curved or iteration == 0)
        return Wanted(
            gradient=not last,
            amplitudes=closed and (due or last),
            eyebox=due or last,
            amplitude_slopes="amplitudes" in free and self._curved,
            chromatic=shifting and 0 < iteration < self.searching,
            jump_m=self.patterns.jump_m(),
            stiffness=stiffness(iteration / self.settings.iterations),
        )

    def move(self, found: Evaluation, iteration: int) -> bool:
        """Takes the iteration's steps; whether wavelengths moved."""
        if found.solved is not None:
            self.amplitudes = found.solved
        elif "amplitudes" in self.settings.free and self._curved and found.amplitude_slopes is not None:
            self._move_amplitudes(found.amplitude_slopes)
        if iteration == self.searching > 0:
            self.patterns.adam.forget()
        if "patterns" in self.settings.free and found.gradient is not None:
            self.patterns.move(found.gradient, self._fall(iteration))
        if found.chromatic is None:
            return False
        self._move_wavelengths(found.chromatic, fall(iteration, self.searching))
        return True

    def tensors(self) -> dict[str, NDArray[np.floating]]:
        """Everything that the next step depends on, copied."""
        adam, amplitude, wavelength = self.patterns.adam, self._amplitude_adam, self._wavelength_adam
        return {
            "drive": self.patterns.drive.cpu().numpy().copy(),
            "first": adam.first.cpu().numpy().copy(),
            "second": adam.second.cpu().numpy().copy(),
            "amplitudes": self.amplitudes.copy(),
            "amplitude_moments": torch.stack([amplitude.first, amplitude.second]).numpy(),
            "wavelengths": self.wavelengths_m.copy(),
            "wavelength_moments": torch.stack([wavelength.first, wavelength.second]).numpy(),
            "steps": np.array([adam.count, amplitude.count, wavelength.count], dtype=np.float64),
        }

    def load(self, kept: dict[str, NDArray[np.floating]]) -> None:
        """Goes on from what `tensors` gave."""
        adam, device = self.patterns.adam, self.patterns.drive.device
        self.patterns.drive, adam.first, adam.second = (
            torch.from_numpy(kept[name].copy()).to(device) for name in ("drive", "first", "second")
        )
        self.amplitudes = kept["amplitudes"].astype(np.float64)
        self.wavelengths_m = kept["wavelengths"].astype(np.float64)
        for moments, name in ((self._amplitude_adam, "amplitude"), (self._wavelength_adam, "wavelength")):
            moments.first, moments.second = torch.from_numpy(kept[f"{name}_moments"].copy())
        adam.count, self._amplitude_adam.count, self._wavelength_adam.count = (int(n) for n in kept["steps"])

    def _fall(self, iteration: int) -> float:
        """The patterns' step falls to zero; twice, where wavelengths move in the first half."""
        searching, total = self.searching, self.settings.iterations
        if iteration < searching:
            return fall(iteration, searching)
        return fall(iteration - searching, total - searching)

    def _move_amplitudes(self, slopes: Floats) -> None:
        lit = self.amplitudes > 0
        self.amplitudes = np.where(lit, np.maximum(self.amplitudes, _DIMMEST * self.amplitudes.max()), 0.0)
        step = self._amplitude_adam.direction(torch.from_numpy(slopes * self.amplitudes)).numpy()
        self.amplitudes = self.amplitudes * np.exp(-_AMPLITUDE_RATE * step)

    def _move_wavelengths(self, slopes: Floats, fall: float) -> None:
        step = self._wavelength_adam.direction(torch.from_numpy(slopes)).numpy()
        self.wavelengths_m = allowed(self.wavelengths_m - fall * self.settings.wavelength_step_m * step, self.settings)
