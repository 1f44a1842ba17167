"""The elements of a chain in torch: what each multiplies light by, sample by sample, and the kernel of a Fourier plane.

A Fourier element of focal length f is a sum over the samples, at samples of the same pitch dx, α = dx²/(λf):

    u(k) ▸ −i·α·Σ_j u(j)·exp(−2πi·α_y·j_y·k_y − 2πi·α_x·j_x·k_x)

By 2jk = j² + k² − (k − j)² it is a chirp, a convolution with one, which FFTs of the padded grid compute, and a chirp
(Rabiner, Schafer and Rader, Bell Syst. Tech. J. 48, 1249 (1969)), so that executors need no stage of their own for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from holoview.light.model.chain import pixel_shape
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.elements import (
    AmplitudeModulator,
    ComplexModulator,
    Element,
    Fourier,
    Lens,
    Mask,
    PhaseModulator,
    Pixels,
)
from holoview.light.model.masks import mask_values
from holoview.light.model.plan import Grid, Plan
from holoview.light.numerics.fourier import phasor_of_turns
from holoview.light.numerics.resample import affine_warp, centred_indices
from holoview.light.optics.slm import nearest_level, phasor
from holoview.light.optics.torch_effects import TorchEffects, laser_number

Tensor = torch.Tensor
_SOURCE = -1  # in place of the identity of an element


class ChainTransmissions:
    """What the elements of a chain multiply light by, with effects on them and on the light before the first.

    drives: patterns (frame, y, x) by the names of elements, for the frames of the nominal system.
    effects: those of the nominal system when None. laser: number of the one that is on; as the wavelength when None.
    """

    def __init__(
        self, plan: Plan, drives: dict[str, Any], effects: TorchEffects | None = None, laser: int | None = None
    ) -> None:
        self._plan, self._drives, self._laser = plan, drives, laser
        self._effects = TorchEffects(plan.nominal.effect_values) if effects is None else effects
        names = zip(plan.system.elements, plan.system.element_names, strict=True)
        self._names = {id(element): name for element, name in names}
        self._static: dict[tuple[int, str, int], Tensor] = {}

    def show(self, drives: dict[str, Any]) -> None:
        """Takes other patterns from now on."""
        self._drives = drives

    def is_sampled(self, number: int) -> bool:
        """Always."""
        return True

    def shown_first(self, frame: int, number: int) -> int:
        """The first frame of `plan.system` with the transmission of a step of the way: of a static one the first."""
        of = self._plan.way.transmissions[number]
        driven = [e for e in (of.element, *of.beside) if isinstance(e, Pixels) and e.is_driven]
        are_shared = all(len(self._drive(e)) == 1 for e in driven) and not self._plan.nominal.effects
        return 0 if are_shared or not driven else frame

    def sampled_transmission(self, frame: int, number: int, wavelength: int) -> Tensor:
        """The transmission (y, x) complex128 of the samples at a step of the way; the first lets in the source."""
        first, *others = self.arms(frame, number, wavelength)
        samples = torch.stack([first, *others]).sum(dim=0) if others else first
        if number or not self._effects.on_parts(("source",), "transmission"):
            return samples
        key = (_SOURCE, "", wavelength)
        if key not in self._static:
            uniform = torch.ones(self._plan.grid.shape, dtype=torch.complex128)
            self._static[key] = self.source_light(uniform, wavelength)
        return samples * self._static[key]

    def arms(self, frame: int, number: int, wavelength: int) -> list[Tensor]:
        """What each element at a step of the way adds to its transmission, (y, x): of several their equal shares."""
        of = self._plan.way.transmissions[number]
        first = self._of_element(of.element, of.place, frame, wavelength)
        if not of.beside:
            return [first]
        others = [self._of_element(element, "", frame, wavelength) for element in of.beside]
        return [samples / (1 + len(others)) for samples in (first, *others)]

    def _of_element(self, element: Element, place: str, frame: int, wavelength: int) -> Tensor:
        """The transmission (y, x) of an element; that of a static one is kept."""
        if isinstance(element, Pixels) and element.is_driven:
            return self._of_driven(element, frame, wavelength)
        key = (id(element), place, wavelength)
        if key not in self._static:
            self._static[key] = self._of_static(element, place, wavelength)
        return self._static[key]

    def source_light(self, wave: Tensor, wavelength: int) -> Tensor:
        """The light before the first element: a plane wave (y, x) of the source with the effects on the source."""
        grid = self._plan.grid
        λ, laser = float(self._plan.system.wavelengths_m[wavelength]), self._laser_number(wavelength)
        context = ModulatorContext(0, λ, 0.0, grid.pitch_m, grid.shape, 1, laser)
        return self._effects.on_light("transmission", wave, context, ("source",))

    def name_of(self, element: Element) -> str:
        """The name of an element."""
        return self._names[id(element)]

    def patterns(self, element: Pixels, frame: int) -> tuple[Sequence[Any], float]:
        """What an element shows in a frame of `plan.system`, and the factor of optical paths there.

        The patterns (rows, columns) that is sent, that was sent before, and that was first of all; None if unknown.
        """
        drive, (shown, moment) = self._drive(element), divmod(frame, len(self._plan.moments))
        frames = (shown, shown - 1, 0)  # they repeat
        return [drive[f if len(drive) > 1 else 0] for f in frames], self._plan.moments[moment]

    def sent(self, element: Pixels, frame: int) -> Tensor:
        """What an element is sent in a frame of `plan.system` (rows, columns): of real patterns the nearest levels."""
        pattern = self.patterns(element, frame)[0][0]
        return pattern if isinstance(element, ComplexModulator) else nearest_level(pattern.double(), element)  # type: ignore[arg-type]

    def _of_driven(self, element: Pixels, frame: int, wavelength: int) -> Tensor:
        """The transmission (y, x) of the samples of an element that shows patterns, in a frame of `plan.system`."""
        patterns, path_factor = self.patterns(element, frame)
        context, part = self._context(element, wavelength), (self.name_of(element),)
        effects = self._effects
        if isinstance(element, ComplexModulator):
            light = pixel_transmission(element, patterns[0], context.wavelength_m)
            return self._placed(element, self._with_path(light, None, context, part), context, part)
        sent = [None if p is None else nearest_level(p.double(), element) for p in patterns]  # type: ignore[arg-type]
        assert sent[0] is not None
        shown = effects.shown(sent[0], context, part, sent[1], sent[2])
        context = replace(context, shown=shown)
        if isinstance(element, PhaseModulator):
            light = self._with_path(None, shown * context.stroke_m, context, part, path_factor)
        else:
            assert isinstance(element, AmplitudeModulator)
            light = self._with_path(element.amplitude_of(shown).to(torch.complex128), None, context, part)
        return self._placed(element, light, context, part)

    def _with_path(
        self,
        light: Tensor | None,
        path_m: Tensor | None,
        context: ModulatorContext,
        part: tuple[str, ...],
        path_factor: float = 1.0,
    ) -> Tensor:
        """The transmission of pixels or samples by an amplitude or complex one, a path (m), or both, with effects."""
        if path_m is None and self._effects.on_parts(part, "optical_path"):
            path_m = torch.zeros(context.shape, dtype=torch.float64)
        if path_m is not None:
            path_m = self._effects.on_light("optical_path", path_m, context, part) * path_factor
            delay = phasor(path_m, context.wavelength_m, torch.complex128)
            light = (
                delay if light is None else delay * (light if light.shape == delay.shape else context.sampled(light))
            )
        assert light is not None
        return self._effects.on_light("transmission", light, context, part)

    def _placed(self, element: Pixels, light: Tensor, context: ModulatorContext, part: tuple[str, ...]) -> Tensor:
        """The transmission of an element's pixels or samples at the samples of the field, where it is really."""
        samples = placed(self._plan, element, context.sampled(light))
        pose = self._effects.element_pose(part)
        if pose.is_identity:
            return samples
        (oy, ox), edge = element.offset_m, (1, 1, 1, 1)  # a dark edge, since nothing passes beside the element
        rows = pose.about((-oy, -ox)).inverse_affine(self._plan.grid.pitch_m)
        return affine_warp(torch.nn.functional.pad(samples, edge), rows)[1:-1, 1:-1]

    def _context(self, element: Pixels, wavelength: int) -> ModulatorContext:
        """The context of the hooks on an element."""
        λ, laser = float(self._plan.system.wavelengths_m[wavelength]), self._laser_number(wavelength)
        size, stroke_m = round(element.pitch_m / self._plan.grid.pitch_m), getattr(element, "stroke_m", None) or 0.0
        own = (element.pitch_m, pixel_shape(element), size, laser)
        return ModulatorContext(0, λ, stroke_m, *own, element=self.name_of(element))

    def _laser_number(self, wavelength: int) -> int:
        return laser_number(self._plan, wavelength) if self._laser is None else self._laser

    def _drive(self, element: Element) -> Tensor:
        drive = self._drives[self.name_of(element)]
        return drive if isinstance(drive, Tensor) else torch.from_numpy(drive.copy())

    def _of_static(self, element: Element, place: str, wavelength: int) -> Tensor:
        λ, grid = float(self._plan.system.wavelengths_m[wavelength]), self._plan.grid
        if isinstance(element, Mask):
            context, part, values = (
                self._context(element, wavelength),
                (self.name_of(element),),
                mask_values(element),
            )
            path_m, light = (
                None if a is None else torch.from_numpy(a.copy()) for a in (values.path_m, values.amplitude)
            )
            light = None if light is None else light.to(torch.complex128)
            if path_m is None and light is None:
                light = torch.ones(values.shape, dtype=torch.complex128)
            return self._placed(element, self._with_path(light, path_m, context, part), context, part)
        if isinstance(element, Lens):
            return _quadratic(grid, grid.pitch_m**2 / (λ * element.focal_length_at(λ)))
        assert isinstance(element, Fourier)
        rate = grid.pitch_m**2 / (λ * element.focal_length_m)
        chirp = _quadratic(grid, rate)
        return chirp if place == "before" else -1j * rate * chirp


def pixel_transmission(element: ComplexModulator, drive: Tensor, wavelength_m: float) -> Tensor:
    """The transmission (rows, columns) complex128 of a complex modulator's pixels for its drive."""
    values = drive.to(torch.complex128)
    if element.stroke_m is None:
        return values
    turns = torch.remainder(torch.angle(values) / (2 * torch.pi), 1.0)
    return values.abs() * phasor_of_turns(turns * (element.stroke_m / wavelength_m))


def placed(plan: Plan, element: Pixels, samples: Tensor) -> Tensor:
    """The samples of an element at those (y, x) of the field, which are 0 beside it."""
    grid = plan.grid
    starts = first_sample(plan, element, samples.shape)
    if samples.shape == grid.shape:
        return samples
    edges = [starts[1], grid.shape[1] - starts[1] - samples.shape[1]]
    edges += [starts[0], grid.shape[0] - starts[0] - samples.shape[0]]
    return torch.nn.functional.pad(samples, edges)


def first_sample(plan: Plan, element: Pixels, shape: Sequence[int]) -> tuple[int, int]:
    """The sample (y, x) of the field at which the first of an element's samples, so many (y, x), stands."""
    y, x = (
        round((n - m) / 2 + off / plan.grid.pitch_m)
        for n, m, off in zip(plan.grid.shape, shape, element.offset_m, strict=True)
    )
    return y, x


def _quadratic(grid: Grid, rate: float) -> Tensor:
    """exp(−iπ·rate·(j_y² + j_x²)) (y, x) complex128 at the samples, counted from the middle of the field."""
    y, x = (
        phasor_of_turns(-0.5 * rate * centred_indices(n, torch.float64, torch.device("cpu")).square())
        for n in grid.shape
    )
    return y[:, None] * x[None, :]


def fourier_kernel(plan: Plan, element: Fourier, wavelength: int) -> Tensor:
    """The spectrum (P_y, P_x) complex128 of exp(iπα·d²) for lags |d| < N, in `fftfreq` order."""
    grid, λ = plan.grid, float(plan.system.wavelengths_m[wavelength])
    rate, lines = grid.pitch_m**2 / (λ * element.focal_length_m), []
    for n, padded in zip(grid.shape, grid.padded, strict=True):
        lags = torch.arange(padded, dtype=torch.float64)
        lags = torch.minimum(lags, padded - lags)
        chirp = phasor_of_turns(0.5 * rate * lags.square())
        lines.append(torch.fft.fft(torch.where(lags < n, chirp, torch.zeros_like(chirp))))
    return lines[0][:, None] * lines[1][None, :]
