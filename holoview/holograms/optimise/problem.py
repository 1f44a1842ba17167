"""One evaluation of the loss and the requested gradients: forward model, objective and eyebox penalty together."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.agreement import AgreementPenalty
from holoview.holograms.optimise.eyebox_penalty import EyeboxPenalty
from holoview.holograms.optimise.eyes import Places
from holoview.holograms.optimise.field_loss import ComplexTarget, FieldEvaluation, check_suits, split_target
from holoview.holograms.optimise.forward_model import ProcessRows, make_forward_model
from holoview.holograms.optimise.kernel_choice import choose_kernels
from holoview.holograms.optimise.lasers import check_effects, with_only_lasers
from holoview.holograms.optimise.level_gradients import LevelSteps, gauss_newton_diagonal
from holoview.holograms.optimise.memory import memory_guard, require_optimisation_memory
from holoview.holograms.optimise.objective import (
    AmplitudeLeastSquares,
    Objective,
    RowEvaluation,
    RowResult,
    channels_of_wavelengths,
    make_objective,
)
from holoview.holograms.optimise.parallel import (
    MIN_SAMPLES_FOR_TEAM,
    SINGLE_PROCESS,
    ProcessGroup,
    shard_lasers,
    thread_count,
    torch_threads,
)
from holoview.holograms.optimise.propagation import Kernels
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.wavelengths import channel_wavelength_derivatives, check_wavelength_search
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import check_plan
from holoview.light.observers import drawn_people
from holoview.util.errors import UserError

Tensor = torch.Tensor
Floats = NDArray[np.float64]

_ROWS_TO_SEND = 128
"""Rows of the image that the processes of a group sum at a time: many, since each message takes a while."""


@dataclass(frozen=True)
class EvaluationRequest:
    """The quantities that an evaluation computes beside loss and PSNR; the fields are those of `LossEvaluation`.

    amplitude_gradient, wavelength_gradient: only together with path_gradient. level_step_m: replace the path gradient
    by secants to the neighbouring levels, at this optical path from those shown (see `level_gradients`).
    curvature_weight: the weight s of the secant's second term. planes: the planes that count, all when None; loss and
    gradient are then scaled by their share, so that the mean over all draws is that of all planes.
    """

    path_gradient: bool = False
    optimal_amplitudes: bool = False
    eyebox_variation: bool = False
    amplitude_gradient: bool = False
    wavelength_gradient: bool = False
    level_step_m: Tensor | None = None
    curvature_weight: float = 0.0
    planes: tuple[int, ...] | None = None

    @property
    def takes_all_planes(self) -> bool:
        """Whether a quantity is wanted that needs all planes."""
        wants_sums = self.optimal_amplitudes or self.eyebox_variation or self.wavelength_gradient
        return wants_sums or self.level_step_m is not None or not self.path_gradient

    @property
    def wants_only_path_gradient(self) -> bool:
        """Whether nothing is wanted beside the derivative ∂L/∂opd, the loss and the PSNR."""
        wants_more = self.optimal_amplitudes or self.eyebox_variation or self.needs_image_products
        return self.path_gradient and self.level_step_m is None and not wants_more

    @property
    def needs_image_products(self) -> bool:
        """Whether Σ ∂L/∂image·intensity is needed for a gradient."""
        return self.amplitude_gradient or self.wavelength_gradient


@dataclass(frozen=True)
class LossEvaluation:
    """The result of an evaluation; quantities that weren't requested are None.

    loss: with the eyebox's penalty. psnr_db: mean over planes. picture(): the middle plane in linear sRGB, (y, x, 3).
    path_gradient: ∂L/∂opd (frame, modulator, y, x), 1/m. wavelength_gradient: ∂L/∂λ (wavelength,), 1/m.
    amplitude_gradient: ∂(loss without penalty)/∂amplitude; optimal_amplitudes: the least-squares solution; both
    (frame, wavelength), 0 for lasers that are off. eyebox_variation: coefficient of variation of the eyebox's light.
    """

    loss: float
    psnr_db: float
    picture: Callable[[], NDArray[np.floating]]
    path_gradient: Tensor | None = None
    amplitude_gradient: Floats | None = None
    optimal_amplitudes: Floats | None = None
    wavelength_gradient: Floats | None = None
    eyebox_variation: float | None = None


class Problem:
    """A system, a target and a loss on a device, whose variables are then given to `evaluate`.

    stack: a focal stack, or a complex target.

    In a process group this process's model has only its own lasers, but `evaluate` returns the results of all lasers.
    lasers: (frame, wavelength) of the whole group. double: compute in float64 instead of float32. places_m: places of
    the eye's pupil, those of the settings when None. kernels: the fastest on this machine when None.
    Raises UserError for a target or settings that don't fit the system, and when memory is too small.
    """

    def __init__(
        self,
        system: System,
        stack: NDArray[np.floating] | ComplexTarget,
        settings: Settings,
        device: str = "cpu",
        group: ProcessGroup = SINGLE_PROCESS,
        *,
        double: bool = False,
        places_m: Places | None = None,
        kernels: Kernels | None = None,
    ) -> None:
        system.require_short_form("this optimisation")
        if system.is_field:
            raise UserError("modulators", "a field", expected="modulators, whose patterns are optimised")
        self.system, self.settings, self.group = system, settings, group
        stack, complex_target = split_target(stack)
        if complex_target is not None:
            check_suits(system, settings, group.size)
        free_wavelengths = "wavelengths" in settings.free
        self._places_m = settings.pupil_places_m if places_m is None else places_m
        plan = plan_for(system, settings, self._places_m)
        check_effects(plan, settings)
        if device == "cpu":
            require_optimisation_memory(system, free_wavelengths=free_wavelengths)
        shards = shard_lasers(plan, group)
        self.lasers = [laser for shard in shards for laser in shard]
        self._fields = None if complex_target is None else complex_target.of_lasers(self.lasers).to(device)
        self._own_lasers = group.shard(len(self.lasers))
        plan = with_only_lasers(plan, shards[group.rank])
        self.objective = self._make_objective(plan, stack, device, double)
        whole_planes = self._needs_whole_planes
        self._memory_guard = partial(
            memory_guard,
            free_wavelengths=free_wavelengths,
            whole_planes=whole_planes,
            drawn_pupils=settings.drawn_pupils,
        )
        if free_wavelengths:
            check_wavelength_search(system.observer, settings)
        people = drawn_people(settings.observers) if settings.observers else []
        self._agreement = AgreementPenalty(people, self.objective.loss) if people else None
        samples = math.prod(plan.grid.padded)
        team = thread_count(samples, MIN_SAMPLES_FOR_TEAM)
        with self._memory_guard(plan, device), torch_threads(thread_count(samples)):
            rows_at_a_time = None if group.size == 1 else _ROWS_TO_SEND
            if whole_planes:
                rows_at_a_time = plan.grid.shape[0]
            self._make_model = partial(
                make_forward_model, device=device, double=double, rows_at_a_time=rows_at_a_time, threads=team
            )
            self.model = self._make_model(plan, kernels=choose_kernels(device) if kernels is None else kernels)
            self._torch_threads = 1 if self.model.works_in_team else thread_count(samples)
            self._middle_image = torch.empty_like(self.objective.target[0])
            self.eyebox = EyeboxPenalty(self.model)
            self._transmittance_cache: dict[int, tuple[float, float]] = {}

    def change_kernels(self) -> None:
        """Goes on with the fastest kernels on this machine: the same numbers up to rounding."""
        plan, kernels = self.model.plan, choose_kernels(str(self.model.device))
        if kernels is not self.model.kernels:
            with self.guarded():
                del self.model, self.eyebox  # frees memory for the next ones
                self.model = self._make_model(plan, kernels=kernels)
                self.eyebox = EyeboxPenalty(self.model)

    def set_wavelengths(self, wavelengths_m: Floats) -> None:
        """Changes to other wavelengths (wavelength,) on the same grid."""
        self.system = self.system.edit({"wavelengths": wavelengths_m})
        plan = replace(make_plan(self.system, places_m=self._places_m), grid=self.model.plan.grid)
        self.model.set_plan(with_only_lasers(plan, self.model.lasers))
        self.objective.wavelength_channels = channels_of_wavelengths(self.objective.loss, plan, self.objective.target)
        self.eyebox = EyeboxPenalty(self.model)

    def see_from(self, places_m: Places, stack: NDArray[np.floating]) -> None:
        """Changes to other places of the eye's pupil, as many as before, and to the stack to be seen from them.

        stack: (place · plane, y, x, 3). Raises UserError for a stack of another shape.
        """
        self._places_m = places_m
        self.objective.set_stack(stack)
        with self.guarded():
            self.model.set_eyes(self.model.plan.seen_from(places_m))

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """The number of torch's threads that suits the fields, and a UserError if memory runs out inside the block."""
        guard = self._memory_guard(self.model.plan, str(self.model.device), is_made=True)
        with guard, torch_threads(self._torch_threads):
            yield

    def evaluate(self, opd_m: Tensor, amplitudes: Floats, request: EvaluationRequest) -> LossEvaluation:
        """The loss of optical paths (frame, modulator, y, x), m, and laser amplitudes (frame, wavelength)."""
        with self.guarded():
            return self._evaluate(opd_m, amplitudes, request)

    def is_fixed_work(self, request: EvaluationRequest) -> bool:
        """Whether a request is `path_gradient` and `plane_losses`: operations of the device, always the same ones."""
        simple = self.group.size == 1 and self.settings.eyebox == 0 and "wavelengths" not in self.settings.free
        return simple and request.wants_only_path_gradient and not self._needs_whole_planes and self.model.is_fixed_work

    def path_gradient(self, opd_m: Tensor, weights: Tensor, planes: Sequence[int]) -> tuple[Tensor, Tensor]:
        """Norms (plane, part, 2), as `ResidualSums.norms`, and ∂L/∂opd of some planes; all stays on the device.

        weights (own laser, channel): `image_weights` of the amplitudes.
        """
        request = EvaluationRequest(path_gradient=True, planes=tuple(planes))
        results = self._process_planes(opd_m, weights, None, request)
        gradient = torch.zeros_like(opd_m)
        self.model.accumulate_gradients(gradient)
        norms = _norms_of(results)
        share = len(planes) / len(self.objective.target)
        return norms, gradient.div_(share) if share < 1 else gradient

    @property
    def weights_shape(self) -> tuple[int, int]:
        """Of `image_weights`: numbers of lasers of this process, and of channels."""
        return self._own_lasers.stop - self._own_lasers.start, self.objective.target.shape[1]

    def image_weights(self, amplitudes: Floats) -> Tensor:
        """The light (own laser, channel), on the CPU, that unit intensity of each own laser adds to the image."""
        table = self._laser_channels() * self._laser_amplitudes(amplitudes)[:, None]
        return torch.from_numpy(table[self._own_lasers])

    def plane_losses(self, norms: Tensor, planes: Sequence[int]) -> LossEvaluation:
        """The evaluation of some planes from the norms (plane, part, 2), on the CPU."""
        losses = self.objective.plane_losses(planes, norms)
        return LossEvaluation(
            loss=sum(plane.loss for plane in losses) / (len(planes) / len(self.objective.target)),
            psnr_db=sum(plane.psnr_db for plane in losses) / len(planes),
            picture=lambda: self.objective.picture(self._middle_image),
        )

    def _evaluate(self, opd_m: Tensor, amplitudes: Floats, request: EvaluationRequest) -> LossEvaluation:
        objective, laser_amplitudes = self.objective, self._laser_amplitudes(amplitudes)
        least_squares = (
            AmplitudeLeastSquares(self._laser_channels(), self.group) if request.optimal_amplitudes else None
        )
        weights = self.image_weights(amplitudes).to(objective.target)
        image_products = torch.zeros(objective.target.shape[1], len(self.lasers), dtype=torch.float64)
        planes = request.planes or tuple(range(len(objective.target)))
        share = len(planes) / len(objective.target)
        results = self._process_planes(opd_m, weights, least_squares, replace(request, planes=planes))
        norms = _norms_of(results).cpu()
        for rows, plane_weight in zip(results, objective.plane_weights[list(planes)].tolist(), strict=True):
            for row in rows:
                if least_squares is not None and row.normal_equations is not None:
                    least_squares.add(row.normal_equations, plane_weight)
                if row.image_products is not None:
                    image_products[:, self._own_lasers] += row.image_products
        evaluation = self.plane_losses(norms, planes)
        if least_squares is not None:
            evaluation = replace(evaluation, optimal_amplitudes=self._solve_amplitudes(least_squares))
        evaluation = self._with_eyebox(evaluation, amplitudes, request, share)
        if not request.path_gradient:
            return evaluation
        evaluation = self._with_gradients(evaluation, image_products, laser_amplitudes, opd_m, request)
        if evaluation.path_gradient is not None and share < 1:
            evaluation.path_gradient.div_(share)
        if evaluation.amplitude_gradient is not None:
            evaluation.amplitude_gradient[:] /= share
        return evaluation

    def _process_planes(
        self, opd_m: Tensor, weights: Tensor, least_squares: AmplitudeLeastSquares | None, request: EvaluationRequest
    ) -> list[list[RowResult]]:
        """The results of the rows of each of `request.planes` for optical paths; gradients wait in the model."""
        assert request.planes is not None
        self.model.forward(opd_m, wavelength_gradient=request.wavelength_gradient)
        evaluate_rows, evaluate_lines = self._row_evaluation(weights, least_squares, request), None
        if isinstance(evaluate_rows, RowEvaluation) and evaluate_rows.is_plain:
            evaluate_lines = evaluate_rows.evaluate_lines
        return self.model.process_planes(
            request.planes, evaluate_rows, evaluate_lines, carry_back=request.path_gradient
        )

    @property
    def _needs_whole_planes(self) -> bool:
        """Whether all rows of a plane have to be evaluated at once."""
        return self.objective.needs_whole_planes or self._fields is not None

    def _make_objective(self, plan: Plan, stack: NDArray[np.floating], device: str, double: bool) -> Objective:
        return make_objective(plan, stack, self.settings, device=device, double=double)

    def _row_evaluation(
        self, weights: Tensor, least_squares: AmplitudeLeastSquares | None, request: EvaluationRequest
    ) -> ProcessRows[RowResult]:
        """The function that evaluates rows of a plane. weights (own laser, channel): of unit intensities."""
        if self._fields is not None:
            return FieldEvaluation(
                objective=self.objective,
                wanted=self._fields * self.model.carrier(),
                weights=weights,
                least_squares=least_squares,
                kernels=self.model.kernels,
                needs_gradient=request.path_gradient,
                picture=self._middle_image,
                pictured_plane=len(self.objective.target) // 2,
            )
        return RowEvaluation(
            objective=self.objective,
            group=self.group,
            weights=weights,
            least_squares=least_squares,
            kernels=self.model.kernels,
            needs_gradient=request.path_gradient,
            needs_image_products=request.path_gradient and request.needs_image_products,
            picture=self._middle_image,
            pictured_plane=len(self.objective.target) // 2,
        )

    def _with_eyebox(
        self, evaluation: LossEvaluation, amplitudes: Floats, request: EvaluationRequest, share: float
    ) -> LossEvaluation:
        """The evaluation with the eyebox's variation and penalty, where one of them is needed.

        share: of the planes that count, by which gradients are divided later.
        """
        if not request.eyebox_variation and self.settings.eyebox == 0:
            return evaluation
        block_means = self.eyebox.block_means(amplitudes)
        self.group.all_reduce_sum(block_means)
        variation = self.eyebox.variation(block_means)
        if not math.isfinite(variation):
            raise _no_light_error()
        loss = evaluation.loss
        if self.settings.eyebox > 0:
            loss += self.eyebox.add_penalty(block_means, amplitudes, self.settings.eyebox * share) / share
        return replace(evaluation, loss=loss, eyebox_variation=variation)

    def _with_gradients(
        self,
        evaluation: LossEvaluation,
        image_products: Tensor,
        laser_amplitudes: Floats,
        opd_m: Tensor,
        request: EvaluationRequest,
    ) -> LossEvaluation:
        """The evaluation with its gradients; image_products (channel, laser): of this process's lasers."""
        path_gradient, level_steps, sums = torch.zeros_like(opd_m), None, []
        wavelength_gradient = None
        if request.wavelength_gradient:
            wavelength_gradient = torch.zeros(len(self.system.wavelengths_m), dtype=torch.float64)
        if request.level_step_m is not None:
            curvature = request.curvature_weight * self._step_curvatures(laser_amplitudes)
            level_steps = LevelSteps(request.level_step_m, curvature)
        self.model.accumulate_gradients(path_gradient, wavelength_gradient, level_steps)
        if request.needs_image_products:
            sums.append(image_products)
        if wavelength_gradient is not None:
            sums.append(wavelength_gradient)
        self.group.all_reduce_sum(path_gradient, *sums)
        products = image_products.numpy()
        if wavelength_gradient is not None:
            self._add_colour_derivative(wavelength_gradient, products, laser_amplitudes)
            if self._agreement is not None:
                powers = self._per_frame_table(laser_amplitudes).mean(axis=0)
                _, pull = self._agreement.value_and_gradient(self.system.wavelengths_m, powers)
                wavelength_gradient += self.settings.agreement * torch.from_numpy(pull)
        amplitude_gradient = None
        if request.amplitude_gradient:
            amplitude_gradient = self._per_frame_table(np.einsum("lc,cl->l", self._laser_channels(), products))
        return replace(
            evaluation,
            path_gradient=path_gradient,
            amplitude_gradient=amplitude_gradient,
            wavelength_gradient=None if wavelength_gradient is None else wavelength_gradient.numpy(),
        )

    def _add_colour_derivative(
        self, wavelength_gradient: Tensor, image_products: NDArray[np.floating], laser_amplitudes: Floats
    ) -> None:
        """Adds the part of ∂L/∂λ that is due to the dependence of each laser's colour on its wavelength."""
        derivatives = channel_wavelength_derivatives(
            self.objective.loss, self.system.wavelengths_m, self.system.observer
        )
        for i, (_, λ) in enumerate(self.lasers):
            pull = derivatives[λ] @ image_products[:, i]
            wavelength_gradient[λ] += float(laser_amplitudes[i] * pull / self.system.frames)

    def _solve_amplitudes(self, least_squares: AmplitudeLeastSquares) -> Floats:
        least_squares.all_reduce()
        if least_squares.is_dark:
            raise _no_light_error()
        amplitudes = least_squares.solve()
        if not np.any(amplitudes > 0):
            raise UserError(
                "target",
                "is shown best with every laser off",
                expected="light in the region that these lasers can show",
                remedy="change the target, the region or the lasers",
            )
        return self._per_frame_table(amplitudes)

    def _step_curvatures(self, laser_amplitudes: Floats) -> Tensor:
        """κ (own laser, modulator), reduced by the absorption of the pixel's light and of the field it meets in
        stops."""
        grid = self.model.plan.grid
        samples = self.objective.target[0, 0][self.objective.region_slices].numel()
        squares = np.mean((self._laser_channels() * laser_amplitudes[:, None])[self._own_lasers] ** 2, axis=1)
        rows = []
        for (_, λ), square in zip(self.model.lasers, squares, strict=True):
            first, last = self._transmittances(λ)
            κ = gauss_newton_diagonal(float(square), grid.upsample, samples, self.model.source_count)
            rows.append([κ * first * last, κ * last * last] if self.model.has_second_modulator else [κ * last * last])
        return torch.tensor(rows)

    def _transmittances(self, wavelength: int) -> tuple[float, float]:
        if wavelength not in self._transmittance_cache:
            self._transmittance_cache[wavelength] = self.model.transfer_functions.transmittances(wavelength)
        return self._transmittance_cache[wavelength]

    def _laser_channels(self) -> Floats:
        """The part of a laser of unit amplitude and intensity in the mean over frames, (laser, channel)."""
        table = self.objective.wavelength_channels.cpu().double().numpy()
        return table[[λ for _, λ in self.lasers]] / self.system.frames

    def _laser_amplitudes(self, amplitudes: Floats) -> Floats:
        return np.array([amplitudes[laser] for laser in self.lasers])

    def _per_frame_table(self, values: Floats) -> Floats:
        """Values of the lasers that are on as a table (frame, wavelength); zero for the others."""
        table = np.zeros((self.system.frames, len(self.system.wavelengths_m)))
        for laser, value in zip(self.lasers, values, strict=True):
            table[laser] = value
        return table


def plan_for(system: System, settings: Settings, places_m: Places) -> Plan:
    """The plan; where wavelengths are free, on a grid padded for the walk-off of the longest one allowed."""
    plan = check_plan(make_plan(system, places_m=places_m))
    if "wavelengths" not in settings.free:
        return plan
    longest = system.wavelengths_m.copy()
    longest[np.argmax(longest)] = max(settings.wavelength_range_m[1], float(longest.max()))
    return replace(plan, grid=make_plan(system.edit({"wavelengths": longest})).grid)


def _norms_of(results: list[list[RowResult]]) -> Tensor:
    """Norms (plane, part, 2) as `ResidualSums` has them."""
    return torch.stack([row.sums.norms for rows in results for row in rows]).view(len(results), -1, 2)


def _no_light_error() -> UserError:
    return UserError("relay2", "no light passes its stops", remedy="widen iris_na or square, or narrow dc_block_na")
