"""One evaluation of the loss: model, objective and eyebox together, plane by plane."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.optimise.amplitudes import AmplitudeLeastSquares
from holoview.optimise.autograd_model import make_forward_model
from holoview.optimise.eyebox_penalty import EyeboxPenalty
from holoview.optimise.level_gradients import LevelSteps, gauss_newton_diagonal
from holoview.optimise.memory import memory_guard, should_keep_fields
from holoview.optimise.objective import channels_of_wavelengths, make_objective
from holoview.optimise.process_group import SINGLE_PROCESS, ProcessGroup, shard_lasers, with_only_lasers
from holoview.optimise.settings import Settings
from holoview.optimise.threads import limit_torch_threads
from holoview.optimise.wavelengths import channel_wavelength_derivatives, check_wavelength_search
from holoview.util.errors import UserError

Tensor = torch.Tensor
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class EvaluationRequest:
    """What an evaluation shall bring beside loss and PSNR."""

    path_gradient: bool = False
    optimal_amplitudes: bool = False  # their closed form
    eyebox_variation: bool = False
    amplitude_gradient: bool = False  # with the gradient, for losses without a closed form
    wavelength_gradient: bool = False  # the gradient with respect to the wavelengths
    level_step_m: Tensor | None = (
        None  # take slopes to neighbouring levels, this far from those shown, for the gradient
    )
    curvature_weight: float = 0.0  # share of a jump's own cost that counts

    @property
    def needs_image_products(self) -> bool:
        """Whether Σ ∂L/∂image·intensity is needed."""
        return self.amplitude_gradient or self.wavelength_gradient


@dataclass(frozen=True)
class LossEvaluation:
    """loss and PSNR (dB, mean over planes); what wasn't wanted is None.

    gradient: ∂L/∂opd (frame, modulator, y, x). amplitude_slopes: ∂(image loss)/∂amplitude, solved: amplitudes of least
    squares, both (frame, wavelength). chromatic: ∂L/∂λ (wavelength,), 1/m. eyebox: coefficient of variation.
    picture: the middle plane in linear sRGB, (y, x, 3).
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
    """A system, a target and how to compare them, ready to be evaluated on a device.

    Of a team, this process's model has its part of the lasers; what `evaluate` brings is everybody's.
    """

    def __init__(
        self,
        system: System,
        stack: NDArray[np.floating],
        settings: Settings,
        device: str = "cpu",
        group: ProcessGroup = SINGLE_PROCESS,
    ) -> None:
        self.system, self.settings, self.group = system, settings, group
        plan = self._plan_of(system, settings)
        _check_effects(plan, settings)
        parts = shard_lasers(plan, group)
        self.lasers = [laser for part in parts for laser in part]
        self._own_lasers = group.shard(len(self.lasers))
        plan = with_only_lasers(plan, parts[group.rank])
        self._memory_guard = partial(memory_guard, free_wavelengths="wavelengths" in settings.free)
        self.objective = make_objective(plan, stack, settings, device=device)
        if "wavelengths" in settings.free:
            check_wavelength_search(system.observer, settings)
        self.samples = int(np.prod(plan.grid.padded))
        with self._memory_guard(plan, device), limit_torch_threads(self.samples):
            self.model = make_forward_model(plan, device=device, keep_fields=should_keep_fields(plan))
            self._intensity_buffer = torch.empty(len(self.model.lasers), *plan.grid.shape, device=self.model.device)
            self._image_buffers = torch.empty(2, *self.objective.target.shape[1:], device=self.model.device)
            self.eyebox = EyeboxPenalty(self.model)
            self._transmittance_cache: dict[int, tuple[float, float]] = {}

    def set_wavelengths(self, wavelengths_m: Floats) -> None:
        """Goes on with other wavelengths, on the same grid."""
        self.system = self.system.edit({"wavelengths": wavelengths_m})
        plan = replace(make_plan(self.system), grid=self.model.plan.grid)
        self.model.set_plan(with_only_lasers(plan, self.model.lasers))
        self.objective.wavelength_channels = channels_of_wavelengths(self.objective.loss, plan, self.objective.target)
        self.eyebox = EyeboxPenalty(self.model)

    def evaluate(self, opd_m: Tensor, amplitudes: Floats, request: EvaluationRequest) -> LossEvaluation:
        """The loss of optical paths (frame, modulator, y, x) and laser amplitudes (frame, wavelength)."""
        with self._memory_guard(self.model.plan, str(self.model.device)), limit_torch_threads(self.samples):
            return self._evaluate(opd_m, amplitudes, request)

    def _evaluate(self, opd_m: Tensor, amplitudes: Floats, wanted: EvaluationRequest) -> LossEvaluation:
        model, objective, intensity = self.model, self.objective, self._intensity_buffer
        model.forward(opd_m, wavelength_gradient=wanted.wavelength_gradient)
        colours, weights = self._laser_channels(), self._laser_amplitudes(amplitudes)
        problem = AmplitudeLeastSquares(colours, self.group)
        share = torch.as_tensor((colours * weights[:, None])[self._own_lasers]).to(intensity)
        products = torch.zeros(objective.target.shape[1], len(self.lasers), dtype=torch.float64)
        judged, middle = [], len(objective.target) // 2
        for plane in range(len(objective.target)):
            model.plane_intensity(plane, intensity)
            image = self._image_buffers[0]
            torch.mm(share.T, intensity.flatten(1), out=image.flatten(1))
            self.group.all_reduce_sum(image)
            if plane == middle:
                self._image_buffers[1].copy_(image)
            if wanted.optimal_amplitudes:
                inside = (..., *objective.region_slices)
                weight = float(objective.plane_weights[plane])
                problem.add_plane(intensity[inside], objective.target[plane][inside], weight)
            judged.append(objective.evaluate_plane(plane, image))
            if wanted.path_gradient:
                if wanted.needs_image_products:
                    products[:, self._own_lasers] += (image.flatten(1) @ intensity.flatten(1).T).cpu().double()
                torch.mm(share, image.flatten(1), out=intensity.flatten(1))
                model.backpropagate_plane(plane, intensity)
        found = LossEvaluation(
            loss=sum(j.loss for j in judged),
            psnr_db=float(np.mean([j.psnr_db for j in judged])),
            picture=lambda: objective.picture(self._image_buffers[1]),
            optimal_amplitudes=self._solve_amplitudes(problem) if wanted.optimal_amplitudes else None,
        )
        found = self._with_eyebox(found, amplitudes, wanted)
        return self._with_gradients(found, products, weights, opd_m, wanted) if wanted.path_gradient else found

    def _with_eyebox(self, found: LossEvaluation, amplitudes: Floats, wanted: EvaluationRequest) -> LossEvaluation:
        if not wanted.eyebox_variation and self.settings.eyebox == 0:
            return found
        blocks = self.eyebox.block_means(amplitudes)
        self.group.all_reduce_sum(blocks)
        variation = self.eyebox.variation(blocks)
        if not math.isfinite(variation):
            raise _no_light_error()
        loss = found.loss
        if self.settings.eyebox > 0:
            loss += self.eyebox.add_penalty(blocks, amplitudes, self.settings.eyebox)
        return replace(found, loss=loss, eyebox_variation=variation)

    def _with_gradients(
        self, found: LossEvaluation, products: Tensor, weights: Floats, opd_m: Tensor, wanted: EvaluationRequest
    ) -> LossEvaluation:
        """products (channel, laser): Σ ∂L/∂image·intensity, of this process's lasers."""
        gradient = torch.zeros_like(opd_m)
        model = self.model
        chromatic = (
            torch.zeros(len(self.system.wavelengths_m), dtype=torch.float64) if wanted.wavelength_gradient else None
        )
        jumps = (
            None
            if wanted.level_step_m is None
            else LevelSteps(wanted.level_step_m, wanted.curvature_weight * self._step_curvatures(weights))
        )
        model.accumulate_gradients(gradient, chromatic, jumps)
        self.group.all_reduce_sum(
            gradient, *([products] if wanted.needs_image_products else []), *([] if chromatic is None else [chromatic])
        )
        pulls = products.numpy()
        if chromatic is not None:
            colour = channel_wavelength_derivatives(
                self.objective.loss, self.system.wavelengths_m, self.system.observer
            )
            for laser, (_, λ) in enumerate(self.lasers):
                chromatic[λ] += float(weights[laser] * (colour[λ] @ pulls[:, laser]) / self.system.frames)
        return replace(
            found,
            path_gradient=gradient,
            amplitude_gradient=self._per_frame_table(np.einsum("lc,cl->l", self._laser_channels(), pulls))
            if wanted.amplitude_gradient
            else None,
            wavelength_gradient=None if chromatic is None else chromatic.numpy(),
        )

    def _solve_amplitudes(self, problem: AmplitudeLeastSquares) -> Floats:
        problem.all_reduce()
        if problem.is_dark:
            raise _no_light_error()
        found = problem.solve()
        if not np.any(found > 0):
            raise UserError(
                "target",
                "is shown best with every laser off",
                expected="light in the region that these lasers can show",
                remedy="change the target, the region or the lasers",
            )
        return self._per_frame_table(found)

    def _step_curvatures(self, weights: Floats) -> Tensor:
        """κ of each own laser at each modulator; light that stops absorb costs nothing, in its field and its own."""
        grid = self.model.plan.grid
        inside = self.objective.target[0, 0][self.objective.region_slices].numel()
        squares = np.mean((self._laser_channels() * weights[:, None])[self._own_lasers] ** 2, axis=1)
        rows = []
        for (_, λ), square in zip(self.model.lasers, squares, strict=True):
            first, last = self._transmittance(λ)
            cost = gauss_newton_diagonal(float(square), grid.upsample, inside, self.model.source_count)
            rows.append(
                [cost * first * last, cost * last * last] if self.model.has_second_modulator else [cost * last * last]
            )
        return torch.tensor(rows)

    def _transmittance(self, wavelength: int) -> tuple[float, float]:
        if wavelength not in self._transmittance_cache:
            self._transmittance_cache[wavelength] = self.model.transfer_functions.transmittances(wavelength)
        return self._transmittance_cache[wavelength]

    def _laser_channels(self) -> Floats:
        """Channels (laser, channel) that a laser adds at unit amplitude and intensity: frames are averaged."""
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

    @staticmethod
    def _plan_of(system: System, settings: Settings) -> Plan:
        """The plan; where wavelengths are free, on a grid that has room for the walk-off of the longest allowed."""
        plan = make_plan(system)
        if "wavelengths" not in settings.free:
            return plan
        longest = system.wavelengths_m.copy()
        longest[np.argmax(longest)] = max(settings.wavelength_range_m[1], float(longest.max()))
        return replace(plan, grid=make_plan(system.edit({"wavelengths": longest})).grid)


def _check_effects(plan: Plan, settings: Settings) -> None:
    """UserError for effects under which a laser isn't one wavelength, one frame and its own power any more."""
    if not plan.nominal.effects:
        return
    lasers = (len(plan.system.wavelengths_m), plan.system.frames)
    if lasers != (len(plan.nominal.wavelengths_m), plan.nominal.frames) or np.any(
        plan.system.amplitudes != plan.nominal.amplitudes
    ):
        hooks = ("bandwidth", "flicker", "laser_power")
        found = " and ".join(name for name in plan.nominal.effect_values if name in hooks) or "an effect"
        raise UserError(
            f"effects.{found}",
            "changes the lasers themselves, which patterns can't be optimised for",
            expected="effects that change the light of each laser",
            remedy="switch it off for the optimisation; rendering shows what it does",
        )
    if "wavelengths" in settings.free:
        raise UserError("free", "wavelengths on a bench with effects", remedy="free patterns and amplitudes only")


def _no_light_error() -> UserError:
    return UserError("relay2", "no light passes its stops", remedy="widen iris_na, or narrow dc_block_na")
