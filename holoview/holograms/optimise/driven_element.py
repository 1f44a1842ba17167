"""One modulator of a bench whose pattern is sought while all else stays: the linear map from its pixels to the planes.

The field E_k at plane k is linear in the transmissions p of the element's pixels: E_k = A_k·p, with the light that
falls on it and all that stands behind it in A_k. Light is lost on the way, but never made, so that a change of p
changes the fields by at most

    Σ_samples |A_k·Δp|² ≤ Σ_pixels b·|Δp|²,   b = Σ over the pixel's samples of the intensity that falls on them

Of the first modulator of the short form this is `ForwardModel`, with b = the samples of a pixel; of any other element
`ElementLight` computes it stage by stage, and torch differentiates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.chain_executor import ChainExecutor
from holoview.holograms.optimise.chain_loop import ChainProblem, check_whole_picture
from holoview.holograms.optimise.forward_model import AutogradModel, ForwardModel, ProcessRows
from holoview.holograms.optimise.lasers import Laser
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.variables import first_drive
from holoview.light.engine.frame import light_along
from holoview.light.engine.torch_executor import TorchField
from holoview.light.model.chain import Modulate
from holoview.light.model.drives import chain_drives
from holoview.light.model.elements import AmplitudeModulator, ComplexModulator, PhaseModulator, Pixels
from holoview.light.model.plan import Plan
from holoview.light.model.system import System
from holoview.light.numerics.resample import upsample_nearest
from holoview.light.optics.chain import pixel_transmission, placed
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.light.optics.slm import nearest_level, phasor
from holoview.util.errors import UserError

Tensor = torch.Tensor
Result = TypeVar("Result")

_SAME = 1e-6  # of transmissions with and without effects, in complex128: a sine of a phase of some turns


@dataclass(frozen=True)
class JudgedPattern:
    """What a pattern shows with the amplitudes that suit it best. light: as of `IterationState`."""

    loss: float
    psnr_db: float
    eyebox: float
    light: float
    picture: Callable[[], NDArray[np.floating]]
    make_hologram: Callable[[], Hologram]


def driven_name(system: System, name: str = "") -> str:
    """The name of the modulator that a named method drives, when "" the first that isn't held.

    Raises UserError for another one.
    """
    named = dict(zip(system.element_names, system.elements, strict=True))
    driven = [own for own, e in named.items() if isinstance(e, PhaseModulator | AmplitudeModulator | ComplexModulator)]
    if name and name not in driven:
        found = f'"{name}"' + (f", of kind {named[name].kind}" if name in named else "")
        raise UserError("--modulator", found, expected=", ".join(driven))
    return name or next((own for own in driven if not getattr(named[own], "held", False)), driven[0])


def transmission_of(element: Pixels, drive: Tensor, wavelength_m: float) -> Tensor:
    """The transmission complex128 of an element's pixels for its drive, of any shape."""
    if isinstance(element, PhaseModulator):
        return phasor(drive.double() * element.stroke_m, wavelength_m, torch.complex128)
    if isinstance(element, ComplexModulator):
        return pixel_transmission(element, drive, wavelength_m)
    assert isinstance(element, AmplitudeModulator)
    passing: Tensor = element.amplitude_of(drive).to(torch.complex128)
    return passing


class DrivenElement(ABC):
    """A modulator whose pattern is sought, its target and the rest of the bench.

    element, name: which. start: its patterns (frame, y, x) to begin with; one for all frames if these share it.
    light: the map A. bound: b (laser, y, x).
    """

    start: Tensor
    light: ForwardModel | ElementLight
    bound: Tensor

    def __init__(self, problem: Problem | ChainProblem, system: System, name: str) -> None:
        self.problem, self.system, self.name = problem, system, name
        element = system.elements[system.element_names.index(name)]
        assert isinstance(element, Pixels)
        self.element = element

    @property
    def lasers(self) -> list[Laser]:
        """(frame, wavelength) of all lasers that are on."""
        return self.problem.lasers

    @abstractmethod
    def show(self, drive: Tensor) -> None:
        """Lets `light` compute the light of a pattern (frame, y, x)."""

    @abstractmethod
    def judge(self, drive: Tensor) -> JudgedPattern:
        """What a pattern (frame, y, x) shows."""

    def frame_of(self, frame: int) -> int:
        """The pattern that is shown in a frame."""
        return frame if len(self.start) > 1 else 0

    def transmissions(self, drive: Tensor) -> Tensor:
        """p (laser, y, x) of a pattern (frame, y, x)."""
        λ = self.system.wavelengths_m
        found = [transmission_of(self.element, drive[self.frame_of(f)], float(λ[number])) for f, number in self.lasers]
        return torch.stack(found).to(drive.device)


class DrivenModulator(DrivenElement):
    """A modulator of the short form."""

    def __init__(
        self, system: System, stack: NDArray[np.floating], settings: Settings, start: Any, device: str, name: str
    ) -> None:
        drive = first_drive(system, settings, start)
        problem = Problem(system, stack, settings, device)
        if isinstance(problem.model, AutogradModel):
            raise changed_light()
        super().__init__(problem, system, name)
        self._problem, self._index = problem, system.element_names.index(name) // 2
        self._drive = drive.to(problem.model.device)
        if start is None:
            others = [i for i in range(drive.shape[1]) if i != self._index]
            self._drive[:, others] = 0
        self.start = self._drive[:, self._index].clone()
        strokes_m = [modulator.stroke_m for modulator in system.modulators]
        self._strokes_m = torch.tensor(strokes_m, dtype=torch.float32).reshape(-1, 1, 1).to(self._drive.device)
        if self._index == 0:
            self.light = problem.model
            shape = (len(problem.lasers), *self.start.shape[1:])
            self.bound = torch.full(shape, float(problem.model.plan.grid.upsample**2), device=problem.model.device)
        else:
            plan, patterns = problem.model.plan, self._drive.cpu().numpy()
            self.light = ElementLight(plan, patterns, self._index, self.element, problem.lasers, device)
            self.bound = self.light.bound()

    def show(self, drive: Tensor) -> None:
        """As there."""
        if isinstance(self.light, ElementLight):
            self.light.show(self.transmissions(drive))
        else:
            self.light.forward(self._whole(drive) * self._strokes_m)

    def judge(self, drive: Tensor) -> JudgedPattern:
        """As there."""
        whole, given = self._whole(drive), np.array(self.system.amplitudes)
        path_m = whole * self._strokes_m
        solved = self._problem.evaluate(path_m, given, EvaluationRequest(optimal_amplitudes=True)).optimal_amplitudes
        assert solved is not None
        found = self._problem.evaluate(path_m, solved, EvaluationRequest(eyebox_variation=True))
        assert found.eyebox_variation is not None
        make = partial(Hologram, whole.cpu().numpy().copy(), self.system.edit({"amplitudes": solved}))
        return JudgedPattern(found.loss, found.psnr_db, found.eyebox_variation, float("nan"), found.picture, make)

    def _whole(self, drive: Tensor) -> Tensor:
        """The patterns (frame, modulator, y, x) of all modulators."""
        whole = self._drive.clone()
        whole[:, self._index] = drive
        return whole


class DrivenChainElement(DrivenElement):
    """A modulator of a chain."""

    light: ElementLight

    def __init__(
        self, system: System, stack: NDArray[np.floating], settings: Settings, start: Any, device: str, name: str
    ) -> None:
        check_whole_picture(settings, stack)
        self._others = _flat(system) if start is None else chain_drives(system, start)
        problem = ChainProblem(system, stack, settings, device)
        super().__init__(problem, system, name)
        self._problem, shapes = problem, system.drive_shapes
        if start is None:
            noise = torch.rand(shapes[name], generator=torch.Generator().manual_seed(settings.seed))
            is_complex = isinstance(self.element, ComplexModulator)
            self._others[name] = (
                torch.polar(0.9 * torch.ones_like(noise), 2 * torch.pi * noise) if is_complex else noise
            )
        tensors = {own: torch.as_tensor(np.asarray(drive)) for own, drive in self._others.items()}
        self._others = {own: t.to(torch.complex64 if t.is_complex() else torch.float32) for own, t in tensors.items()}
        self.start = self._others[name].to(device)
        if not isinstance(self.element, ComplexModulator):
            self.start = nearest_level(self.start, self.element)  # type: ignore[arg-type]
        element = problem.plan.system.elements[system.element_names.index(name)]  # with effects
        ways = enumerate(problem.plan.way.transmissions)
        number, of = next((i, t) for i, t in ways if element in (t.element, *t.beside))
        if of.beside:
            raise UserError(
                "--modulator", f'"{name}", to whose light that beside it adds', expected="one in a place alone"
            )
        self.light = ElementLight(problem.plan, self._others, number, self.element, problem.lasers, device)
        self.bound = self.light.bound()
        self.light.check_plain(self.transmissions(self.start))

    def show(self, drive: Tensor) -> None:
        """As there."""
        self.light.show(self.transmissions(drive))

    def judge(self, drive: Tensor) -> JudgedPattern:
        """As there."""
        drives, problem = self._others | {self.name: drive}, self._problem
        with torch.no_grad():
            found = problem.evaluate(drives, self.system.amplitudes)
            solved = problem.solved_amplitudes(found.intensity)
            loss, image = problem.loss(found, solved)
        arrays = {name: own.cpu().numpy().copy() for name, own in drives.items()}
        return JudgedPattern(
            loss=float(loss),
            psnr_db=problem.objective.psnr_db(image),
            eyebox=problem.eyebox_variation(found, solved),
            light=problem.light(found.intensity, solved),
            picture=partial(problem.objective.picture, image[len(image) // 2]),
            make_hologram=partial(Hologram, arrays, self.system.edit({"amplitudes": solved})),
        )


def _flat(system: System) -> dict[str, Any]:
    """Patterns that leave the light as it is: no path, and a transmission of 1."""
    named = dict(zip(system.element_names, system.elements, strict=True))
    drives: dict[str, Any] = {}
    for name, shape in system.drive_shapes.items():
        kinds = {PhaseModulator: np.zeros(shape, np.float32), ComplexModulator: np.ones(shape, np.complex64)}
        drives[name] = kinds.get(type(named[name]), np.ones(shape, np.float32))
    return drives


def changed_light() -> UserError:
    """The error for effects that change the light of the driven modulator."""
    return UserError(
        "--method",
        "effects that change the modulators' light",
        expected="a bench without them",
        remedy="switch them off; rendering shows what they do",
    )


class ElementLight:
    """A and its adjoint, of an element at a step of the way, by torch's derivatives.

    patterns: of all elements, as of `FrameInputs`, of which its own doesn't count. number: of the element among those
    that `Modulate` names. lasers: (frame, wavelength). double: complex128 instead of complex64.
    """

    def __init__(
        self,
        plan: Plan,
        patterns: Any,
        number: int,
        element: Pixels,
        lasers: Sequence[Laser],
        device: str = "cpu",
        *,
        double: bool = False,
    ) -> None:
        self.plan, self.device, self._element, self.number = plan, torch.device(device), element, number
        self._lasers = lasers
        self._executor = ChainExecutor(plan, FrameInputs(plan, patterns), device=device, double=double)
        self._step = next(
            i for i, step in enumerate(plan.way.steps) if isinstance(step, Modulate) and step.number == number
        )
        sources = range(len(plan.slopes))
        self._incident = [[self._before(frame, λ, source) for source in sources] for frame, λ in lasers]
        self._pixels = torch.empty(0)

    def _before(self, frame: int, wavelength: int, source: int) -> Tensor:
        """The light (y, x) that falls on the element."""
        if self._step == 0:
            return self._executor.illuminate(wavelength, source).values
        along = light_along(self._executor, wavelength, frame, source)
        return next(field for index, (_, field) in enumerate(along) if index == self._step - 1).values.detach()

    def _samples(self, pixels: Tensor) -> Tensor:
        """The transmission of the samples of the field (y, x) of that of the pixels, real or complex."""
        if not self.plan.way.is_chain:
            return upsample_nearest(pixels, self.plan.grid.upsample)
        size = round(self._element.pitch_m / self.plan.grid.pitch_m)
        return placed(self.plan, self._element, upsample_nearest(pixels, size))

    def bound(self) -> Tensor:
        """b (laser, y, x)."""
        out = []
        for fields in self._incident:
            power = torch.stack([field.abs().square() for field in fields]).mean(dim=0)
            pixels = torch.zeros(self._element.shape, dtype=power.dtype, device=self.device, requires_grad=True)
            out.append(torch.autograd.grad(self._samples(pixels), pixels, power)[0])
        return torch.stack(out)

    def check_plain(self, pixels: Tensor) -> None:
        """Raises UserError if effects change the transmission of the pattern that was given, with p (laser, y, x)."""
        for (frame, λ), own in zip(self._lasers, pixels, strict=True):
            real = self._executor.inputs.transmission(frame, self.number, λ)
            assert real is not None
            if not torch.allclose(real, self._samples(own.cpu()), rtol=0, atol=_SAME):
                raise changed_light()

    def show(self, pixels: Tensor) -> None:
        """Computes the spectra behind the last element for transmissions p (laser, y, x)."""
        self._pixels = pixels.to(self.device, self._executor.dtype).requires_grad_()
        self._back = torch.zeros_like(self._pixels)
        self._spectra = [
            [self._behind(index, frame, λ, source) for source in range(len(self.plan.slopes))]
            for index, (frame, λ) in enumerate(self._lasers)
        ]

    def _behind(self, index: int, frame: int, wavelength: int, source: int) -> TorchField:
        field = TorchField(self._incident[index][source] * self._samples(self._pixels[index]))
        *_, (_, spectrum) = light_along(self._executor, wavelength, frame, source, behind=(self._step, field))
        return spectrum

    def process_planes(
        self, planes: Sequence[int], process_rows: ProcessRows[Result], *, carry_back: bool
    ) -> list[list[Result]]:
        """As of `ForwardModel`, with all rows of a plane at once."""
        results, last = list[list[Result]](), self.plan.way.last
        for plane in planes:
            at_plane = torch.stack(
                [
                    torch.stack(
                        [
                            self._executor.field(self._executor.transmit(spectrum, last, λ, plane), last).values
                            for spectrum in spectra
                        ]
                    )
                    for (_, λ), spectra in zip(self._lasers, self._spectra, strict=True)
                ]
            )
            fields = at_plane.detach().clone()
            results.append([process_rows(plane, slice(0, fields.shape[2]), fields)])
            if carry_back:  # torch's gradient of Re Σ conj(g)·E by p is A⁺g
                self._back += torch.autograd.grad(at_plane, self._pixels, fields.conj(), retain_graph=True)[0]
        return results

    def pixel_fields(self) -> Tensor:
        """As of `ForwardModel`: A⁺x (laser, y, x)."""
        return self._back

    def carrier(self) -> Tensor:
        """1: fields aren't multiplied by a plane wave here."""
        return torch.ones(self.plan.grid.shape, dtype=self._executor.dtype, device=self.device)


def make_driven(
    system: System, stack: NDArray[np.floating], settings: Settings, start: Any, device: str, name: str
) -> DrivenElement:
    """The modulator of a name. start: patterns of all modulators; where None, others than this one are flat.

    Raises UserError as `iterate` does, for a name that is none of a modulator's, and for effects that change its light.
    """
    kind = DrivenChainElement if system.is_chain else DrivenModulator
    return kind(system, stack, settings, start, device, driven_name(system, name))
