"""Two methods that papers compare with: double phase, a closed form, and Gerchberg–Saxton, alternating projections.

Both compute the pattern of one modulator, the first unless another is named, while all else stays as it is. With the
transmissions p of its pixels, exp(2πi·opd/λ) of a phase modulator, E_k = A_k p at plane k is linear, and |A_k Δp|² ≤
Σ b·|Δp|² with the light b that falls on a pixel's samples (`driven_element`), since all behind only absorbs. Both get
the laser amplitudes that the optimiser would find in closed form.

Double phase   the target's amplitude T at the middle plane, with a flat phase, is carried back to the pixels. The field
               U = A⁺T/b there, with A⁺ the adjoint, is shown by two phases in turn, as a checkerboard:
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
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.beams import slices
from holoview.holograms.optimise.checkpoint import Checkpoint, IterationState
from holoview.holograms.optimise.driven_element import DrivenElement, driven_name, make_driven, transmission_of
from holoview.holograms.optimise.lasers import Laser
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.elements import ComplexModulator, PhaseModulator, Pixels
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.optics.slm import nearest_level
from holoview.util.errors import UserError

Tensor = torch.Tensor

METHODS = ("adam", "double-phase", "gerchberg-saxton")
_LEVELS = 256  # that Gerchberg–Saxton chooses from on a continuous modulator: an error of the field of 0.7 %
_MODULI, _TURNS = 17, 64  # of a complex modulator: an error of 5 % of the field
_SAME_POWER = 1e-6  # of the values of a phase modulator, in float32
_DIM = 0.1  # of the mean: darker light on a modulator isn't made up for
_SCORES_AT_ONCE = 1 << 20  # numbers of the table from which it chooses


def iterate_named(
    method: str,
    system: System,
    stack: NDArray[np.floating],
    settings: Settings,
    start: Any = None,
    *,
    element: str = "",
    device: str = "cpu",
) -> Iterator[IterationState]:
    """The states of a named method, as `iterate` yields them; arguments as there.

    element: the name of the modulator that is driven, the first when "". The others stay as `start` has them, or flat.

    method: "double-phase", which yields one state, or "gerchberg-saxton", which yields `settings.iterations` + 1
    states. Of these, every `settings.amplitudes_every`-th state and the last have amplitudes, loss and hologram of
    their own; the others repeat those before.

    Raises UserError as `iterate` does, and for effects that change the light of the modulators.
    """
    driven = make_driven(system, stack, settings, start, device, element)
    if method == "double-phase":
        if not isinstance(driven.element, PhaseModulator):
            found = f'"{driven.name}", of kind {driven.element.kind}'
            raise UserError(f"--method {method}", found, expected="a phase modulator", remedy="name it by --modulator")
        return _states(driven, _double_phase_drives(driven), settings, 0)
    return _states(driven, _gerchberg_saxton_drives(driven, settings.iterations), settings, settings.iterations)


def describe_method(method: str, system: System, element: str = "", *, has_start: bool = False) -> str:
    """A sentence for the user on the pattern that a method finds on a system. has_start: whether others have one."""
    text = "Gerchberg–Saxton: targets of the lasers count alike"
    if method == "double-phase":
        wavelengths = dict.fromkeys(λ for _, λ in chosen_lasers(make_plan(system)))
        names = [f"{system.wavelengths_m[λ] * 1e9:.1f} nm" for λ in wavelengths]
        text = f"double phase, computed for the brightest wavelength of each frame: {', '.join(names)}"
    driven, number = driven_name(system, element), sum(kind_of.is_driven for kind_of in _pixels(system))
    if number == 1:
        return text
    stay = "as they begin" if has_start else "flat"
    if number == 2:
        other = "first" if element and driven != driven_name(system) else "second"
        return f"{text}; the {other} modulator stays {'as it begins' if has_start else 'flat'}"
    return f"{text}; {driven} is driven, and the other modulators stay {stay}"


def _pixels(system: System) -> list[Pixels]:
    return [element for element in system.elements if isinstance(element, Pixels)]


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


def _states(driven: DrivenElement, drives: Iterator[Tensor], settings: Settings, last: int) -> Iterator[IterationState]:
    started, best, judged = time.perf_counter(), None, None
    for iteration, drive in enumerate(drives):
        if judged is None or iteration % settings.amplitudes_every == 0 or iteration == last:
            judged = driven.judge(drive)
            if best is None or judged.loss < best.loss:
                best = judged
        assert best is not None
        yield IterationState(
            iteration=iteration,
            iterations=last,
            loss=judged.loss,
            psnr_db=judged.psnr_db,
            best_psnr_db=best.psnr_db,
            eyebox=judged.eyebox,
            light=judged.light,
            seconds=time.perf_counter() - started,
            make_best=best.make_hologram,
            picture=judged.picture,
            checkpoint=_no_checkpoint,
        )


def _no_checkpoint() -> Checkpoint:
    raise UserError("--checkpoint", "of a named method", expected="the optimiser's own method")


def _target_intensities(driven: DrivenElement) -> Tensor:
    """The intensity (laser, plane, y, x) ≥ 0 that each laser should have at unit amplitude.

    Of all mixtures of the lit wavelengths that give the target's channels, the one of least squares; 0 where negative.
    """
    objective, lit = driven.problem.objective, sorted({λ for _, λ in driven.lasers})
    channels = objective.wavelength_channels[lit].cpu().double()
    mixture = torch.linalg.pinv(channels.T).to(objective.target)
    shares = torch.einsum("lc,kcyx->lkyx", mixture, objective.target).clamp_(min=0)
    return shares[[lit.index(λ) for _, λ in driven.lasers]]


# --- double phase ----------------------------------------------------------------------------------------------------


def _double_phase_drives(driven: DrivenElement) -> Iterator[Tensor]:
    """The one drive (frame, y, x) of the closed form."""
    light, system, element = driven.light, driven.system, driven.element
    assert isinstance(element, PhaseModulator)
    plan, drive = light.plan, torch.zeros_like(driven.start)
    middle = len(plan.planes_m) // 2
    shares = _target_intensities(driven)[:, middle]
    amplitudes = torch.stack([shares[_lasers_of(driven, frame)].mean(dim=0).sqrt() for frame, _ in driven.lasers])
    most_upright = [int(np.argmin(np.hypot(*plan.slopes[:, λ].T))) for _, λ in driven.lasers]
    carrier = light.carrier().conj()

    def show_target(plane: int, rows: slice, fields: Tensor) -> None:
        fields.zero_()
        for laser, source in enumerate(most_upright):
            fields[laser, source] = amplitudes[laser, rows] * carrier[rows]

    driven.show(drive)
    light.process_planes([middle], show_target, carry_back=True)
    pixels, bound = light.pixel_fields(), driven.bound
    if bool((bound != bound.flatten()[0]).any()):  # of the light that falls on it: what it should be behind, over this
        pixels = pixels / torch.maximum(bound, _DIM * bound.mean(dim=(1, 2), keepdim=True))
    for frame, λ in reversed(chosen_lasers(plan)):
        phase = double_phase(pixels[driven.lasers.index((frame, λ))])
        drive[driven.frame_of(frame)] = _drive_of_phase(phase, float(system.wavelengths_m[λ]) / element.stroke_m)
    yield nearest_level(drive, element)


def _lasers_of(driven: DrivenElement, frame: int) -> list[int]:
    return [i for i, (own, _) in enumerate(driven.lasers) if own == frame]


def _drive_of_phase(phase: Tensor, wave: float) -> Tensor:
    """The drive in 0…1 whose phase is nearest. wave: the wavelength as a fraction of the stroke."""
    drive = torch.remainder(phase / (2 * math.pi), 1.0) * wave
    return torch.where(drive > (1 + wave) / 2, 0.0, drive.clamp(max=1))


# --- Gerchberg–Saxton ------------------------------------------------------------------------------------------------


def _gerchberg_saxton_drives(driven: DrivenElement, iterations: int) -> Iterator[Tensor]:
    """The drives (frame, y, x), from the start, which gets the modulator's levels, to the last iteration."""
    projections = AlternatingProjections(driven)
    drive = projections.start(driven.start)
    for _ in range(iterations):
        yield drive
        drive = projections.step(drive)
    yield drive


class AlternatingProjections:
    """Gerchberg and Saxton's projections, for several planes and for wavelengths that share a pattern.

    error: Σ over planes w_k·Σ(|E| − T)², over lasers and samples that count, of the drive before the last step. The
    targets T are scaled once, for each laser, to the energy of the field that the start gives in all planes.
    """

    error: float

    def __init__(self, driven: DrivenElement) -> None:
        self._driven, objective = driven, driven.problem.objective
        self._targets = _target_intensities(driven).sqrt_()
        self._counts = torch.zeros(self._targets.shape[-2:], device=self._targets.device)
        self._counts[objective.region_slices] = 1
        self._weights = objective.plane_weights
        self._bound = float(self._weights.sum()) * driven.bound
        self._choices = _choices(driven.element).to(driven.start.device)

    def start(self, drive: Tensor) -> Tensor:
        """The first drive (frame, y, x): at the nearest of the values that are chosen from. Scales the targets."""
        drive = self._nearest(drive[:, None], torch.ones_like(drive.real)[:, None], self._choices[None], drive.shape)
        self._driven.show(drive)
        planes = range(self._targets.shape[1])
        parts = self._driven.light.process_planes(planes, self._energy_of_rows, carry_back=False)
        energy = torch.stack([part for plane in parts for part in plane]).sum(dim=0)
        wanted = (self._targets.square() * self._counts).sum(dim=(1, 2, 3)).cpu().double()
        scale = torch.where(wanted > 0, (energy / wanted.clamp_min(1e-300)).sqrt(), 0.0)
        self._targets *= scale.to(self._targets)[:, None, None, None]
        self._shown = (scale > 0).to(self._targets)[:, None, None, None]
        return drive

    def step(self, drive: Tensor) -> Tensor:
        """The drive (frame, y, x) after one iteration."""
        driven = self._driven
        driven.show(drive)
        parts = driven.light.process_planes(
            range(self._targets.shape[1]), self._replace_by_corrections, carry_back=True
        )
        self.error = float(sum(part for plane in parts for part in plane))
        wanted = (
            self._bound * driven.transmissions(drive).to(drive.device, torch.complex64) + driven.light.pixel_fields()
        )
        after = drive.clone()
        for shown in sorted({driven.frame_of(frame) for frame, _ in driven.lasers}):
            own = [i for i, (frame, _) in enumerate(driven.lasers) if driven.frame_of(frame) == shown]
            λ = [float(driven.system.wavelengths_m[driven.lasers[i][1]]) for i in own]
            values = torch.stack([transmission_of(driven.element, self._choices, one) for one in λ])
            after[shown] = self._nearest(wanted[own][None], self._bound[own][None], values, (1, *drive.shape[1:]))[0]
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

    def _nearest(self, wanted: Tensor, bound: Tensor, values: Tensor, shape: Sequence[int]) -> Tensor:
        """The drives of `shape` whose values v are best: of least Σ_laser b·|v|² − 2·Re(conj(u)·v), which is
        Σ b·|v − u/b|² up to a constant.

        wanted, bound: u and b (pattern, laser, y, x). values: v (laser, choice).
        """
        numbers = torch.view_as_real(wanted.to(torch.complex64)).movedim(1, 3).flatten(3).flatten(0, 2)
        own = torch.view_as_real(values.to(torch.complex64)).movedim(1, 0).flatten(1).to(numbers.device)
        powers, weights = values.abs().square().float().T.to(numbers.device), bound.movedim(1, 3).flatten(0, 2)
        is_constant = bool((powers - powers[:1]).abs().max() < _SAME_POWER)
        chosen = []
        for block in slices(len(numbers), max(1, _SCORES_AT_ONCE // len(own))):
            scores = 2 * numbers[block] @ own.T
            if not is_constant:
                scores -= weights[block] @ powers.T
            chosen.append(scores.argmax(dim=1))
        return self._choices[torch.cat(chosen)].reshape(tuple(shape))


def _choices(element: Pixels) -> Tensor:
    """The drives that Gerchberg–Saxton chooses from: levels, or so many that a finer choice changes little."""
    levels = getattr(element, "levels", None)
    if isinstance(element, ComplexModulator):
        turns = torch.arange(_TURNS) * (2 * math.pi / _TURNS)
        return torch.polar(
            torch.linspace(0, 1, _MODULI)[:, None].expand(-1, _TURNS), turns.expand(_MODULI, -1)
        ).flatten()
    return torch.as_tensor(np.linspace(0, 1, _LEVELS) if levels is None else np.array(levels), dtype=torch.float32)
