"""A chain of elements at the intensities that a rig's camera measured: its loss, its gradients, and what is sought.

ChainCameraProblem   loss and gradients, by torch's own derivatives
ChainVariables       patterns by element and amplitudes, as a loop with a camera moves them

With the measured intensities Ĩ of `camera_problem`, the gradient is that of

    Σ_j Cᵀ[∂L/∂I_j at Ĩ]·√(Ĩ_j/I_j)·|E_j|²

with all factors but |E_j|² held: the derivative by E_j is c_E, whatever elements made the field.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.experiment.camera_problem import RecordedPictures, require_camera_settings
from holoview.bench.rig.description import RigDescription
from holoview.holograms.optimise.chain_loop import ChainPatterns, ChainProblem
from holoview.holograms.optimise.objective import AmplitudeLeastSquares
from holoview.holograms.optimise.problem import EvaluationRequest, LossEvaluation
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.wavelengths import FreeWavelengths
from holoview.light.model.system import System
from holoview.util.errors import UserError

Tensor = torch.Tensor
Floats = NDArray[np.float64]


class ChainCameraProblem(RecordedPictures):
    """As `CameraProblem`, of a chain. Raises UserError as `ChainProblem` and `require_camera_settings` do."""

    def __init__(
        self, system: System, stack: NDArray[np.floating], settings: Settings, rig: RigDescription, device: str = "cpu"
    ) -> None:
        require_camera_settings(settings)
        self._chain = ChainProblem(system, stack, settings, device)
        self.system, self.settings, self.grid = system, settings, self._chain.plan.grid
        self.lasers, self.objective = self._chain.lasers, self._chain.objective
        self._begin(rig)

    def predict(self, shown: Mapping[str, Tensor]) -> Tensor:
        """Intensities (plane, laser, y, x) on the model's samples for patterns by element."""
        with torch.no_grad():
            return self._chain.evaluate(shown, np.array(self.system.amplitudes)).intensity.movedim(1, 0).cpu()

    def evaluate(self, shown: Mapping[str, Tensor], amplitudes: Floats, request: EvaluationRequest) -> LossEvaluation:
        """The loss of patterns by element, whose pictures were set, and of laser amplitudes (frame, wavelength).

        Its `path_gradient` is ∂L/∂(pattern) of all that require gradients, one behind the other.
        """
        objective, channels = self.objective, self._chain.laser_channels()
        weights = channels * torch.as_tensor([amplitudes[laser] for laser in self.lasers]).to(channels)[:, None]
        squares, norms, slopes, images = AmplitudeLeastSquares(channels.cpu().double().numpy()), [], [], []
        for plane, recorded in enumerate(self._planes):
            target = objective.target[plane] * recorded.usable
            own = squares.normal_equations(recorded.intensity * recorded.usable, target)
            squares.add(own, float(objective.plane_weights[plane]))
            image = recorded.image(weights)
            images.append(image.clone())
            norms.append(recorded.replace_by_slopes(objective, plane, image).norms)
            slopes.append(torch.einsum("lc,cyx->lyx", weights, recorded.view.transposed(image)))
        losses = objective.plane_losses(range(len(norms)), torch.stack(norms)[:, None].cpu())
        loss, gradient = sum(plane.loss for plane in losses), None
        if request.path_gradient or self.settings.eyebox:
            penalty, gradient = self._gradient(shown, amplitudes, slopes)
            loss += penalty
        return LossEvaluation(
            loss=loss,
            psnr_db=sum(plane.psnr_db for plane in losses) / len(losses),
            picture=lambda: objective.picture(images[len(images) // 2]),
            path_gradient=gradient if request.path_gradient else None,
            optimal_amplitudes=self._solved(squares) if request.optimal_amplitudes else None,
        )

    def _gradient(
        self, shown: Mapping[str, Tensor], amplitudes: Floats, slopes: list[Tensor]
    ) -> tuple[float, Tensor | None]:
        """The eyebox's penalty, and ∂L/∂(pattern). slopes (laser, y, x): of each plane, Cᵀ ∂L/∂I."""
        found = self._chain.evaluate(shown, amplitudes)
        total = found.intensity.new_zeros(())
        for plane, (recorded, slope) in enumerate(zip(self._planes, slopes, strict=True)):
            intensity = found.intensity[:, plane]
            total = total + (slope * recorded.amplitude_ratio(intensity.detach()) * intensity).sum()
        penalty = self._chain.eyebox_penalty(found, amplitudes)
        moved = [drive for drive in shown.values() if drive.requires_grad]
        gradients = torch.autograd.grad(total + penalty, moved) if moved else ()
        return float(penalty), torch.cat([own.flatten() for own in gradients]) if moved else None

    def _solved(self, squares: AmplitudeLeastSquares) -> Floats:
        if squares.is_dark:
            raise UserError("camera", "sees no light", remedy="look at the stops, and begin with other patterns")
        return self._chain.as_table(squares.solve())


class ChainVariables:
    """Patterns by element, and amplitudes (frame, wavelength), which a loop moves; as of `OptimisationVariables`."""

    def __init__(self, system: System, settings: Settings, start: Mapping[str, Any] | None) -> None:
        self.settings, self.patterns = settings, ChainPatterns(system, settings, start)
        self.amplitudes = np.array(system.amplitudes)
        self._scale = FreeWavelengths(system.wavelengths_m, settings).pattern_step_scale

    def evaluation_request(self, iteration: int) -> EvaluationRequest:
        """The quantities that the evaluation of an iteration has to compute."""
        is_last = iteration == self.settings.iterations
        is_due = is_last or iteration % self.settings.amplitudes_every == 0
        return EvaluationRequest(
            path_gradient=not is_last, optimal_amplitudes=is_due and "amplitudes" in self.settings.free
        )

    def step(self, evaluation: LossEvaluation, iteration: int) -> None:
        """Takes the steps of an iteration."""
        if evaluation.optimal_amplitudes is not None:
            self.amplitudes = evaluation.optimal_amplitudes
        if "patterns" in self.settings.free and evaluation.path_gradient is not None:
            own = self.patterns.variables
            parts = torch.split(evaluation.path_gradient, [variable.numel() for variable in own])
            gradients = [part.view_as(variable) for part, variable in zip(parts, own, strict=True)]
            self.patterns.step(gradients, self._scale(iteration))

    def state_dict(self) -> dict[str, NDArray[np.floating]]:
        """Copies of everything that the next step depends on."""
        return {**self.patterns.tensors(), "amplitudes": self.amplitudes.copy()}

    def load_state_dict(self, state: Mapping[str, NDArray[np.floating]]) -> None:
        """Restores what `state_dict` gave."""
        self.patterns.load(state)
        self.amplitudes = state["amplitudes"].astype(np.float64)
