"""One evaluation of the loss: model, objective and eyebox together, plane by plane."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.errors import UserError
from holoview.optimise.amplitudes import AmplitudeProblem
from holoview.optimise.eyebox import Eyebox
from holoview.optimise.memory import keeps_fields, needs_memory
from holoview.optimise.objective import colours_of, make_objective
from holoview.optimise.quantise import Jumps, own_cost
from holoview.optimise.settings import Settings
from holoview.optimise.team import ALONE, Team, share_out, with_lasers
from holoview.optimise.threads import suited_threads
from holoview.optimise.traced import model_for
from holoview.optimise.wavelengths import check_observer, colour_slopes
from holoview.plan import Plan, make_plan
from holoview.system import System

Tensor = torch.Tensor
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Wanted:
    """What an evaluation shall bring beside loss and PSNR."""

    gradient: bool = False
    amplitudes: bool = False  # their closed form
    eyebox: bool = False
    amplitude_slopes: bool = False  # with the gradient, for losses without a closed form
    chromatic: bool = False  # the gradient with respect to the wavelengths
    jump_m: Tensor | None = None  # take slopes to neighbouring levels, this far from those shown, for the gradient
    stiffness: float = 0.0  # share of a jump's own cost that counts

    @property
    def products(self) -> bool:
        """Whether Σ ∂L/∂image·intensity is needed."""
        return self.amplitude_slopes or self.chromatic


@dataclass(frozen=True)
class Evaluation:
    """loss and PSNR (dB, mean over planes); what wasn't wanted is None.

    gradient: ∂L/∂opd (frame, modulator, y, x). amplitude_slopes: ∂(image loss)/∂amplitude, solved: amplitudes of least
    squares, both (frame, wavelength). chromatic: ∂L/∂λ (wavelength,), 1/m. eyebox: coefficient of variation.
    picture: the middle plane in linear sRGB, (y, x, 3).
    """

    loss: float
    psnr_db: float
    picture: Callable[[], NDArray[np.floating]]
    gradient: Tensor | None = None
    amplitude_slopes: Floats | None = None
    solved: Floats | None = None
    chromatic: Floats | None = None
    eyebox: float | None = None


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
        team: Team = ALONE,
    ) -> None:
        self.system, self.settings, self.team = system, settings, team
        plan = self._plan_of(system, settings)
        _check_effects(plan, settings)
        parts = share_out(plan, team)
        self.lasers = [laser for part in parts for laser in part]
        self._mine = team.part(len(self.lasers))
        plan = with_lasers(plan, parts[team.rank])
        self._needs_memory = partial(needs_memory, chromatic="wavelengths" in settings.free)
        self.objective = make_objective(plan, stack, settings, device=device)
        if "wavelengths" in settings.free:
            check_observer(system.observer, settings)
        self.samples = int(np.prod(plan.grid.padded))
        with self._needs_memory(plan, device), suited_threads(self.samples):
            self.model = model_for(plan, device=device, keep=keeps_fields(plan))
            self._intensity = torch.empty(len(self.model.lasers), *plan.grid.shape, device=self.model.device)
            self._images = torch.empty(2, *self.objective.target.shape[1:], device=self.model.device)
            self.eyebox = Eyebox(self.model)
            self._transmissions: dict[int, tuple[float, float]] = {}

    def use_wavelengths(self, wavelengths_m: Floats) -> None:
        """Goes on with other wavelengths, on the same grid."""
        self.system = self.system.edit({"wavelengths": wavelengths_m})
        plan = replace(make_plan(self.system), grid=self.model.plan.grid)
        self.model.use(with_lasers(plan, self.model.lasers))
        self.objective.colours = colours_of(self.objective.loss, plan, self.objective.target)
        self.eyebox = Eyebox(self.model)

    def evaluate(self, opd_m: Tensor, amplitudes: Floats, wanted: Wanted) -> Evaluation:
        """The loss of optical paths (frame, modulator, y, x) and laser amplitudes (frame, wavelength)."""
        with self._needs_memory(self.model.plan, str(self.model.device)), suited_threads(self.samples):
            return self._evaluate(opd_m, amplitudes, wanted)

    def _evaluate(self, opd_m: Tensor, amplitudes: Floats, wanted: Wanted) -> Evaluation:
        model, objective, intensity = self.model, self.objective, self._intensity
        model.forward(opd_m, chromatic=wanted.chromatic)
        colours, weights = self._colours(), self._weights(amplitudes)
        problem = AmplitudeProblem(colours, self.team)
        share = torch.as_tensor((colours * weights[:, None])[self._mine]).to(intensity)
        products = torch.zeros(objective.target.shape[1], len(self.lasers), dtype=torch.float64)
        judged, middle = [], len(objective.target) // 2
        for plane in range(len(objective.target)):
            model.see(plane, intensity)
            image = self._images[0]
            torch.mm(share.T, intensity.flatten(1), out=image.flatten(1))
            self.team.add(image)
            if plane == middle:
                self._images[1].copy_(image)
            if wanted.amplitudes:
                inside = (..., *objective.inside)
                weight = float(objective.plane_weights[plane])
                problem.add(intensity[inside], objective.target[plane][inside], weight)
            judged.append(objective.judge(plane, image))
            if wanted.gradient:
                if wanted.products:
                    products[:, self._mine] += (image.flatten(1) @ intensity.flatten(1).T).cpu().double()
                torch.mm(share, image.flatten(1), out=intensity.flatten(1))
                model.answer(plane, intensity)
        found = Evaluation(
            loss=sum(j.loss for j in judged),
            psnr_db=float(np.mean([j.psnr_db for j in judged])),
            picture=lambda: objective.picture(self._images[1]),
            solved=self._solved(problem) if wanted.amplitudes else None,
        )
        found = self._with_eyebox(found, amplitudes, wanted)
        return self._with_gradients(found, products, weights, opd_m, wanted) if wanted.gradient else found

    def _with_eyebox(self, found: Evaluation, amplitudes: Floats, wanted: Wanted) -> Evaluation:
        if not wanted.eyebox and self.settings.eyebox == 0:
            return found
        blocks = self.eyebox.blocks(amplitudes)
        self.team.add(blocks)
        variation = self.eyebox.variation(blocks)
        if not math.isfinite(variation):
            raise _nothing_passes()
        loss = found.loss
        if self.settings.eyebox > 0:
            loss += self.eyebox.add_penalty(blocks, amplitudes, self.settings.eyebox)
        return replace(found, loss=loss, eyebox=variation)

    def _with_gradients(
        self, found: Evaluation, products: Tensor, weights: Floats, opd_m: Tensor, wanted: Wanted
    ) -> Evaluation:
        """products (channel, laser): Σ ∂L/∂image·intensity, of this process's lasers."""
        gradient = torch.zeros_like(opd_m)
        model = self.model
        chromatic = torch.zeros(len(self.system.wavelengths_m), dtype=torch.float64) if wanted.chromatic else None
        jumps = None if wanted.jump_m is None else Jumps(wanted.jump_m, wanted.stiffness * self._own_costs(weights))
        model.finish(gradient, chromatic, jumps)
        self.team.add(gradient, *([products] if wanted.products else []), *([] if chromatic is None else [chromatic]))
        pulls = products.numpy()
        if chromatic is not None:
            colour = colour_slopes(self.objective.loss, self.system.wavelengths_m, self.system.observer)
            for laser, (_, λ) in enumerate(self.lasers):
                chromatic[λ] += float(weights[laser] * (colour[λ] @ pulls[:, laser]) / self.system.frames)
        return replace(
            found,
            gradient=gradient,
            amplitude_slopes=self._table(np.einsum("lc,cl->l", self._colours(), pulls))
            if wanted.amplitude_slopes
            else None,
            chromatic=None if chromatic is None else chromatic.numpy(),
        )

    def _solved(self, problem: AmplitudeProblem) -> Floats:
        problem.join()
        if problem.is_dark:
            raise _nothing_passes()
        found = problem.solve()
        if not np.any(found > 0):
            raise UserError(
                "target",
                "is shown best with every laser off",
                expected="light in the region that these lasers can show",
                remedy="change the target, the region or the lasers",
            )
        return self._table(found)

    def _own_costs(self, weights: Floats) -> Tensor:
        """κ of each own laser at each modulator; light that stops absorb costs nothing, in its field and its own."""
        grid = self.model.plan.grid
        inside = self.objective.target[0, 0][self.objective.inside].numel()
        squares = np.mean((self._colours() * weights[:, None])[self._mine] ** 2, axis=1)
        rows = []
        for (_, λ), square in zip(self.model.lasers, squares, strict=True):
            first, last = self._transmission(λ)
            cost = own_cost(float(square), grid.upsample, inside, self.model.sources)
            rows.append([cost * first * last, cost * last * last] if self.model.two else [cost * last * last])
        return torch.tensor(rows)

    def _transmission(self, wavelength: int) -> tuple[float, float]:
        if wavelength not in self._transmissions:
            self._transmissions[wavelength] = self.model.responses.transmission(wavelength)
        return self._transmissions[wavelength]

    def _colours(self) -> Floats:
        """Channels (laser, channel) that a laser adds at unit amplitude and intensity: frames are averaged."""
        table = self.objective.colours.cpu().double().numpy()
        return table[[λ for _, λ in self.lasers]] / self.system.frames

    def _weights(self, amplitudes: Floats) -> Floats:
        return np.array([amplitudes[laser] for laser in self.lasers])

    def _table(self, values: Floats) -> Floats:
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


def _nothing_passes() -> UserError:
    return UserError("relay2", "no light passes its stops", remedy="widen iris_na, or narrow dc_block_na")
