"""The optimisation loop of a chain of elements: every pattern that an element shows, by derivatives of the stages.

Adam moves the patterns: phases as those of the short form, amplitudes and complex numbers by their own step, each kept
in its range; levels by the straight-through estimator (`optics.slm.nearest_level`). A shared pattern sums the gradients
of all frames. Amplitudes of the lasers are solved by least squares, so that absorption costs nothing in PSNR: `light`,
the share of the lasers' light in the picture, is told beside it, and so is the eyebox.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage

from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.adam import Adam
from holoview.holograms.optimise.agreement import AgreementPenalty
from holoview.holograms.optimise.chain_executor import ChainExecutor, power, summed_sources
from holoview.holograms.optimise.checkpoint import (
    CHAIN_TENSORS,
    Checkpoint,
    CheckpointProgress,
    IterationState,
    target_digest,
)
from holoview.holograms.optimise.eyes import Places, drawn_pupils
from holoview.holograms.optimise.field_loss import ComplexTarget, check_suits, infidelity, split_target
from holoview.holograms.optimise.kernel_choice import (
    KernelTurn,
    choose_kernels,
    compile_all,
    iterations_beside,
    tell_of_turn,
    will_compile,
)
from holoview.holograms.optimise.lasers import check_effects, next_amplitudes
from holoview.holograms.optimise.objective import (
    AmplitudeLeastSquares,
    Objective,
    channels_of_wavelengths,
    make_objective,
)
from holoview.holograms.optimise.plane_turns import planes_in_turn
from holoview.holograms.optimise.problem import plan_for
from holoview.holograms.optimise.propagation import TORCH_KERNELS, Kernels
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.wavelengths import (
    FreeWavelengths,
    channel_wavelength_derivatives,
    check_wavelength_search,
)
from holoview.light.engine.frame import spectrum_behind_modulators
from holoview.light.engine.torch_executor import TorchField
from holoview.light.model.drives import chain_drives
from holoview.light.model.elements import AmplitudeModulator, ComplexModulator, Element, PhaseModulator
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.observers import drawn_people
from holoview.light.optics.chain import ChainTransmissions
from holoview.light.optics.slm import eyebox_order, nearest_level
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.util.progress import TextCallback, no_text

Tensor = torch.Tensor
Floats = NDArray[np.float64]

_AMPLITUDE_STEP = 0.1
_SMOOTH_SHARE, _SMOOTH_PX = 0.02, 2.0  # of the range, r.m.s., and the width of the noise of a smooth start
_RELATIVE_STEP = {
    False: 1e-5,
    True: 1e-6,
}  # of the wavelength, in float32 and float64: phases of 10³ rad change by 1e-2
_TORCH_WORK = 4  # times as long as the short form's an iteration takes by torch
_BYTES = 48  # a sample of a field in torch's graph: field, spectrum, their products and gradients


def iterate_chain(
    system: System,
    stack: Any,
    settings: Settings,
    start: Any = None,
    resume: Checkpoint | None = None,
    *,
    device: str = "cpu",
    done: int = 0,
    beside: TextCallback | None = None,
) -> Iterator[IterationState]:
    """The states of `solve.iterate` for a chain. start: patterns by the names of elements, or as a list.

    Raises UserError as `iterate` does.
    """
    drawn = drawn_pupils(system, settings, stack)
    places_m, target = (None, stack) if drawn is None else drawn(0)
    patterns, lasers = ChainPatterns(system, settings, start), FreeWavelengths(system.wavelengths_m, settings)
    problem, turn = _begin(system, target, settings, device, places_m, resume, done, beside)
    amplitudes, best, started = np.array(system.amplitudes), (math.inf, -math.inf), time.perf_counter()
    pictured, make_best, begun = None, None, (system, settings, target_digest(*split_target(target)))
    if resume is not None:
        resume.check_matches(*begun, "checkpoint")
        amplitudes, done = resume.tensors["amplitudes"].astype(np.float64), resume.progress.iteration
        best, started = (resume.progress.best_loss, resume.progress.best_psnr_db), started - resume.progress.seconds
        make_best = _load(resume, patterns, lasers)
    if "wavelengths" in settings.free:
        problem.set_wavelengths(lasers.values_m)
    for iteration in range(done, settings.iterations + 1):
        is_last = iteration == settings.iterations
        _change(problem, turn, drawn, iteration)
        shown = patterns.shown()
        solves = "amplitudes" in settings.free and (iteration % settings.amplitudes_every == 0 or is_last)
        planes = problem.planes_of(iteration, is_whole=make_best is None or solves or lasers.are_due(iteration))
        found = problem.evaluate(shown, amplitudes, planes)
        if solves:
            amplitudes = problem.solved_amplitudes(found.intensity)
        loss, image = problem.loss(found, amplitudes)
        value, psnr_db = _finite(loss), problem.objective.psnr_db(image, planes)
        pictured = image[len(image) // 2] if planes is None or pictured is None else pictured
        if planes is None and (value < best[0] or drawn is not None):
            best, make_best = (value, psnr_db), _maker(problem.plan.nominal, shown, amplitudes)
        if not is_last:
            _take_steps(problem, patterns, lasers, iteration, loss, found, amplitudes)
        assert make_best is not None
        eyebox, seconds = problem.eyebox_variation(found, amplitudes), time.perf_counter() - started
        progress = CheckpointProgress(iteration + 1, seconds, *best, eyebox, turn.at)
        yield IterationState(
            iteration=iteration,
            iterations=settings.iterations,
            loss=value,
            psnr_db=psnr_db,
            best_psnr_db=best[1],
            eyebox=eyebox,
            light=problem.light(found.intensity, amplitudes),
            seconds=seconds,
            make_best=make_best,
            picture=partial(problem.objective.picture, pictured),
            checkpoint=partial(_checkpoint, *begun, progress, patterns, lasers, amplitudes, make_best),
        )


def _begin(
    system: System,
    target: Any,
    settings: Settings,
    device: str,
    places_m: Places | None,
    resume: Checkpoint | None,
    done: int,
    beside: TextCallback | None,
) -> tuple[ChainProblem, KernelTurn]:
    """The problem of an optimisation, and when it changes its kernels. Arguments of `iterate_chain`."""
    tell, compiles = beside or no_text, beside is not None and resume is None and will_compile(device, chains=True)
    by_torch = compiles or (resume is not None and resume.progress.by_torch > resume.progress.iteration)
    kernels = TORCH_KERNELS if by_torch else None
    if not by_torch:
        compile_all(device)
    problem = ChainProblem(system, target, settings, device, places_m=places_m, kernels=kernels)
    if compiles:
        tell_of_turn(tell, problem.iterations_beside, settings.iterations - done)
        return problem, KernelTurn(device, tell, done + problem.iterations_beside, chains=True)
    return problem, KernelTurn(device, tell, 0 if resume is None else resume.progress.by_torch, chains=True)


def _change(problem: ChainProblem, turn: KernelTurn, drawn: Any, iteration: int) -> None:
    """Changes to other kernels where they are due, and to the drawn places of an iteration."""
    if turn.is_due(iteration):
        problem.change_kernels()
    if drawn is not None and iteration > 0:
        problem.see_from(*drawn(iteration))


class ChainOptimiser:
    """Runs the optimisation of a chain, and then those for other stacks, as `solve.Optimiser` does.

    Arguments of `iterate_chain`, whose errors are raised by `states`.
    """

    def __init__(
        self, system: System, stack: Any, settings: Settings, start: Any = None, *, device: str = "cpu"
    ) -> None:
        self._system, self._device = system, device
        self._next = (system, stack, settings, start)
        self._make_best: Callable[[], Hologram] | None = None

    def best(self) -> Hologram:
        """The hologram of the smallest loss of the latest stack."""
        assert self._make_best is not None
        return self._make_best()

    def go_on(self, stack: NDArray[np.floating], settings: Settings, start: Hologram) -> None:
        """Begins again for another focal stack from a hologram of the same bench; only its amplitudes may differ."""
        amplitudes = next_amplitudes(start.system.amplitudes, self._system.amplitudes > 0)
        self._next = (self._system.edit({"amplitudes": amplitudes}), stack, settings, start.drive)

    def states(self) -> Iterator[IterationState]:
        """The states for the present stack."""
        for state in iterate_chain(*self._next, device=self._device):
            self._make_best = state.make_best
            yield state


def _take_steps(
    problem: ChainProblem,
    patterns: ChainPatterns,
    lasers: FreeWavelengths,
    iteration: int,
    loss: Tensor,
    found: ChainLight,
    amplitudes: Floats,
) -> None:
    """Moves the patterns against the gradient of the loss, and the wavelengths when they are due."""
    if lasers.are_due(iteration):
        lasers.step(problem.wavelength_gradient(patterns.shown(), found, amplitudes), iteration)
        problem.set_wavelengths(lasers.values_m)
    if iteration == lasers.iterations > 0:
        patterns.forget()
    if "patterns" in problem.settings.free:
        gradients = torch.autograd.grad(loss, patterns.variables)
        patterns.step(gradients, lasers.pattern_step_scale(iteration))


def _load(resume: Checkpoint, patterns: ChainPatterns, lasers: FreeWavelengths) -> Callable[[], Hologram]:
    """Takes the unknowns of a checkpoint. Returns what makes its best hologram."""
    patterns.load(resume.tensors)
    if "wavelengths" in resume.settings.free:
        lasers.load(resume.tensors, "wavelength_steps", 0)
    return resume.best


def _checkpoint(
    system: System,
    settings: Settings,
    digest: str,
    progress: CheckpointProgress,
    patterns: ChainPatterns,
    lasers: FreeWavelengths,
    amplitudes: Floats,
    make_best: Callable[[], Hologram],
) -> Checkpoint:
    """Everything that is needed to go on, before the next state is asked for."""
    best = make_best()
    shown = {f"best_drive/{name}": _parts(drive) for name, drive in best.drive.items()}
    light = {
        "amplitudes": amplitudes.copy(),
        "best_amplitudes": np.array(best.system.amplitudes),
        "wavelengths": lasers.values_m.copy(),
        "best_wavelengths": np.array(best.system.wavelengths_m),
        "wavelength_moments": lasers.moments(),
        "wavelength_steps": np.array([float(lasers.adam.step_count)]),
    }
    return Checkpoint(system, settings, digest, progress, {**patterns.tensors(), **shown, **light})


def _parts(drive: NDArray[Any]) -> NDArray[np.float32]:
    """Patterns as in a file: complex ones (frame, y, x, part)."""
    both = np.stack([drive.real, drive.imag], axis=-1) if np.iscomplexobj(drive) else drive
    return np.asarray(both, np.float32)


def _maker(system: System, drives: dict[str, Tensor], amplitudes: Floats) -> Any:
    """Makes the hologram of patterns and amplitudes as they are now, when it is asked for."""
    arrays = {name: drive.detach().clone().cpu().numpy() for name, drive in drives.items()}
    lit = {"amplitudes": amplitudes.copy()}
    return cache(lambda: Hologram(arrays, system.edit(lit)))


def _finite(loss: Tensor) -> float:
    """The value of a loss. Raises UserError unless it is finite."""
    value = float(loss.detach())
    if not math.isfinite(value):
        raise UserError("optimisation", f"the loss became {value}", remedy="lower the step or check the target")
    return value


def check_whole_picture(settings: Settings, stack: Any) -> None:
    """Raises UserError for settings and targets of `iterate` that a mask to learn and a driven element don't have."""
    unknown = {
        "some planes at a time": bool(settings.drawn_planes),
        "a complex target": not isinstance(stack, np.ndarray),
    }
    for what, is_wanted in unknown.items():
        if is_wanted:
            raise UserError("optimisation", what, expected="all planes, and a picture")


class ChainProblem:
    """A chain, a target and a loss. Raises UserError as `make_objective`, `check_plan` and `check_suits` do.

    stack: a focal stack, or a complex target, whose fields are compared. places_m: places (y, x) of the eye's pupil,
    those of the settings when None.
    """

    def __init__(
        self,
        system: System,
        stack: NDArray[np.floating] | ComplexTarget,
        settings: Settings,
        device: str = "cpu",
        *,
        double: bool = False,
        places_m: Places | None = None,
        kernels: Kernels | None = None,
    ) -> None:
        stack, complex_target = split_target(stack)
        if complex_target is not None:
            check_suits(system, settings, 1)
        if "wavelengths" in settings.free:
            _check_wavelength_range(system, settings)
        self.plan = plan_for(system, settings, settings.pupil_places_m if places_m is None else places_m)
        self.settings = settings
        check_effects(self.plan, settings)
        samples = math.prod(self.plan.grid.padded) * len(self.plan.beams(range(len(system.wavelengths_m))))
        steps = len(self.plan.planes) + 2 * len(self.plan.way.steps)
        require_memory("optimisation", samples * steps * _BYTES, remedy="lower shape, upsample, frames or wavelengths")
        self.objective: Objective = make_objective(self.plan, stack, settings, device=device, double=double)
        self.kernels, self._double, self._device = kernels or choose_kernels(device), double, device
        self._executor = self._make_executor()
        self._relative_step = _RELATIVE_STEP[double]
        people = drawn_people(settings.observers) if settings.observers else []
        self._agreement = AgreementPenalty(people, self.objective.loss) if people else None
        self.lasers = [(f, λ) for λ in range(len(system.wavelengths_m)) for f in self.plan.lit(λ)]
        self._share = 1.0 / (system.frames * len(self.plan.slopes))
        self._fields = None if complex_target is None else complex_target.of_lasers(self.lasers).to(device)
        self._has_levels = any(getattr(element, "levels", None) is not None for element in system.elements)

    @property
    def iterations_beside(self) -> int:
        """How many iterations torch computes while another process compiles, as `iterations_beside` says."""
        samples = math.prod(self.plan.grid.padded) * len(self.lasers) * len(self.plan.slopes)
        return iterations_beside(_TORCH_WORK * samples * len(self.objective.target))

    def change_kernels(self) -> None:
        """Goes on with the fastest kernels on this machine: the same numbers up to rounding."""
        self.kernels = choose_kernels(self._device)
        self._executor = self._make_executor()

    def _make_executor(self) -> ChainExecutor:
        return self.kernels.chain_executor(self.plan, double=self._double, device=self._device)

    def planes_of(self, iteration: int, *, is_whole: bool) -> tuple[int, ...] | None:
        """The planes that count in an iteration; None: all. is_whole: whether it needs all of them."""
        settings, count = self.settings, len(self.objective.target)
        if is_whole or self._has_levels or not settings.drawn_planes:
            return None
        return planes_in_turn(iteration, settings.iterations, count, settings.drawn_planes, settings.seed)

    def set_wavelengths(self, wavelengths_m: Floats) -> None:
        """Changes to other wavelengths (wavelength,) on the same grid."""
        self.plan = self._plan_at(wavelengths_m)
        self._executor = self._make_executor()
        self.objective.wavelength_channels = channels_of_wavelengths(
            self.objective.loss, self.plan, self.objective.target
        )

    def see_from(self, places_m: Places, stack: NDArray[np.floating]) -> None:
        """Changes to other places (y, x) of the eye's pupil, as many as before, m, and to the stack to be seen from
        them, (place · plane, y, x, 3). Raises UserError for a stack of another shape."""
        self.objective.set_stack(stack)
        self.plan = self.plan.seen_from(places_m)
        self._executor = self._executor.seen_from(self.plan)

    def _plan_at(self, wavelengths_m: Floats) -> Plan:
        moved = self.plan.nominal.edit({"wavelengths": wavelengths_m})
        return replace(make_plan(moved), grid=self.plan.grid)

    def wavelength_gradient(self, drives: Mapping[str, Tensor], found: ChainLight, amplitudes: Floats) -> Floats:
        """∂L/∂λ (wavelength,), 1/m, at fixed patterns and stops. found: the light at the present wavelengths.

        Each laser's light depends on its own wavelength alone, so that one difference of the light at wavelengths a
        little longer and a little shorter, all at once, gives the derivative of each, of whatever elements:

            ∂L/∂λ_l = Σ ∂L/∂I_l·(I_l(λ + δ) − I_l(λ − δ))/2δ + ∂L/∂(colour of l)·∂(colour of l)/∂λ
        """
        λ = np.array(self.plan.system.wavelengths_m)
        intensity, spectra = found.intensity.detach().requires_grad_(), found.spectra.detach().requires_grad_()
        channels = self.laser_channels().detach().requires_grad_()
        loss, _ = self.loss(ChainLight(intensity, spectra), amplitudes, channels)
        slopes = torch.autograd.grad(loss, (intensity, spectra, channels), allow_unused=True)
        with torch.no_grad():
            shown = {name: drive.detach() for name, drive in drives.items()}
            longer, shorter = (
                self._light_of(self._executor.held_at(self._plan_at(λ * (1 + sign * self._relative_step))), shown)
                for sign in (1, -1)
            )
        colours = channel_wavelength_derivatives(self.objective.loss, λ, self.plan.system.observer)
        out = np.zeros(len(λ))
        for laser, (_, number) in enumerate(self.lasers):
            step_m = 2 * self._relative_step * λ[number]
            for slope, above, below in (
                (slopes[0], longer.intensity, shorter.intensity),
                (slopes[1], longer.spectra, shorter.spectra),
            ):
                if slope is not None:
                    out[number] += float((slope[laser] * (above[laser] - below[laser])).double().sum()) / step_m
            out[number] += float(slopes[2][laser].cpu().double().numpy() @ colours[number])
        if self._agreement is not None:
            out += self.settings.agreement * self._agreement.value_and_gradient(λ, amplitudes.mean(axis=0))[1]
        return out

    def evaluate(
        self, drives: Mapping[str, Tensor], amplitudes: Floats, planes: Sequence[int] | None = None
    ) -> ChainLight:
        """The light of all lasers at unit amplitude in some planes, all when None, with torch's graph.

        drives: patterns by name.
        """
        return self._light_of(self._executor, drives, planes)

    def _light_of(
        self, executor: ChainExecutor, drives: Mapping[str, Tensor], planes: Sequence[int] | None = None
    ) -> ChainLight:
        transmissions = executor.inputs.sampled_transmissions
        assert isinstance(transmissions, ChainTransmissions)
        transmissions.show(dict(drives))
        chosen, powers = range(len(self.plan.planes)) if planes is None else planes, list[Tensor]()
        behind = self._spectra(executor, powers)
        if self._fields is None:
            intensity, missed = executor.intensities(behind, chosen), None
        else:
            intensity, missed = self._compared(executor, behind, chosen)
        if self._share != 1:
            intensity = self._share * intensity
        return ChainLight(intensity, torch.stack(powers), planes, missed)

    def _spectra(self, executor: ChainExecutor, powers: list[Tensor]) -> Iterator[tuple[list[TorchField], int]]:
        """The spectra behind the last element of each laser, from each source, and its wavelength.

        powers: where to add the mean power of each laser behind the last stops.
        """
        sources = range(len(self.plan.slopes))
        for frame, λ in self.lasers:
            spectra = [spectrum_behind_modulators(executor, λ, frame, source) for source in sources]
            with torch.set_grad_enabled(torch.is_grad_enabled() and self.settings.eyebox > 0):
                passed = [executor.passed_power(spectrum, λ) for spectrum in spectra]
                powers.append(self._share * summed_sources(passed))
            yield spectra, λ

    def _compared(
        self, executor: ChainExecutor, behind: Iterable[tuple[list[TorchField], int]], planes: Sequence[int]
    ) -> tuple[Tensor, Tensor]:
        """As `ChainExecutor.intensities`, and the mean `infidelity` (plane,) to the fields of a complex target."""
        intensity, missed, inside = [], [], (..., *self.objective.region_slices)
        assert self._fields is not None
        for (spectra, λ), targets in zip(behind, self._fields.unbind(dim=1), strict=True):
            fields = [executor.fields(spectrum, λ, planes) for spectrum in spectra]
            intensity.append(summed_sources([power(field) for field in fields]))
            wanted = targets[list(planes)].to(fields[0])
            missed += [infidelity(field[inside], wanted[inside]) for field in fields]
        return torch.stack(intensity), torch.stack(missed).mean(dim=0)

    def loss(self, found: ChainLight, amplitudes: Floats, channels: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """The loss, and the image (plane, channel, y, x). channels (laser, channel): of the lasers."""
        weights = torch.as_tensor(self._weights(amplitudes)).to(found.intensity)
        colours = weights[:, None] * (self.laser_channels() if channels is None else channels)
        lasers, planes, *shape = found.intensity.shape
        image = (colours.T @ found.intensity.reshape(lasers, -1)).reshape(-1, planes, *shape).movedim(0, 1)
        if found.missed is None:
            loss = self.objective.loss_of(image, found.planes)
        else:
            of_planes = self.objective.plane_weights[slice(None) if found.planes is None else list(found.planes)]
            loss = (torch.as_tensor(of_planes).to(found.missed) * found.missed).mean()
        return loss + self.eyebox_penalty(found, amplitudes), image.detach()

    def eyebox_penalty(self, found: ChainLight, amplitudes: Floats) -> Tensor:
        """The part of the loss that an uneven eyebox adds, as the settings weigh it."""
        if not self.settings.eyebox:
            return found.spectra.new_zeros(())
        return self.settings.eyebox * self._variations(found.spectra, amplitudes).square().mean()

    def solved_amplitudes(self, intensity: Tensor) -> Floats:
        """Amplitudes (frame, wavelength) that are best for the present patterns."""
        squares = AmplitudeLeastSquares(self.laser_channels().cpu().double().numpy())
        cut = self.objective.region_slices
        for plane, weight in enumerate(self.objective.plane_weights):
            own, target = intensity[:, plane].detach(), self.objective.target[plane]
            squares.add(squares.normal_equations(own[:, *cut], target[:, *cut]), float(weight))
        if squares.is_dark:
            raise UserError("optimisation", "no light reaches the picture", remedy="widen the stops or start anew")
        return self.as_table(squares.solve())

    def as_table(self, amplitudes: Floats) -> Floats:
        """Amplitudes (laser,) as a table (frame, wavelength); 0 of lasers that are off."""
        out = np.zeros(self.plan.system.amplitudes.shape)
        for laser, amplitude in zip(self.lasers, amplitudes, strict=True):
            out[laser] = amplitude
        return out

    def light(self, intensity: Tensor, amplitudes: Floats) -> float:
        """The share of the lasers' light on the first element's field that is in the picture, mean over planes."""
        weights = self._weights(amplitudes)
        share = intensity.detach().mean(dim=(1, 2, 3)).cpu().double().numpy() / (self._share * len(self.plan.slopes))
        return float(weights @ share / max(weights.sum(), 1e-300))

    def eyebox_variation(self, found: ChainLight, amplitudes: Floats) -> float:
        """Coefficient of variation of the light over 8 × 8 blocks of the finest pixels' first order, by luminance."""
        luminance = torch.as_tensor(self.plan.colour_weights[:, 1].copy()).to(found.spectra)
        weights = torch.as_tensor(self._weights(amplitudes)).to(found.spectra)
        weights = weights * torch.stack([luminance[λ] for _, λ in self.lasers])
        return float(_variation(self._blocks(torch.tensordot(weights, found.spectra.detach(), dims=1))))

    def laser_channels(self) -> Tensor:
        """Channels (laser, channel) of unit intensity of each laser that shines in a frame."""
        return torch.stack([self.objective.wavelength_channels[λ] for _, λ in self.lasers])

    def _weights(self, amplitudes: Floats) -> Floats:
        return np.array([amplitudes[frame, λ] for frame, λ in self.lasers])

    def _variations(self, spectra: Tensor, amplitudes: Floats) -> Tensor:
        """Coefficient of variation (wavelength,) of the eyebox's light, of those that shine."""
        by_wavelength: dict[int, Tensor] = {}
        for (_, λ), weight, own in zip(self.lasers, self._weights(amplitudes), spectra, strict=True):
            if weight:
                by_wavelength[λ] = by_wavelength.get(λ, torch.zeros_like(own)) + weight * own
        return torch.stack([_variation(self._blocks(power)) for power in by_wavelength.values()])

    def _blocks(self, power: Tensor) -> Tensor:
        """Means (block, block) over the eyebox of powers in the band of the last relay."""
        order = eyebox_order(self.plan)
        matrices = []
        for axis, frequencies in enumerate(self._executor.frequencies(self.plan.way.last)):
            padded = self.plan.grid.padded[axis]
            entries = np.full(padded, -1)
            entries[frequencies % padded] = np.arange(len(frequencies))
            chosen = entries[order.bins[axis]]
            matrix = torch.zeros(order.block_matrix(axis).shape[0], len(frequencies), dtype=power.dtype)
            lit = chosen >= 0
            matrix[:, chosen[lit]] = torch.from_numpy(order.block_matrix(axis)[:, lit]).to(power.dtype)
            matrices.append(matrix.to(power.device))
        return matrices[0] @ power @ matrices[1].T


class ChainLight:
    """The light of lasers at unit amplitude: intensity (laser, plane, y, x), and spectra (laser, rows, columns), powers
    behind the last stops.

    planes: which; all when None. missed (plane,): of a complex target, the mean of `infidelity` over all beams.
    """

    def __init__(
        self,
        intensity: Tensor,
        spectra: Tensor,
        planes: Sequence[int] | None = None,
        missed: Tensor | None = None,
    ) -> None:
        self.intensity, self.spectra, self.planes, self.missed = intensity, spectra, planes, missed


def _check_wavelength_range(system: System, settings: Settings) -> None:
    """Raises UserError for a range of wavelengths where the observer has no data, or that lenses can't take."""
    check_wavelength_search(system.observer, settings)
    for index, end_m in zip((np.argmin, np.argmax), settings.wavelength_range_m, strict=True):
        moved = np.array(system.wavelengths_m)
        moved[index(moved)] = end_m
        try:
            make_plan(system.edit({"wavelengths": moved}))
        except UserError as error:
            raise error.inside("wavelength range: ") from error


def _variation(blocks: Tensor) -> Tensor:
    return blocks.std(correction=0) / blocks.mean().clamp_min(torch.finfo(blocks.dtype).tiny)


class ChainPatterns:
    """The variables of a chain's patterns: real ones, or real and imaginary part (…, 2) of complex ones.

    start: patterns by the names of all elements, or as a list; None: as `Settings.begin` and `Settings.seed` say, and
    of an element that is held one that lets the light through. names: of the elements whose patterns these are; all
    when None. Raises UserError where patterns are to be found and every element is held.
    """

    def __init__(self, system: System, settings: Settings, start: Any, names: Sequence[str] | None = None) -> None:
        named = dict(zip(system.element_names, system.elements, strict=True))
        self._elements = {name: named[name] for name in (system.drive_shapes if names is None else names)}
        given = None if start is None else chain_drives(system, start)
        random = np.random.default_rng(settings.seed)
        middle_m = float(np.median(system.wavelengths_m))
        self._variables, self._steps = dict[str, Tensor](), dict[str, float]()
        for name, element in self._elements.items():
            shape = system.drive_shapes[name]
            drive = _first_pattern(element, shape, settings, random) if given is None else np.asarray(given[name])
            tensor = torch.from_numpy(np.array(drive, np.complex64 if np.iscomplexobj(drive) else np.float32))
            self._variables[name] = torch.view_as_real(tensor).clone() if tensor.is_complex() else tensor
            self._steps[name] = getattr(element, "step", None) or _AMPLITUDE_STEP
            if isinstance(element, PhaseModulator) and element.step is None:
                self._steps[name] = settings.step_rad * middle_m / (2 * math.pi * element.stroke_m)
        self._moved = [name for name, element in self._elements.items() if not getattr(element, "held", False)]
        if "patterns" in settings.free and not self._moved:
            expected = "an element with held = false, or amplitudes alone"
            raise UserError("free", "patterns, and every element is held", expected=expected)
        self._adams = {name: Adam(v, settings.betas) for name, v in self._variables.items()}
        self.step_factor = 1.0

    def shown(self) -> dict[str, Tensor]:
        """The patterns, which require gradients."""
        drives = {}
        for name, variable in self._variables.items():
            variable.requires_grad_(name in self._moved)
            is_complex = isinstance(self._elements[name], ComplexModulator)
            drives[name] = torch.view_as_complex(variable) if is_complex else variable
        return drives

    def displayed_drive(self) -> dict[str, Tensor]:
        """The patterns at the levels that the elements show; those that move require gradients."""
        drives = {name: drive.detach() for name, drive in self.shown().items()}
        shown = dict[str, Tensor]()
        for (name, drive), element in zip(drives.items(), self._elements.values(), strict=True):
            if isinstance(element, PhaseModulator | AmplitudeModulator):
                drive = nearest_level(drive, element)
            shown[name] = drive.clone()
        return {name: drive.requires_grad_(name in self._moved) for name, drive in shown.items()}

    def go_back(self, drives: Mapping[str, Tensor], factor: float) -> None:
        """Begins again from other patterns, with steps that are `factor` times those before."""
        for name, drive in drives.items():
            self._variables[name] = (torch.view_as_real(drive) if drive.is_complex() else drive).detach().clone()
        self.step_factor *= factor
        self.forget()

    @property
    def variables(self) -> list[Tensor]:
        """The variables of the elements that aren't held, in the order of the elements."""
        return [self._variables[name] for name in self._moved]

    def tensors(self) -> dict[str, NDArray[np.floating]]:
        """The variables, Adam's moments and its number of steps, as of `Checkpoint`."""
        out = dict[str, NDArray[np.floating]]()
        for name, variable in self._variables.items():
            adam = self._adams[name]
            own = (variable.detach(), adam.first_moment, adam.second_moment)
            for what, tensor in zip(CHAIN_TENSORS, own, strict=False):
                out[f"{what}/{name}"] = tensor.numpy().copy()
        return out | {"steps": np.array([float(max(adam.step_count for adam in self._adams.values()))])}

    def forget(self) -> None:
        """Begins Adam's moments anew."""
        for adam in self._adams.values():
            adam.reset()

    def load(self, tensors: Mapping[str, NDArray[np.floating]]) -> None:
        """Takes what `tensors` gave."""
        for name, adam in self._adams.items():
            drive, adam.first_moment, adam.second_moment = (
                torch.from_numpy(np.array(tensors[f"{what}/{name}"], np.float32)) for what in CHAIN_TENSORS[:3]
            )
            self._variables[name], adam.step_count = drive, int(tensors["steps"][0])

    def step(self, gradients: Sequence[Tensor], decay: float) -> None:
        """Moves all patterns against the gradients of the `variables`, inside their ranges."""
        for name, gradient in zip(self._moved, gradients, strict=True):
            step = self.step_factor * decay * self._steps[name]
            moved = self._variables[name].detach() - step * self._adams[name].unit_step(gradient)
            if isinstance(self._elements[name], ComplexModulator):
                size = torch.linalg.vector_norm(moved, dim=-1, keepdim=True)
                self._variables[name] = moved / size.clamp_min(1.0)
            else:
                self._variables[name] = moved.clamp(0.0, 1.0)


def _type_of(element: Element) -> type:
    """The type of an element's patterns."""
    return np.complex64 if isinstance(element, ComplexModulator) else np.float32


def _first_pattern(
    element: Element, shape: tuple[int, int, int], settings: Settings, random: np.random.Generator
) -> NDArray[Any]:
    """Patterns to begin with: phases as `Settings.begin` says; amplitudes near 1, or random where there are levels."""
    noise = random.random(shape)
    if getattr(element, "held", False):
        return np.zeros(shape) if isinstance(element, PhaseModulator) else np.ones(shape, _type_of(element))
    if isinstance(element, AmplitudeModulator):
        return noise if element.levels is not None else 0.9 + 0.1 * noise
    if settings.begin == "smooth":
        smooth = ndimage.gaussian_filter(noise - 0.5, (0, _SMOOTH_PX, _SMOOTH_PX), mode="wrap")
        noise = np.clip(0.5 + smooth * (_SMOOTH_SHARE / smooth.std()), 0, 1)
    return np.exp(2j * np.pi * noise) * 0.9 if isinstance(element, ComplexModulator) else noise
