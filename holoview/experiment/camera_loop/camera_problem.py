"""Loss and gradients of a hologram at the intensities that a camera measured.

A picture is linear in the intensities of all lasers. With the measured intensities Ĩ_j of frames and wavelengths j, the
operator C from the model's samples to camera pixels (`camera_view`), and the fields E_j of the model,

    L = L(Σ_j a_j·Ĩ_j, C·T),   c_E = 2·Cᵀ[∂L/∂I_j at Ĩ]·conj(E_j)·√(Ĩ_j/I_j)

so that the residual is that of the bench (Peng et al. 2020, sec. 4), and the field has the measured amplitude and the
model's phase. √(Ĩ/I) is brought from pixels to samples by the normalised transpose of C, and bounded. Where model and
bench are the same it is 1, and this is the gradient of the simulation. With measured amplitudes a wrong
model serves for longer: 14.5 instead of 14.0 dB from random patterns after 60 iterations without noise (96 × 128
pixels, three lasers, two planes, a gap wrong by 0.15 of 1 mm and a stroke by 7 %; the right model reaches 15.6 dB).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.experiment.camera_loop.bench_camera import Picture, Shot
from holoview.experiment.camera_loop.bench_match import lasers_of
from holoview.experiment.camera_loop.camera_view import CameraView, camera_view
from holoview.experiment.camera_loop.registration import Registration
from holoview.model.system import System
from holoview.optimise.forward_model import ProcessRows
from holoview.optimise.objective import (
    AmplitudeLeastSquares,
    NormalEquations,
    Objective,
    ResidualSums,
    RowResult,
    beam_weights_of,
    replace_by_adjoint,
)
from holoview.optimise.problem import EvaluationRequest, Floats, Problem
from holoview.optimise.settings import Settings
from holoview.rig.description import RigDescription
from holoview.util.errors import UserError

Tensor = torch.Tensor

_LEAST_INTENSITY = 0.01  # of the mean, added to both intensities of a ratio: phases are undefined in the dark
_MAX_FACTOR = 4.0  # of an amplitude
_LEAST_WEIGHT = 1e-6  # of a sample in the camera's pixels, below which no pixel sees it


@dataclass(frozen=True)
class RecordedPlane:
    """What was measured of a plane.

    intensity (laser, row, column): in the model's unit. usable (row, column): pixels that count. view: of the camera.
    """

    intensity: Tensor
    usable: Tensor
    view: CameraView


@dataclass(frozen=True)
class RecordedEvaluation:
    """Evaluates whole planes at recorded intensities. To be called by `ForwardModel.process_planes`.

    weights (laser, channel): what a laser's unit intensity adds to the image. The other fields as in `RowEvaluation`.
    """

    objective: Objective
    planes: Sequence[RecordedPlane]
    weights: Tensor
    least_squares: AmplitudeLeastSquares | None
    request: EvaluationRequest
    picture: Tensor
    pictured_plane: int

    def __call__(self, plane: int, rows: slice, fields: Tensor) -> RowResult:
        """The result of a plane. fields (laser, source, y, x): E, replaced by c_E if a gradient is needed."""
        recorded, target = self.planes[plane], self.objective.target[plane]
        usable, intensity = recorded.usable, recorded.intensity
        image = torch.einsum("lc,lyx->cyx", self.weights, intensity)
        if plane == self.pictured_plane:
            self.picture.copy_(image)
        image = torch.where(usable, image, target)  # no residual where nothing is known
        sums = self.objective.evaluate_rows(plane, slice(0, image.shape[1]), image)  # image is now ∂L/∂image
        share = float(usable.numel() / usable.sum())
        image.mul_(usable).mul_(share)  # the loss is the mean over pixels that count
        sums = ResidualSums(sums.residual_norm * share**0.5, sums.error_norm * share**0.5)
        products = None
        if self.request.path_gradient and self.request.needs_image_products:
            products = (image.flatten(1) @ intensity.flatten(1).T).double().cpu()
        if self.request.path_gradient:
            _give_measured_amplitude(fields, recorded)
            slopes = recorded.view.transposed(image)
            beam_weights = beam_weights_of(self.weights, fields.shape[1])
            replace_by_adjoint(fields, beam_weights, slopes, torch.empty_like(torch.view_as_real(fields)))
        return RowResult(sums, self._normal_equations(intensity, target, usable), products)

    def _normal_equations(self, intensity: Tensor, target: Tensor, usable: Tensor) -> NormalEquations | None:
        if self.least_squares is None:
            return None
        return self.least_squares.normal_equations(intensity * usable, target * usable)


def _give_measured_amplitude(fields: Tensor, recorded: RecordedPlane) -> None:
    """Multiplies fields (laser, source, y, x) by √(measured/predicted intensity); by 1 where nothing is known."""
    view = recorded.view
    predicted = torch.view_as_real(fields).square().sum(-1).mean(dim=1)
    floor = _LEAST_INTENSITY * predicted.mean(dim=(1, 2), keepdim=True) + 1e-30
    ratio = (recorded.intensity.clamp_min(0) + floor) / (view.picture(predicted) + floor)
    ratio = torch.where(recorded.usable, ratio, 1.0)
    if not view.is_identity:
        weight = view.transposed(torch.ones_like(ratio[0]))
        ratio = torch.where(weight > _LEAST_WEIGHT, view.transposed(ratio) / weight.clamp_min(_LEAST_WEIGHT), 1.0)
    fields.mul_(ratio.clamp_(0.0, _MAX_FACTOR**2).sqrt_()[:, None])


def require_camera_settings(settings: Settings) -> None:
    """Raises UserError for settings that a camera behind a rig can't serve: free wavelengths, pupils."""
    if "wavelengths" in settings.free:
        raise UserError("--free", "wavelengths with --rig", expected="patterns and amplitudes: lasers have theirs")
    if settings.pupil_places_m or settings.drawn_pupils:
        raise UserError("--pupils", "with --rig", expected="no pupils: the camera stands in the focal planes")


class CameraProblem(Problem):
    """A system, a target and a loss, evaluated at what a rig's camera saw.

    Call `register` first, and `set_pictures` before `evaluate`, with the pictures of the patterns that are evaluated.
    Arguments as of `Problem`. Raises UserError as `require_camera_settings` does.
    """

    def __init__(
        self, system: System, stack: NDArray[np.floating], settings: Settings, rig: RigDescription, device: str = "cpu"
    ) -> None:
        require_camera_settings(settings)
        self._rig, self._planes = rig, list[RecordedPlane]()
        super().__init__(system, stack, settings, device)
        self._sampled_objective = self.objective
        self._views: list[CameraView] = []

    @property
    def shots(self) -> list[Shot]:
        """The pictures that an evaluation needs, plane by plane, in each in the order of `lasers`."""
        wavelengths = lasers_of(self.system, self._rig)
        return [Shot(frame, wavelengths[λ], float(z)) for z in self.system.planes_m for frame, λ in self.lasers]

    @property
    def sample_pitch_m(self) -> float:
        """Of the model's samples."""
        return self.model.plan.grid.pitch_m

    def predict(self, opd_m: Tensor) -> Tensor:
        """Intensities (plane, laser, y, x) on the model's samples for optical paths (frame, modulator, y, x), m."""
        result = self.objective.target.new_empty(
            len(self.system.planes_m), len(self.lasers), *self.model.plan.grid.shape
        )

        def keep(plane: int, rows: slice, fields: Tensor) -> None:
            result[plane, :, rows] = torch.view_as_real(fields).square().sum(-1).mean(dim=1)

        self.model.forward(opd_m)
        self.model.process_planes(range(len(result)), keep, carry_back=False)
        return result.cpu()

    def register(self, registration: Registration) -> None:
        """Takes over scale and displacements. Raises UserError where the camera sees nothing of what counts."""
        self._scale, sampled = registration.scale, self._sampled_objective
        self._views = [
            camera_view(self._rig, self.model.plan.grid.shape, self.sample_pitch_m, (float(y), float(x)))
            for y, x in registration.shift_m
        ]
        target = torch.stack([view.picture(t) for view, t in zip(self._views, sampled.target, strict=True)])
        self._covered = [torch.as_tensor(view.covers(self.settings.region)) for view in self._views]
        if not all(covered.any() for covered in self._covered):
            raise UserError("camera", "sees nothing of the region", remedy="choose another --region or move the camera")
        weights = sampled.plane_weights
        self.objective = Objective(sampled.loss, sampled.wavelength_channels, target, weights, None)
        self._middle_image = torch.empty_like(target[0])

    def set_pictures(self, pictures: Sequence[Picture]) -> None:
        """Takes over the pictures of `shots`."""
        self._planes, count = [], len(self.lasers)
        scale = self._scale[[λ for _, λ in self.lasers], None, None]
        for k, (view, covered) in enumerate(zip(self._views, self._covered, strict=True)):
            own = pictures[k * count : (k + 1) * count]
            intensity = torch.as_tensor(np.array([picture.light for picture in own]) / scale)
            saturated = torch.as_tensor(np.any([picture.saturated for picture in own], axis=0))
            usable = covered & ~saturated
            if not usable.any():
                raise UserError("camera", "every pixel that counts is saturated", remedy="allow shorter exposures")
            target = self.objective.target
            self._planes.append(RecordedPlane(intensity.to(target), usable.to(target.device), view))

    @property
    def _needs_whole_planes(self) -> bool:
        return True

    def _row_evaluation(
        self, weights: Tensor, least_squares: AmplitudeLeastSquares | None, request: EvaluationRequest
    ) -> ProcessRows[RowResult]:
        middle = len(self.objective.target) // 2
        return RecordedEvaluation(
            self.objective, self._planes, weights, least_squares, request, self._middle_image, middle
        )

    def _step_curvatures(self, laser_amplitudes: Floats) -> Tensor:
        """As of samples; means over p² of them reduce the squares of independent changes by p⁴ for each pixel."""
        return super()._step_curvatures(laser_amplitudes) / self._views[0].points ** 4
