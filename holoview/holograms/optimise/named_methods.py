"""Two methods that papers compare with: double phase, a closed form, and Gerchberg–Saxton, alternating projections.

Both compute the pattern of the first modulator with the optimiser's own propagation and its adjoint, and a second
modulator stays flat. With p = exp(2πi·opd/λ) of the pixels, E_k = A_k p at plane k is linear, and |A_k|² ≤ u² for
u × u samples a pixel, since stops and transfer functions only absorb. Both get the laser amplitudes that the optimiser
would find in closed form.

Double phase   the target's amplitude T at the middle plane, with a flat phase, is carried back to the pixels. The field
               U = A⁺T there, with A⁺ the adjoint, is shown by two phases in turn, as a checkerboard:
               U/|U|max = (exp(iθ₊) + exp(iθ₋))/2,  θ± = arg U ± arccos(|U|/|U|max)
Gerchberg–     at each plane the field gets the target's amplitude, G = T·E/|E|; the pixels get the phase of the field
Saxton         that is carried back. A isn't unitary behind stops, hence u = p + Σ_k w_k·A_k⁺(G_k − A_k p)/(Σ_k w_k·u²),
               which is A⁺G where A is unitary. The squared amplitude error never rises, as in Fienup's error reduction,
               because |Ap − G|² ≤ u²·|p − u|² + a constant, with equality at the present p.

C. K. Hsueh & A. A. Sawchuk, Appl. Opt. 17, 3874 (1978); A. Maimone et al., ACM TOG 36, 85 (2017); R. W. Gerchberg & W.
O. Saxton, Optik 35, 237 (1972); J. R. Fienup, Appl. Opt. 21, 2758 (1982).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.beams import slices
from holoview.holograms.optimise.checkpoint import Checkpoint, IterationState
from holoview.holograms.optimise.forward_model import AutogradModel
from holoview.holograms.optimise.lasers import Laser
from holoview.holograms.optimise.problem import EvaluationRequest, LossEvaluation, Problem
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.variables import initial_drive
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import check_drive
from holoview.light.optics.slm import nearest_level, phasor
from holoview.util.errors import UserError

Tensor = torch.Tensor

METHODS = ("adam", "double-phase", "gerchberg-saxton")
_LEVELS = 256  # that Gerchberg–Saxton chooses from on a continuous modulator: an error of the field of 0.7 %
_SCORES_AT_ONCE = 1 << 20  # numbers of the table from which it chooses


def iterate_named(
    method: str,
    system: System,
    stack: NDArray[np.floating],
    settings: Settings,
    start: NDArray[np.float32] | None = None,
    *,
    device: str = "cpu",
) -> Iterator[IterationState]:
    """The states of a named method, as `iterate` yields them; arguments as there.

    method: "double-phase", which yields one state, or "gerchberg-saxton", which yields `settings.iterations` + 1
    states. Of these, every `settings.amplitudes_every`-th state and the last have amplitudes, loss and hologram of
    their own; the others repeat those before.

    Raises UserError as `iterate` does, and for effects that change the light of the modulators.
    """
    problem = Problem(system, stack, settings, device)
    if isinstance(problem.model, AutogradModel):
        raise UserError(
            f"--method {method}",
            "effects that change the modulators' light",
            expected="a bench without them",
            remedy="switch them off; rendering shows what they do",
        )
    drive = initial_drive(system, settings) if start is None else torch.tensor(start, dtype=torch.float32)
    check_drive(problem.model.plan, drive)
    drives = _double_phase_drives(problem) if method == "double-phase" else _gerchberg_saxton_drives(problem, drive)
    return _states(problem, drives, 0 if method == "double-phase" else settings.iterations)


def describe_method(method: str, system: System) -> str:
    """A sentence for the user on the pattern that a method finds on a system."""
    text = "Gerchberg–Saxton: targets of the lasers count alike"
    if method == "double-phase":
        wavelengths = dict.fromkeys(λ for _, λ in chosen_lasers(make_plan(system)))
        names = [f"{system.wavelengths_m[λ] * 1e9:.1f} nm" for λ in wavelengths]
        text = f"double phase, computed for the brightest wavelength of each frame: {', '.join(names)}"
    return text + ("; the second modulator stays flat" if len(system.modulators) > 1 else "")


def chosen_lasers(plan: Plan) -> list[Laser]:
    """The lasers for which double phase is computed: in each frame with light, the laser of greatest luminance."""
    luminance = np.where(plan.weights > 0, plan.system.amplitudes * plan.colour_weights[:, 1], -1.0)
    return [(frame, int(λ)) for frame, λ in enumerate(np.argmax(luminance, axis=1)) if luminance[frame, λ] >= 0]


def double_phase(field: Tensor) -> Tensor:
    """The phases (y, x) that show a complex field (y, x) as a checkerboard, rad; the field's greatest modulus is 1."""
    modulus = field.abs()
    spread = torch.acos((modulus / modulus.max().clamp_min(torch.finfo(modulus.dtype).tiny)).clamp(max=1))
    y, x = (torch.arange(n, device=field.device) for n in field.shape)
    return field.angle() + spread * (1 - 2 * ((y[:, None] + x) % 2))


def _states(problem: Problem, drives: Iterator[Tensor], last: int) -> Iterator[IterationState]:
    started, system, settings = time.perf_counter(), problem.system, problem.settings
    loss, best_db, evaluation = math.inf, -math.inf, None
    make_best: Callable[[], Hologram] | None = None
    for iteration, drive in enumerate(drives):
        if evaluation is None or iteration % settings.amplitudes_every == 0 or iteration == last:
            evaluation, amplitudes = _evaluate(problem, drive)
            if evaluation.loss < loss or make_best is None:
                loss, best_db = evaluation.loss, evaluation.psnr_db
                make_best = partial(Hologram, drive.cpu().numpy().copy(), system.edit({"amplitudes": amplitudes}))
        assert make_best is not None and evaluation.eyebox_variation is not None
        yield IterationState(
            iteration=iteration,
            iterations=last,
            loss=evaluation.loss,
            psnr_db=evaluation.psnr_db,
            best_psnr_db=best_db,
            eyebox=evaluation.eyebox_variation,
            seconds=time.perf_counter() - started,
            make_best=make_best,
            picture=evaluation.picture,
            checkpoint=_no_checkpoint,
        )


def _evaluate(problem: Problem, drive: Tensor) -> tuple[LossEvaluation, NDArray[np.float64]]:
    """The evaluation of a drive with the amplitudes that suit it best, and these amplitudes."""
    path_m = drive * _strokes_m(problem.system, drive)
    given = np.array(problem.system.amplitudes)
    solved = problem.evaluate(path_m, given, EvaluationRequest(optimal_amplitudes=True)).optimal_amplitudes
    assert solved is not None
    return problem.evaluate(path_m, solved, EvaluationRequest(eyebox_variation=True)), solved


def _no_checkpoint() -> Checkpoint:
    raise UserError("--checkpoint", "of a named method", expected="the optimiser's own method")


def _strokes_m(system: System, like: Tensor) -> Tensor:
    return torch.tensor([m.stroke_m for m in system.modulators], dtype=torch.float32).reshape(-1, 1, 1).to(like.device)


def _target_intensities(problem: Problem) -> Tensor:
    """The intensity (laser, plane, y, x) ≥ 0 that each laser should have at unit amplitude.

    Of all mixtures of the lit wavelengths that give the target's channels, the one of least squares; 0 where negative.
    """
    lit = sorted({λ for _, λ in problem.lasers})
    channels = problem.objective.wavelength_channels[lit].cpu().double()
    mixture = torch.linalg.pinv(channels.T).to(problem.objective.target)
    shares = torch.einsum("lc,kcyx->lkyx", mixture, problem.objective.target).clamp_(min=0)
    return shares[[lit.index(λ) for _, λ in problem.lasers]]


# --- double phase ----------------------------------------------------------------------------------------------------


def _double_phase_drives(problem: Problem) -> Iterator[Tensor]:
    """The one drive (frame, modulator, y, x) of the closed form."""
    model, system = problem.model, problem.system
    plan, device = model.plan, model.device
    middle, drive = len(plan.planes_m) // 2, torch.zeros(system.drive_shape, device=device)
    shares = _target_intensities(problem)[:, middle]
    amplitudes = torch.stack([shares[_lasers_of(problem, frame)].mean(dim=0).sqrt() for frame, _ in problem.lasers])
    most_upright = [int(np.argmin(np.hypot(*plan.slopes[:, λ].T))) for _, λ in problem.lasers]

    carrier = model.carrier().conj()

    def show_target(plane: int, rows: slice, fields: Tensor) -> None:
        fields.zero_()
        for laser, source in enumerate(most_upright):
            fields[laser, source] = amplitudes[laser, rows] * carrier[rows]

    model.forward(drive)
    model.process_planes([middle], show_target, carry_back=True)
    pixels = model.pixel_fields()
    for frame, λ in chosen_lasers(plan):
        phase = double_phase(pixels[problem.lasers.index((frame, λ))])
        drive[frame, 0] = _drive_of_phase(phase, float(system.wavelengths_m[λ]) / system.modulators[0].stroke_m)
    shown = [nearest_level(drive[:, m], modulator) for m, modulator in enumerate(system.modulators)]
    yield torch.stack(shown, dim=1)


def _lasers_of(problem: Problem, frame: int) -> list[int]:
    return [i for i, (own, _) in enumerate(problem.lasers) if own == frame]


def _drive_of_phase(phase: Tensor, wave: float) -> Tensor:
    """The drive in 0…1 whose phase is nearest. wave: the wavelength as a fraction of the stroke."""
    drive = torch.remainder(phase / (2 * math.pi), 1.0) * wave
    return torch.where(drive > (1 + wave) / 2, 0.0, drive.clamp(max=1))


# --- Gerchberg–Saxton ------------------------------------------------------------------------------------------------


def _gerchberg_saxton_drives(problem: Problem, drive: Tensor) -> Iterator[Tensor]:
    """The drives (frame, modulator, y, x), from the start, which gets the modulator's levels, to the last iteration."""
    projections = AlternatingProjections(problem)
    drive = projections.start(drive)
    for _ in range(problem.settings.iterations):
        yield drive
        drive = projections.step(drive)
    yield drive


class AlternatingProjections:
    """Gerchberg and Saxton's projections, for several planes and for wavelengths that share a pattern.

    error: Σ over planes w_k·Σ(|E| − T)², over lasers and samples that count, of the drive before the last step. The
    targets T are scaled once, for each laser, to the energy of the field that the start gives in all planes.
    """

    error: float

    def __init__(self, problem: Problem) -> None:
        self._problem, model = problem, problem.model
        self._targets = _target_intensities(problem).sqrt_()
        self._counts = torch.zeros(self._targets.shape[-2:], device=model.device)
        self._counts[problem.objective.region_slices] = 1
        self._weights = problem.objective.plane_weights
        self._bound = float(self._weights.sum()) * model.plan.grid.upsample**2
        modulator = problem.system.modulators[0]
        levels = np.linspace(0, 1, _LEVELS) if modulator.levels is None else np.array(modulator.levels)
        self._levels = torch.as_tensor(levels, dtype=torch.float32, device=model.device)

    def start(self, drive: Tensor) -> Tensor:
        """The first drive: at the nearest levels, with a flat second modulator. Scales the targets."""
        drive = drive.to(self._levels.device).clone()
        drive[:, 1:] = 0
        middles = (self._levels[1:] + self._levels[:-1]) / 2
        drive[:, 0] = self._levels[torch.bucketize(drive[:, 0].contiguous(), middles)]
        self._problem.model.forward(drive * _strokes_m(self._problem.system, drive))
        planes = range(self._targets.shape[1])
        parts = self._problem.model.process_planes(planes, self._energy_of_rows, carry_back=False)
        energy = torch.stack([part for plane in parts for part in plane]).sum(dim=0)
        wanted = (self._targets.square() * self._counts).sum(dim=(1, 2, 3)).cpu().double()
        scale = torch.where(wanted > 0, (energy / wanted.clamp_min(1e-300)).sqrt(), 0.0)
        self._targets *= scale.to(self._targets)[:, None, None, None]
        self._shown = (scale > 0).to(self._targets)[:, None, None, None]
        return drive

    def step(self, drive: Tensor) -> Tensor:
        """The drive (frame, modulator, y, x) after one iteration."""
        model, path_m = self._problem.model, drive * _strokes_m(self._problem.system, drive)
        model.forward(path_m)
        parts = model.process_planes(range(self._targets.shape[1]), self._replace_by_corrections, carry_back=True)
        self.error = float(sum(part for plane in parts for part in plane))
        corrections = model.pixel_fields()
        after = drive.clone()
        for frame in sorted({frame for frame, _ in self._problem.lasers}):
            own = _lasers_of(self._problem, frame)
            λ = torch.from_numpy(model.plan.system.wavelengths_m[[self._problem.lasers[i][1] for i in own]]).to(drive)
            present = phasor(path_m[frame, 0], λ[:, None, None], corrections.dtype)
            after[frame, 0] = self._nearest_drive(present + corrections[own] / self._bound, λ)
        return after

    def _energy_of_rows(self, plane: int, rows: slice, fields: Tensor) -> Tensor:
        """Σ|E|² of samples that count, mean over sources, (laser,)."""
        energy = fields.abs().square().mean(dim=1) * self._counts[rows]
        return energy.sum(dim=(1, 2)).cpu().double()

    def _replace_by_corrections(self, plane: int, rows: slice, fields: Tensor) -> float:
        """Replaces E (laser, source, row, x) by conj(G − E)·w_k/sources; returns the rows' part of the error."""
        target, counts = self._targets[:, plane, rows][:, None], self._counts[rows] * self._shown
        weight = float(self._weights[plane]) / fields.shape[1]
        modulus = fields.abs()
        error = (modulus - target).square().mul_(counts).sum()
        unit = torch.where(modulus > 0, fields / modulus.clamp_min(1e-30), 1.0)
        fields.copy_((unit * target - fields).conj() * (counts * weight))
        return weight * float(error)

    def _nearest_drive(self, wanted: Tensor, wavelengths_m: Tensor) -> Tensor:
        """The levels (y, x) whose fields are nearest to the wanted ones, (laser, y, x): of greatest Σ Re(conj(u)·p)."""
        path_m = self._levels * self._problem.system.modulators[0].stroke_m
        fields = torch.view_as_real(phasor(path_m, wavelengths_m[:, None], wanted.dtype))  # (laser, level, 2)
        table = fields.movedim(1, 0).flatten(1)
        numbers = torch.view_as_real(wanted).movedim(0, 2).flatten(0, 1).flatten(1)  # (sample, 2·laser)
        blocks = slices(len(numbers), _SCORES_AT_ONCE // len(table))
        chosen = torch.cat([(numbers[block] @ table.T).argmax(dim=1) for block in blocks])
        return self._levels[chosen].reshape(wanted.shape[1:])
