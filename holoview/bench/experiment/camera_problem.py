"""Loss and gradients of a hologram at the intensities that a camera measured.

CameraProblem       the loss and its gradients
CameraSampling      means over the camera's pixels of intensities on the model's samples; the transpose
CameraCalibration   counts per unit of intensity, and where the camera is, from pictures of probe patterns

A picture is linear in the intensities of all lasers. With the measured intensities Ĩ_j of frames and wavelengths j, the
operator C from the model's samples to camera pixels (`CameraSampling`), and the fields E_j of the model,

    L = L(Σ_j a_j·Ĩ_j, C·T),   c_E = 2·Cᵀ[∂L/∂I_j at Ĩ]·conj(E_j)·√(Ĩ_j/I_j)

so that the residual is that of the bench (Peng et al. 2020, sec. 4), and the field has the measured amplitude and the
model's phase. √(Ĩ/I) is brought from pixels to samples by the normalised transpose of C, and bounded. Where model and
bench are the same it is 1, and this is the gradient of the simulation. With measured amplitudes a wrong
model serves for longer: 14.5 instead of 14.0 dB from random patterns after 60 iterations without noise (96 × 128
pixels, three lasers, two planes, a gap wrong by 0.15 of 1 mm and a stroke by 7 %; the right model reaches 15.6 dB).

C and its transpose are

    picture = A_y·I·A_xᵀ,   ∂L/∂I = A_yᵀ·(∂L/∂picture)·A_x

Along each axis A interpolates between samples, by a windowed sinc that keeps detail as fine as speckle
(`numerics.subpixel_shift`), at points of the camera's pixels, and takes the mean of a pixel's points, one for each
sample that fits on the pixel. If pixels coincide with samples, A is the identity. Rows of pixels are parallel to rows
of samples: a camera that is turned has to be turned back first.

The gain of a camera and the power of a laser aren't known, so that counts have an unknown factor for each wavelength.
Probe patterns are smooth, so that their light stays alike however wrong the model is: of each wavelength the factor is
the median over planes and probes of Σ seen / Σ predicted, to which differences of speckle add nothing on average. The
camera's displacement in a plane is that of the seen light from the predicted light, by their correlation. It moves the
prediction; pictures stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.diagnose.starts.picture import measure_displacement
from holoview.bench.experiment.bench_camera import PictureRequest, TakenPicture
from holoview.bench.experiment.rig_bench import lasers_of
from holoview.bench.rig.description import RigDescription
from holoview.holograms.optimise.forward_model import ProcessRows
from holoview.holograms.optimise.objective import (
    AmplitudeLeastSquares,
    NormalEquations,
    Objective,
    ResidualSums,
    RowResult,
    beam_weights_of,
)
from holoview.holograms.optimise.problem import EvaluationRequest, Floats, Problem
from holoview.holograms.optimise.propagation import TORCH_KERNELS
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.plan import Grid
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region, region_slices
from holoview.light.numerics.subpixel_shift import interpolation_weights
from holoview.util import units
from holoview.util.errors import UserError

Tensor = torch.Tensor

_LEAST_INTENSITY = 0.01  # of the mean, added to both intensities of a ratio: phases are undefined in the dark
_MAX_FACTOR = 4.0  # of an amplitude
_LEAST_WEIGHT = 1e-6  # of a sample in the camera's pixels, below which no pixel sees it
_SAME = 1e-6  # relative difference of lengths that are meant to be equal
_EDGE = 1e-3  # samples by which a point may lie outside and still count as inside
PROBE_SIGMAS_PX = (6.0, 3.0)
"""Blur of the probe patterns, modulator pixels."""
_ROUNDS, _LEAST_STEP_PX = 10, 0.005  # of finding the displacement, each from the last, until it moves less
_MAX_SHIFT = 0.25  # of the picture's shorter side
_LEAST_SHIFT_PX = 0.05  # less is as much as noise; a camera that is centred then stays so
_MIN_CORRELATION = 0.3  # of seen and predicted light, below which a displacement isn't believed


@dataclass(frozen=True)
class RecordedPlane:
    """The measured intensities of a plane.

    intensity (laser, row, column): in the model's unit. usable (row, column): pixels that count. view: of the camera.
    """

    intensity: Tensor
    usable: Tensor
    view: CameraSampling

    def image(self, weights: Tensor) -> Tensor:
        """The image (channel, row, column) of all lasers. weights (laser, channel): of unit intensities."""
        return torch.einsum("lc,lyx->cyx", weights, self.intensity)

    def replace_by_slopes(self, objective: Objective, plane: int, image: Tensor) -> ResidualSums:
        """Replaces an image by ∂L/∂image, with L as a mean over the pixels that count; returns its sums."""
        image.copy_(torch.where(self.usable, image, objective.target[plane]))  # no residual where nothing is known
        sums = objective.evaluate_rows(plane, slice(0, image.shape[1]), image)
        share = float(self.usable.numel() / self.usable.sum())
        image.mul_(self.usable).mul_(share)
        return ResidualSums(sums.norms * share**0.5)

    def amplitude_ratio(self, predicted: Tensor) -> Tensor:
        """√(measured/predicted intensity) (laser, y, x) at the samples; 1 where nothing is known.

        predicted (laser, y, x): intensities of the model.
        """
        floor = _LEAST_INTENSITY * predicted.mean(dim=(1, 2), keepdim=True) + 1e-30
        ratio = (self.intensity.clamp_min(0) + floor) / (self.view.picture(predicted) + floor)
        ratio = torch.where(self.usable, ratio, 1.0)
        if not self.view.is_identity:
            weight = self.view.transposed(torch.ones_like(ratio[0]))
            near = self.view.transposed(ratio) / weight.clamp_min(_LEAST_WEIGHT)
            ratio = torch.where(weight > _LEAST_WEIGHT, near, 1.0)
        return ratio.clamp_(0.0, _MAX_FACTOR**2).sqrt_()


@dataclass(frozen=True)
class RecordedEvaluation:
    """Evaluates whole planes at recorded intensities. To be called by `ForwardModel.process_planes`.

    weights (laser, channel): the image that a laser's unit intensity adds. The other fields as in `RowEvaluation`.
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
        image = recorded.image(self.weights)
        if plane == self.pictured_plane:
            self.picture.copy_(image)
        sums = recorded.replace_by_slopes(self.objective, plane, image)
        products = None
        if self.request.path_gradient and self.request.needs_image_products:
            products = (image.flatten(1) @ intensity.flatten(1).T).double().cpu()
        if self.request.path_gradient:
            predicted = torch.view_as_real(fields).square().sum(-1).mean(dim=1)
            fields.mul_(recorded.amplitude_ratio(predicted)[:, None])
            slopes = recorded.view.transposed(image)
            beam_weights = beam_weights_of(self.weights, fields.shape[1])
            TORCH_KERNELS.replace_by_adjoint(fields, beam_weights, slopes)
        return RowResult(sums, self._normal_equations(intensity, target, usable), products)

    def _normal_equations(self, intensity: Tensor, target: Tensor, usable: Tensor) -> NormalEquations | None:
        if self.least_squares is None:
            return None
        return self.least_squares.normal_equations(intensity * usable, target * usable)


def require_camera_settings(settings: Settings) -> None:
    """Raises UserError for settings that a camera behind a rig can't serve: free wavelengths, pupils."""
    if "wavelengths" in settings.free:
        raise UserError("--free", "wavelengths with --rig", expected="patterns and amplitudes: lasers have theirs")
    if settings.pupil_places_m or settings.drawn_pupils:
        raise UserError("--pupils", "with --rig", expected="no pupils: the camera stands in the focal planes")


class RecordedPictures:
    """What problems of every kind of bench do with the pictures of a rig.

    system, settings: of the problem. lasers: (frame, wavelength) of all that are on. grid: of the model's samples.
    objective: on these; after `calibrate` on the camera's pixels.
    """

    system: System
    settings: Settings
    lasers: list[tuple[int, int]]
    objective: Objective
    grid: Grid

    def _begin(self, rig: RigDescription) -> None:
        """To be called once `objective` is there."""
        self._rig, self._planes = rig, list[RecordedPlane]()
        self._sampled_objective, self._views = self.objective, list[CameraSampling]()

    @property
    def shots(self) -> list[PictureRequest]:
        """The pictures that an evaluation needs, plane by plane, in each in the order of `lasers`."""
        wavelengths = lasers_of(self.system, self._rig)
        return [
            PictureRequest(frame, wavelengths[λ], float(z)) for z in self.system.planes_m for frame, λ in self.lasers
        ]

    @property
    def sample_pitch_m(self) -> float:
        """Of the model's samples."""
        return self.grid.pitch_m

    def calibrate(self, calibration: CameraCalibration) -> None:
        """Takes over scale and displacements. Raises UserError if the camera sees no sample that counts."""
        self._scale, sampled = calibration.scale, self._sampled_objective
        self._views = [
            camera_sampling(self._rig, self.grid.shape, self.sample_pitch_m, (float(y), float(x)))
            for y, x in calibration.shift_m
        ]
        target = torch.stack([view.picture(t) for view, t in zip(self._views, sampled.target, strict=True)])
        self._covered = [torch.as_tensor(view.covers(self.settings.region)) for view in self._views]
        if not all(covered.any() for covered in self._covered):
            raise UserError("camera", "sees nothing of the region", remedy="choose another --region or move the camera")
        weights = sampled.plane_weights
        self.objective = Objective(sampled.loss, sampled.wavelength_channels, target, weights, None)

    def set_pictures(self, pictures: Sequence[TakenPicture]) -> None:
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


class CameraProblem(RecordedPictures, Problem):
    """A system, a target and a loss, evaluated at the intensities that a rig's camera measured.

    Call `calibrate` first, and `set_pictures` before `evaluate`, with the pictures of the patterns that are evaluated.
    Arguments as of `Problem`. Raises UserError as `require_camera_settings` does.
    """

    def __init__(
        self, system: System, stack: NDArray[np.floating], settings: Settings, rig: RigDescription, device: str = "cpu"
    ) -> None:
        require_camera_settings(settings)
        Problem.__init__(self, system, stack, settings, device)
        self._begin(rig)

    @property
    def grid(self) -> Grid:  # type: ignore[override]  # that of the model
        return self.model.plan.grid

    def predict(self, opd_m: Tensor) -> Tensor:
        """Intensities (plane, laser, y, x) on the model's samples for optical paths (frame, modulator, y, x), m."""
        result = self.objective.target.new_empty(len(self.system.planes_m), len(self.lasers), *self.grid.shape)

        def keep(plane: int, rows: slice, fields: Tensor) -> None:
            result[plane, :, rows] = torch.view_as_real(fields).square().sum(-1).mean(dim=1)

        self.model.forward(opd_m)
        self.model.process_planes(range(len(result)), keep, carry_back=False)
        return result.cpu()

    def calibrate(self, calibration: CameraCalibration) -> None:
        """As there."""
        super().calibrate(calibration)
        self._middle_image = torch.empty_like(self.objective.target[0])

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


class CameraSampling:
    """How a camera sees the samples of a focal plane.

    shape, pitch_m: rows and columns of samples, and their distance. camera_shape, camera_pitch_m: of the pixels, the
    pitch referred to the modulators. shift_m (y, x): light that should be at r in the picture is at r + shift; both are
    centred on the axis otherwise.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        pitch_m: float,
        camera_shape: tuple[int, int],
        camera_pitch_m: float,
        shift_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.shape, self.camera_shape = shape, camera_shape
        self.points = max(1, round(camera_pitch_m / pitch_m))
        same_pitch = abs(camera_pitch_m / pitch_m - 1) < _SAME
        self.is_identity = same_pitch and shape == camera_shape and not any(shift_m)
        step = camera_pitch_m / self.points / pitch_m
        self._positions: list[NDArray[np.float64]] = []
        for samples, pixels, shift in zip(shape, camera_shape, shift_m, strict=True):
            count = pixels * self.points
            centred = (np.arange(count, dtype=np.float64) - (count - 1) / 2) * step - shift / pitch_m
            self._positions.append(centred + (samples - 1) / 2)
        self._matrices = [
            _interpolation(position, samples, self.points)
            for position, samples in zip(self._positions, shape, strict=True)
        ]

    def picture(self, samples: Tensor) -> Tensor:
        """Real samples (…, y, x) as the camera's pixels see them, (…, row, column)."""
        if self.is_identity:
            return samples.clone()
        y, x = (matrix.to(samples) for matrix in self._matrices)
        return _apply(y, _apply(x, samples.mT).mT)

    def transposed(self, slopes: Tensor) -> Tensor:
        """The transpose of `picture`: from (…, row, column) to (…, y, x)."""
        if self.is_identity:
            return slopes.clone()
        y, x = (matrix.t().to(slopes) for matrix in self._matrices)
        return _apply(y, _apply(x, slopes.mT).mT)

    def covers(self, region: Region | None) -> NDArray[np.bool_]:
        """Which camera pixels (row, column) lie wholly inside a region of samples; inside all samples when None."""
        inside = []
        for position, part in zip(
            self._positions, region_slices(region or (0, 0, self.shape[1], self.shape[0])), strict=True
        ):
            points = (position >= part.start - 0.5 - _EDGE) & (position <= part.stop - 0.5 + _EDGE)
            inside.append(points.reshape(-1, self.points).all(axis=1))
        return np.logical_and.outer(*inside)


def camera_sampling(
    rig: RigDescription, shape: tuple[int, int], pitch_m: float, shift_m: tuple[float, float] = (0.0, 0.0)
) -> CameraSampling:
    """The view of a rig's camera that is displaced by a shift (y, x). shape, pitch_m: of the model's samples."""
    return CameraSampling(shape, pitch_m, rig.camera_shape, rig.bench.camera.pitch_m, shift_m)


def _interpolation(position: NDArray[np.float64], samples: int, points: int) -> Tensor:
    """A of an axis, sparse (pixel, sample), for the positions of all points; edges are continued outwards."""
    indices, weights = interpolation_weights(position)
    pixel = np.broadcast_to(np.arange(len(position))[:, None] // points, indices.shape)
    places = np.stack([pixel.ravel(), np.clip(indices, 0, samples - 1).ravel()])
    shape = (len(position) // points, samples)
    values = torch.from_numpy(weights.ravel() / points)
    return torch.sparse_coo_tensor(torch.from_numpy(places), values, shape, check_invariants=True).coalesce()


def _apply(matrix: Tensor, values: Tensor) -> Tensor:
    """A sparse matrix (row, y) times values (…, y, x)."""
    columns = values.movedim(-2, 0)
    product = torch.sparse.mm(matrix, columns.reshape(len(columns), -1))
    return product.view(-1, *columns.shape[1:]).movedim(0, -2)


@dataclass(frozen=True)
class CameraCalibration:
    """scale (wavelength,): counts per second and unit power for unit intensity. shift_m (plane, 2): of the camera.

    correlation (plane,): of seen and predicted light there. A displacement that can't be found is 0.
    """

    scale: Floats
    shift_m: Floats
    correlation: Floats

    def notes(self, planes_m: Floats) -> list[str]:
        """Notes on planes whose place couldn't be found."""
        return [
            f"at {units.format_rounded(float(z), 'mm')} pictures and prediction don't resemble each other (correlation "
            f"{c:.2f}); the camera counts as centred"
            for z, c in zip(planes_m, self.correlation, strict=True)
            if c < _MIN_CORRELATION
        ]


def probe_levels(rig: RigDescription, seed: int, sigmas_px: Sequence[float] = PROBE_SIGMAS_PX) -> NDArray[np.uint16]:
    """Grey levels (probe, modulator, y, x) of random patterns with these blurs, those of the probes by default."""
    rng = np.random.default_rng(seed)
    return np.array([rig.random_levels(rng, sigma_px) for sigma_px in sigmas_px], np.uint16)


def calibrate_camera(
    rig: RigDescription, predicted: Tensor, pitch_m: float, pictures: Sequence[Sequence[Sequence[TakenPicture]]]
) -> CameraCalibration:
    """Probes and their pictures. predicted: intensities (plane, wavelength, probe, y, x); pictures: the same, nested.

    pitch_m: of the predicted samples. Raises UserError where a laser's light doesn't reach the camera.
    """
    shifts, correlations, ratios = [], [], []
    for samples, of_plane in zip(predicted, pictures, strict=True):
        seen = np.array([[picture.light for picture in of_laser] for of_laser in of_plane])
        saturated = np.array([[picture.saturated for picture in of_laser] for of_laser in of_plane])
        found = _find_shift(rig, samples, pitch_m, seen)
        shifts.append(found.shift_m)
        correlations.append(found.correlation)
        usable = found.covered & ~saturated
        totals = [np.where(usable, values, 0.0).sum(axis=(2, 3)) for values in (seen, found.model)]
        ratios.append(totals[0] / np.maximum(totals[1], 1e-30))
    scale = np.median(np.concatenate(ratios, axis=1), axis=1)
    if not (scale > 0).all():
        dark = pictures[0][int(np.argmin(scale))][0].capture.wavelength_m[0]
        text = f"no light of {units.format_rounded(float(dark), 'nm')} in the pictures"
        raise UserError("camera", text, remedy="check the laser, its shutter and the longest exposure allowed")
    return CameraCalibration(scale, np.array(shifts), np.array(correlations))


@dataclass(frozen=True)
class _Placed:
    """A prediction on the camera's pixels. covered: which of them it covers. model: 0 elsewhere."""

    shift_m: Floats
    correlation: float
    model: Floats
    covered: NDArray[np.bool_]


def _find_shift(rig: RigDescription, samples: Tensor, pitch_m: float, seen: Floats) -> _Placed:
    """The prediction where it resembles the seen light most. samples, seen: (wavelength, probe, y, x)."""
    camera_pitch_m = rig.bench.camera.pitch_m
    centred = best = _place(rig, samples, pitch_m, seen, np.zeros(2))
    tried = centred
    for _ in range(_ROUNDS):
        visible = seen * tried.covered  # light that the prediction lacks at its edges would pull it there
        images = (values.reshape(-1, *rig.camera_shape).astype(np.float32) for values in (visible, tried.model))
        step_px = measure_displacement(*images)
        shift = tried.shift_m + step_px * camera_pitch_m
        if np.abs(shift).max() > camera_pitch_m * min(rig.camera_shape) * _MAX_SHIFT:
            break  # the correlation has no peak that means anything
        tried = _place(rig, samples, pitch_m, seen, shift)
        best = max(best, tried, key=lambda registered: registered.correlation)
        if np.abs(step_px).max() < _LEAST_STEP_PX:
            break
    is_moved = np.abs(best.shift_m).max() >= _LEAST_SHIFT_PX * camera_pitch_m
    return best if is_moved and best.correlation >= _MIN_CORRELATION else centred


def _place(rig: RigDescription, samples: Tensor, pitch_m: float, seen: Floats, shift_m: Floats) -> _Placed:
    shape = (samples.shape[-2], samples.shape[-1])
    view = camera_sampling(rig, shape, pitch_m, (float(shift_m[0]), float(shift_m[1])))
    covered = view.covers(None)
    model = view.picture(samples).double().numpy() * covered
    return _Placed(shift_m, _correlation(seen, model, covered), model, covered)


def _correlation(first: Floats, second: Floats, covered: NDArray[np.bool_]) -> float:
    """The mean correlation coefficient of pairs of images (…, y, x) over the pixels that are covered; 0 without any."""
    if not covered.any():
        return 0.0
    a, b = (values[..., covered] - values[..., covered].mean(axis=-1, keepdims=True) for values in (first, second))
    power = np.sqrt((a**2).sum(-1) * (b**2).sum(-1))
    return float(np.mean((a * b).sum(-1) / np.maximum(power, 1e-30)))
