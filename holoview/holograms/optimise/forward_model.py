"""Wave propagation from patterns to intensities at each focal plane, and its hand-written adjoint.

A beam is one laser of one frame from one source direction. With the FFT F, the modulators' pixels
p_m = exp(2πi·opd_m/λ), the illumination s, the spectrum B of a pixel's shape, the transfer functions H, and brackets
for what lies on the modulator's area:

    V = B·H_gap·F[s·p₁],  w = [F⁻¹V]·p₂,  W = F w,  E_k = [F⁻¹ H_k W],  I_k = |E_k|²          (one modulator: W = V)

Only frequencies that pass the relays' stops are computed (`beams.SpectralAxis`). The first FFT is of pixels, not of
samples: the spectrum of an upsampled pattern is that of its pixels, repeated.

The adjoint carries conjugate gradients c, defined by dL = Re Σ c·dx, from the planes back to the modulators. They need
H itself where gradients would need its conjugate:

    c_E = ∂L/∂I·conj(E)·2,  c_W = Σ_k H_k·F⁻¹c_E,  and from there on as `propagation` says

An evaluation calls `forward` once, `process_planes`, and at last `accumulate_gradients`. Planes come one after the
other, so that the fields of only one plane are in memory. The loss at a sample depends on the fields at this sample
only, so that a plane is processed in blocks of rows: transformed along x, compared with the target and transformed back
while the block is in the cache. A structural loss takes a whole plane as one block.

The number is computed in six files, in this order: here the plain pair (`PlainBeam`), with which tests compare the
rest, and the model; `propagation` has its parts by torch, `beams` what they compute together; `compiled_model` has the
same parts in the compiled passes of `vector_kernels`, around `vector_fft`. `AutogradModel` takes benches whose effects
change the modulators' light.

The adjoint by hand saves processor time and memory. In place of that of `ModulatorLight`, torch's autograd makes an
evaluation take 1.04 times as long with one modulator and 1.24 to 1.46 times with two; with recomputation, which needs
no more memory than now, 1.16 times and 1.5 to 1.9 times. Without recomputation it takes 1.7 to 1.9 times the memory
(93 → 156 MiB, 278 → 520 MiB). Beside the compiled passes, which don't cover several sources, an evaluation of nine
sources would take 1.5 times as long. (Medians of 5 evaluations side by side, modulators of 96 × 128 or 192 × 256
pixels, 5 planes, complex64, one thread: holochrome-8, the same with one modulator and with 3 × 3 sources,
time-sequential.)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import TypeVar

import torch

from holoview.holograms.optimise.beams import (
    VECTOR,
    BeamFields,
    ColumnBlocks,
    SpectralAxis,
    TransferFunctions,
    block_bytes,
    group_beams,
    make_beam_fields,
    make_lines,
    slices,
    spectral_axes,
)
from holoview.holograms.optimise.lasers import lit_lasers
from holoview.holograms.optimise.level_gradients import LevelSteps, secant_gradient
from holoview.holograms.optimise.parallel import MIN_SAMPLES_FOR_TEAM, MIN_SAMPLES_FOR_THREADS, ThreadTeam
from holoview.holograms.optimise.propagation import TORCH_KERNELS, Kernels, ModulatorLight, PlanePropagation
from holoview.holograms.optimise.wavelengths import BeamAdjoint, wavelength_derivative
from holoview.light.engine.frame import spectrum_behind_modulators
from holoview.light.engine.torch_executor import TorchPropagation
from holoview.light.model.plan import Plan
from holoview.light.numerics.resample import upsample_nearest
from holoview.light.numerics.sampling import ceil_div, frequency_indices
from holoview.light.optics.bench import plane_wave, pupil_with_effects, relay_response
from holoview.light.optics.slm import sum_pool
from holoview.light.optics.torch_effects import SampledTransmissions

Tensor = torch.Tensor
Result = TypeVar("Result")

# --- the plain pair: what everything below computes -------------------------------------------------------------------


class PlainBeam:
    """One beam from the modulators to the planes and back, in the plainest form, complex128: the specification.

    Fields (y, x) are those on the modulators' area. A relay is F⁻¹·H·F of the field in its padded grid, and its
    transpose, since F is symmetric, F·H·F⁻¹. Effects of modulators are left out.
    """

    def __init__(self, plan: Plan, wavelength: int, source: int) -> None:
        self.grid, self.wavelength_m = plan.grid, float(plan.system.wavelengths_m[wavelength])
        self.illumination = plane_wave(plan, wavelength, source, torch.complex128, torch.device("cpu"))
        self.gap = torch.empty(0) if plan.system.gap_m is None else _whole_response(plan, 0, wavelength, 0)
        self.planes = torch.stack([_whole_response(plan, 1, wavelength, k) for k in range(len(plan.planes))])

    def forward(self, opd_m: Tensor) -> tuple[Tensor, list[Tensor]]:
        """The fields E (plane, y, x) for optical paths (modulator, y, x), m, and those w behind each modulator."""
        behind = [self.illumination * self.pixels(opd_m[0])]
        for path_m in opd_m[1:]:
            behind.append(self.relayed(behind[-1], self.gap) * self.pixels(path_m))
        return self.relayed(behind[-1], self.planes), behind

    def adjoint(self, opd_m: Tensor, behind: Sequence[Tensor], c_planes: Tensor) -> Tensor:
        """∂L/∂opd (modulator, y, x), 1/m, from the conjugate gradients c_E (plane, y, x), with dL = Re Σ c_E·dE."""
        c, products = self.relayed_transposed(c_planes, self.planes).sum(dim=0), []
        for path_m, field in zip(reversed(opd_m), reversed(behind), strict=True):
            products.append(sum_pool(c * field, self.grid.upsample))
            if len(products) < len(behind):
                c = self.relayed_transposed(c * self.pixels(path_m), self.gap)
        return torch.stack(products[::-1]).imag * (-2 * math.pi / self.wavelength_m)

    def pixels(self, path_m: Tensor) -> Tensor:
        """p = exp(2πi·opd/λ) at the samples."""
        return upsample_nearest(torch.exp((2j * math.pi / self.wavelength_m) * path_m), self.grid.upsample)

    def spectrum(self, field: Tensor) -> Tensor:
        """F of a field (…, y, x) in its padded grid."""
        return torch.fft.fft2(self._padded(field))

    def relayed(self, field: Tensor, response: Tensor) -> Tensor:
        """A relay: F⁻¹·H·F."""
        return torch.fft.ifft2(self.spectrum(field) * response)[..., *self.grid.inside]

    def relayed_transposed(self, c: Tensor, response: Tensor) -> Tensor:
        """Its transpose: F·H·F⁻¹."""
        return torch.fft.fft2(torch.fft.ifft2(self._padded(c)) * response)[..., *self.grid.inside]

    def _padded(self, field: Tensor) -> Tensor:
        padded = torch.zeros(*field.shape[:-2], *self.grid.padded, dtype=torch.complex128)
        padded[..., *self.grid.inside] = field
        return padded


def _whole_response(plan: Plan, relay: int, wavelength: int, plane: int) -> Tensor:
    """H·P of a relay at all frequencies of the padded grid, (P_y, P_x) complex128."""
    ky, kx = (torch.from_numpy(frequency_indices(count)) for count in plan.grid.padded)
    pupil = pupil_with_effects(plan, relay, wavelength, plan.planes[plane].eye)
    return relay_response(plan.transfer(relay, wavelength, plane), ky, kx, pupil, torch.complex128)


# --- the model --------------------------------------------------------------------------------------------------------

_SMALL_FIELDS_BYTES = 1 << 23
_MOST_PARTS = 4  # of the beams, and of a plane's rows, of fields between the two: one for each thread, up to so many
_PASSES = 16  # at most, over a plane by compiled code: enough for the threads of a processor
ProcessRows = Callable[[int, slice, Tensor], Result]
"""Called with a plane, rows and the fields E (laser, source, row, x) there; replaces these by c_E for the way back."""
ProcessLines = Callable[[int, slice, Tensor, PlanePropagation], Result]
"""The same with all lines of E (laser, source, y, k_x), and with the propagation that evaluates rows in one pass."""


class ForwardModel:
    """Fields of each laser, frame and source of a plan, and gradients with respect to the optical-path maps.

    A beam is the light of one laser from one source; fields are (laser, source, …).

    lasers: (frame, wavelength) of every laser that is on. double: compute in complex128 instead of complex64.
    rows_at_a_time: process planes in blocks of so many rows, one after the other in the calling thread; by default in
    blocks that fit the cache, in several threads. threads: of the team that shares the work, as in `ThreadTeam`.
    """

    axes: tuple[SpectralAxis, SpectralAxis]
    transfer_functions: TransferFunctions
    _fields: list[BeamFields]
    _light: ModulatorLight
    _lines: Tensor

    def __init__(
        self,
        plan: Plan,
        *,
        double: bool = False,
        device: str = "cpu",
        rows_at_a_time: int | None = None,
        kernels: Kernels = TORCH_KERNELS,
        threads: int | None = None,
    ) -> None:
        plan.nominal.require_short_form("a gradient by hand")
        self.device, self.kernels = torch.device(device), kernels
        self.complex_dtype = torch.complex128 if double else torch.complex64
        self.real_dtype = torch.float64 if double else torch.float32
        self.lasers = lit_lasers(plan)
        self.source_count = len(plan.slopes)
        self.has_second_modulator = plan.system.gap_m is not None
        self._rows_at_a_time, self._team = rows_at_a_time, ThreadTeam(self.device, threads)
        self._z_weighted_adjoints: list[ColumnBlocks] = []  # Σ z_k·(part of plane k in c_W), for ∂L/∂λ
        self.plan = plan
        self.set_plan(plan)

    def set_plan(self, plan: Plan) -> None:
        """Changes to a plan of the same grid, lasers and planes, but other wavelengths."""
        assert plan.grid == self.plan.grid
        self.plan, self.axes = plan, spectral_axes(plan)
        with suppress(AttributeError):  # there are none yet in a new model
            del self.transfer_functions, self._light, self._fields, self._lines  # frees memory for the next ones
        number_bytes, (rows, columns) = self.complex_dtype.itemsize, plan.grid.padded
        by_rows = self.kernels.has_passes(self.axes)
        self._block_bytes = limit = self._bytes_at_a_time(by_rows)
        width = columns if by_rows else max(1, limit // (rows * number_bytes))
        self.transfer_functions = TransferFunctions(
            plan, self.axes, width, self.complex_dtype, self.device, by_rows=by_rows
        )
        wavelengths = self.transfer_functions.wavelengths
        groups = group_beams(self.lasers, wavelengths, self.source_count, rows * columns * number_bytes, limit)
        beams, frequencies = (len(self.lasers), self.source_count), self.axes[1].last.frequencies
        like = torch.empty(0, dtype=self.complex_dtype, device=self.device)
        self._lines = make_lines(beams, plan.grid.shape[0], frequencies, like, by_rows=by_rows)
        blocks = self.transfer_functions.columns
        self._fields = [
            make_beam_fields(group, self.axes, blocks, self._lines, self.has_second_modulator, by_rows=by_rows)
            for group in groups
        ]
        self._light, self._propagation = self._make_parts(by_rows)
        λ = plan.system.wavelengths_m[[wavelength for _, wavelength in self.lasers]]
        self._path_factors = torch.from_numpy(-2 * math.pi / λ).to(self.device, self.real_dtype)

    def _bytes_at_a_time(self, by_rows: bool) -> int:
        """Bytes of a block. Compiled passes take one beam after the other: all beams of fields for which one thread is
        enough are a block, so that Python calls less often; of fields that fit the last cache, a thread's share."""
        samples = math.prod(self.plan.grid.padded)
        if not by_rows or samples >= MIN_SAMPLES_FOR_THREADS:
            return block_bytes(self.device)
        if samples < MIN_SAMPLES_FOR_TEAM:
            return _SMALL_FIELDS_BYTES
        beams = len(self.lasers) * self.source_count
        return ceil_div(beams, min(self._team.size, _MOST_PARTS)) * samples * self.complex_dtype.itemsize

    def _make_parts(self, by_rows: bool) -> tuple[ModulatorLight, PlanePropagation]:
        """From the pixels to the spectra, and from there to the planes; by_rows: in compiled passes."""
        arguments = (self.plan, self.lasers, self.transfer_functions)
        if not by_rows:
            return ModulatorLight(*arguments), PlanePropagation(self.axes)
        from holoview.holograms.optimise.compiled_model import CompiledModulatorLight, CompiledPlanePropagation

        return CompiledModulatorLight(*arguments), CompiledPlanePropagation(self.axes, self.complex_dtype)

    def set_eyes(self, plan: Plan) -> None:
        """Changes to a plan whose planes are seen from other places of the pupil (`Plan.seen_from`)."""
        self.plan = plan
        self.transfer_functions.set_eyes(plan)

    def spectrum(self, laser: int, source: int) -> ColumnBlocks:
        """W of a beam, (k_y, k_x) at the frequencies of `axes`; values written to it are used from then on."""
        return self._of_beam(laser, source, [fields.spectra for fields in self._fields])

    def adjoint_spectrum(self, laser: int, source: int) -> ColumnBlocks:
        """c_W of a beam, as `spectrum`."""
        return self._of_beam(laser, source, [fields.adjoint_spectra for fields in self._fields])

    @property
    def is_fixed_work(self) -> bool:
        """Whether equal calls are the same operations on the same memory, which a card can record and repeat."""
        return True

    @property
    def works_in_team(self) -> bool:
        """Whether threads of its own compute all large parts, so that torch needs no further ones."""
        return self._rows_at_a_time is None

    def forward(self, opd_m: Tensor, *, wavelength_gradient: bool = False) -> None:
        """Computes the spectra behind the last modulator for optical paths (frame, modulator, y, x), m.

        wavelength_gradient: also prepare what `accumulate_gradients` needs for the gradient of the wavelengths.
        """
        self.opd_m = opd_m
        self._phasors = self._team.map(lambda fields: self._light.compute_spectra(fields, opd_m), self._fields)
        self._clear_adjoints(wavelength_gradient)

    def process_planes(
        self,
        planes: Sequence[int],
        process_rows: ProcessRows[Result],
        process_lines: ProcessLines[Result] | None = None,
        *,
        carry_back: bool,
    ) -> list[list[Result]]:
        """Calls a function with the fields at each plane, block by block of rows.

        Returns its results for each plane, from top to bottom. carry_back: the function replaces the fields by c_E,
        whose part in c_W is then added. process_lines: takes the function's place where passes are compiled.
        """
        if not self._propagation.evaluates_lines:
            process_lines = None
        blocks = [(i, block) for i in range(len(self._fields)) for block in range(len(self.transfer_functions.columns))]
        results, before = [], None
        for plane in planes:
            self._team.map(partial(self._process_columns, before, plane), blocks)
            results.append(self._process_rows(plane, process_rows, process_lines, carry_back))
            before = plane if carry_back else None
        if before is not None:
            self._team.map(partial(self._process_columns, before, None), blocks)
        return results

    def accumulate_gradients(
        self, path_gradient: Tensor, wavelength_gradient: Tensor | None = None, level_steps: LevelSteps | None = None
    ) -> None:
        """Adds ∂L/∂opd to `path_gradient` (frame, modulator, y, x), ∂L/∂λ to `wavelength_gradient` (wavelength,) f64.

        With `level_steps`, the secant to each pixel's neighbouring level takes the place of ∂L/∂opd.
        """
        has_wavelengths = wavelength_gradient is not None

        def add(part: _GradientPart) -> None:
            if level_steps is None:
                self._add_path_gradients(part.lasers, part.products, path_gradient)
            for frame, secant in part.secants:
                path_gradient[frame].add_(secant)
            for wavelength, derivative in part.derivatives:
                assert wavelength_gradient is not None
                wavelength_gradient[wavelength] += derivative

        groups = range(len(self._fields))
        self._team.add_up(lambda index: self._group_gradients(index, has_wavelengths, level_steps), groups, add)

    def carrier(self) -> Tensor:
        """The plane wave (y, x) that multiplies all fields E, because their spectra are displaced."""
        y, x = (
            torch.arange(n, device=self.device).mul_(axis.displacement).remainder_(padded).to(self.real_dtype) / padded
            for n, padded, axis in zip(self.plan.grid.shape, self.plan.grid.padded, self.axes, strict=True)
        )
        turns = y[:, None] + x
        return torch.polar(torch.ones_like(turns), -2 * math.pi * turns)

    def pixel_fields(self) -> Tensor:
        """A⁺x at the first modulator's pixels, (laser, y, x), summed over sources and planes, for c_E = conj(x).

        A⁺ is the adjoint of the map A from these pixels to a plane. Overwrites the lines, as `accumulate_gradients`.
        """
        fields_of_lasers: dict[int, Tensor] = {}
        for fields, phasors in zip(self._fields, self._phasors, strict=True):
            products = self._light.backpropagate(fields, phasors)[0].sum(dim=1)  # (Aᵀc_E)·p, and |p| = 1
            for laser, field in enumerate(products.conj() * phasors[0], start=fields.group.lasers.start):
                fields_of_lasers[laser] = fields_of_lasers.get(laser, 0) + field
        return torch.stack([fields_of_lasers[laser] for laser in range(len(self.lasers))])

    # --- planes -----------------------------------------------------------------------------------------------------

    def _process_columns(self, before: int | None, plane: int | None, chosen: tuple[int, int]) -> None:
        """Carries a block of columns back from the plane before, and on to the next plane, if these are given."""
        index, block = chosen
        fields, transfers = self._fields[index], self.transfer_functions
        if not self._z_weighted_adjoints:
            self._propagation.move(fields, block, transfers, before, plane)
            return
        if before is not None:
            last = transfers.of_plane(block, fields.group.wavelengths, before)[:, None]
            adjoint = self._propagation.carry_back(fields, block, last)
            weighted = self._z_weighted_adjoints[index].blocks[block]
            weighted.addcmul_(adjoint, last, value=float(self.plan.planes_m[before]))
        if plane is not None:
            following = transfers.of_plane(block, fields.group.wavelengths, plane)[:, None]
            self._propagation.to_plane(fields, block, following)

    def _process_rows(
        self,
        plane: int,
        process_rows: ProcessRows[Result],
        process_lines: ProcessLines[Result] | None,
        carry_back: bool,
    ) -> list[Result]:
        def process(rows: slice) -> Result:
            if process_lines is not None:
                return process_lines(plane, rows, self._lines, self._propagation)
            return self._propagation.process_rows(
                self._lines[:, :, rows], lambda fields: process_rows(plane, rows, fields), carry_back=carry_back
            )

        total = self.plan.grid.shape[0]
        if self._rows_at_a_time is not None:
            return [process(rows) for rows in slices(total, self._rows_at_a_time)]
        row_bytes = len(self.lasers) * self.source_count * self.plan.grid.padded[1] * self.complex_dtype.itemsize
        at_a_time = self._block_bytes // row_bytes
        if process_lines is not None:  # whole vectors of rows
            at_a_time = max(1, at_a_time // VECTOR, total // (_PASSES * VECTOR)) * VECTOR
        return self._team.map(process, slices(total, at_a_time))

    def _clear_adjoints(self, wavelength_gradient: bool) -> None:
        for fields in self._fields:
            fields.adjoint_spectra.zero_()
        self._z_weighted_adjoints = []
        if wavelength_gradient:
            self._z_weighted_adjoints = [fields.adjoint_spectra.zeros_like() for fields in self._fields]

    def _of_beam(self, laser: int, source: int, groups: list[ColumnBlocks]) -> ColumnBlocks:
        for fields, blocks in zip(self._fields, groups, strict=True):
            lasers, sources = fields.group.lasers, fields.group.sources
            if lasers.start <= laser < lasers.stop and sources.start <= source < sources.stop:
                return blocks.of_beam(laser - lasers.start, source - sources.start)
        raise IndexError(f"laser {laser}, source {source}")

    # --- gradients --------------------------------------------------------------------------------------------------

    def _group_gradients(self, index: int, has_wavelengths: bool, level_steps: LevelSteps | None) -> _GradientPart:
        fields, phasors = self._fields[index], self._phasors[index]
        incident_adjoint = None
        if has_wavelengths:
            y, x = (axis.gap.frequencies for axis in self.axes)
            incident_adjoint = self._lines.new_empty(*fields.group.shape, y, x)
        part = _GradientPart(fields.group.lasers, self._light.backpropagate(fields, phasors, incident_adjoint))
        if incident_adjoint is None and level_steps is None:
            return part
        products = torch.stack(list(part.products), dim=2)
        if incident_adjoint is not None:
            part = replace(part, derivatives=self._wavelength_derivatives(index, products, incident_adjoint))
        if level_steps is not None:
            part = replace(part, secants=self._secants(part.lasers, products, level_steps))
        return part

    def _add_path_gradients(self, lasers: slice, products: Sequence[Tensor], path_gradient: Tensor) -> None:
        """Adds ∂L/∂opd (frame, modulator, y, x), from modulators' products c·w (laser, source, y, x)."""
        frames, factors = [frame for frame, _ in self.lasers[lasers]], self._path_factors[lasers]
        for frame, members in groupby(range(len(frames)), frames.__getitem__):
            first, *others = members
            chosen = slice(first, first + 1 + len(others))
            for product, out in zip(products, path_gradient[frame], strict=True):
                self.kernels.add_imaginary(product[chosen], factors[chosen], out)

    def _secants(self, lasers: slice, products: Tensor, level_steps: LevelSteps) -> list[tuple[int, Tensor]]:
        """The secants in place of `_add_path_gradients`, from products c·w (laser, source, modulator, y, x)."""
        share = products.shape[1] / self.source_count
        products, secants = products.sum(dim=1), []
        for laser, product in zip(range(lasers.start, lasers.stop), products, strict=True):
            frame, wavelength = self.lasers[laser]
            λ = float(self.plan.system.wavelengths_m[wavelength])
            curvatures = (level_steps.curvature[laser] * share).tolist()
            steps = zip(product, level_steps.path_m[frame], curvatures, strict=True)
            secants.append((frame, torch.stack([secant_gradient(p, step_m, λ, κ) for p, step_m, κ in steps])))
        return secants

    def _wavelength_derivatives(
        self, index: int, products: Tensor, incident_adjoint: Tensor
    ) -> list[tuple[int, float]]:
        fields, weighted = self._fields[index], self._z_weighted_adjoints[index]
        incident, derivatives = self._light.incident_spectra(fields, self._phasors[index][0]), []
        for i, (frame, wavelength) in enumerate(self.lasers[fields.group.lasers]):
            for j, source in enumerate(range(self.source_count)[fields.group.sources]):
                beam = BeamAdjoint(
                    wavelength=wavelength,
                    source=source,
                    spectrum=fields.spectra.of_beam(i, j).whole,
                    spectrum_adjoint=fields.adjoint_spectra.of_beam(i, j).whole,
                    z_weighted_adjoint=weighted.of_beam(i, j).whole,
                    incident_spectrum=incident[i, j],
                    incident_adjoint=incident_adjoint[i, j],
                    opd_m=self.opd_m[frame],
                    pixel_products=list(products[i, j]),
                )
                derivatives.append((wavelength, wavelength_derivative(self.plan, self.transfer_functions, beam)))
        return derivatives


@dataclass(frozen=True)
class _GradientPart:
    """What some beams add to the gradients.

    products: c·w (laser, source, y, x) of each modulator, overwritten by the thread's next part. secants: frames, and
    secants (modulator, y, x) of each. derivatives: wavelengths, and ∂L/∂λ of each.
    """

    lasers: slice
    products: Sequence[Tensor]
    secants: Sequence[tuple[int, Tensor]] = ()
    derivatives: Sequence[tuple[int, float]] = ()


# --- benches whose effects change the modulators' light: torch differentiates ----------------------------------------


class AutogradModel(ForwardModel):
    """Intensities and gradients of a plan whose modulators have effects, or another stroke than the nominal one.

    Gradients are derivatives also for modulators with few levels (`level_steps` is ignored). There is no gradient of
    the wavelengths.
    """

    def set_plan(self, plan: Plan) -> None:
        """Changes to a plan of the same grid, lasers and planes."""
        super().set_plan(plan)
        self._patterns = _Patterns(plan, self.complex_dtype)
        unshifted = replace(plan, grid=replace(plan.grid, offset=(0, 0)))  # where `beams` places the field
        is_double = self.complex_dtype == torch.complex128
        self._stages = _StagesBehindModulators(unshifted, self._patterns, double=is_double, device=self.device)
        self._stages.transfer_functions = self.transfer_functions

    @property
    def works_in_team(self) -> bool:
        """As there: the graph of derivatives is torch's own work."""
        return False

    @property
    def is_fixed_work(self) -> bool:
        """As there: torch's own graph of derivatives is made anew in each call."""
        return False

    def forward(self, opd_m: Tensor, *, wavelength_gradient: bool = False) -> None:
        """Computes the spectra behind the last modulator for nominal optical paths (frame, modulator, y, x), m."""
        assert not wavelength_gradient
        self.opd_m = opd_m.detach().requires_grad_()
        self._graph_spectra = []
        with torch.enable_grad():
            self._patterns.nominal_opd_m = self.opd_m
            for i, (frame, wavelength) in enumerate(self.lasers):
                for source in range(self.source_count):
                    spectrum = spectrum_behind_modulators(self._stages, wavelength, frame, source).values
                    self._graph_spectra.append((spectrum, i, source))
                    self.spectrum(i, source).write(slice(0, spectrum.shape[1]), spectrum.detach())
        self._clear_adjoints(False)

    def accumulate_gradients(
        self, path_gradient: Tensor, wavelength_gradient: Tensor | None = None, level_steps: LevelSteps | None = None
    ) -> None:
        """Adds ∂L/∂opd to `path_gradient` (frame, modulator, y, x)."""
        assert wavelength_gradient is None
        for spectrum, laser, source in self._graph_spectra:
            adjoint = self.adjoint_spectrum(laser, source).whole
            (gradient,) = torch.autograd.grad(spectrum, self.opd_m, adjoint.conj())  # torch: ∂L/∂Re + i·∂L/∂Im
            path_gradient += gradient
        self._graph_spectra = []


class _StagesBehindModulators(TorchPropagation):
    """The stages up to the spectrum behind the last modulator."""

    transfer_functions: TransferFunctions

    def transfer(self, relay: int, wavelength: int, plane: int = 0) -> Tensor:
        """Transfer function × pupil of the gap."""
        assert relay == 0
        return self.transfer_functions.across_gap(wavelength)


class _Patterns:
    """The patterns of modulators with effects. nominal_opd_m: their nominal paths (frame, modulator, y, x), m."""

    nominal_opd_m: Tensor

    def __init__(self, plan: Plan, dtype: torch.dtype) -> None:
        self._transmissions, self._dtype = SampledTransmissions(plan, torch.empty(0)), dtype
        self._strokes_m = [modulator.stroke_m for modulator in plan.nominal.modulators]
        pairs = zip(plan.system.modulators, self._strokes_m, strict=True)
        self._factors = [modulator.stroke_m / nominal_m for modulator, nominal_m in pairs]

    def path_m(self, frame: int, modulator: int) -> Tensor:
        """Optical path (y, x) of a modulator's pixels, m, with the stroke that it really has."""
        return self.nominal_opd_m[frame, modulator] * self._factors[modulator]

    def is_sampled(self, modulator: int) -> bool:
        """Whether an effect changes a modulator so that its transmission isn't exp(2πi·opd/λ) of its pixels."""
        return self._transmissions.is_sampled(modulator)

    def transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor | None:
        """The transmission (y, x) of a modulator's samples; None if it is exp(2πi·opd/λ) of its pixels."""
        if not self.is_sampled(modulator):
            return None
        real, stroke_m = torch.empty(0, dtype=self._dtype).real.dtype, self._strokes_m[modulator]
        drive, before, first = ((self.nominal_opd_m[f, modulator] / stroke_m).to(real) for f in (frame, frame - 1, 0))
        return self._transmissions.transmission_for(drive, before, first, modulator, wavelength, self._dtype)


def make_forward_model(
    plan: Plan,
    *,
    device: str,
    double: bool = False,
    rows_at_a_time: int | None = None,
    kernels: Kernels,
    threads: int | None = None,
) -> ForwardModel:
    """The model of a plan: an `AutogradModel` if effects change the light of its modulators. Arguments as there."""
    strokes_m = [[m.stroke_m for m in system.modulators] for system in (plan.system, plan.nominal)]
    needs_autograd = plan.nominal.effects and (
        strokes_m[0] != strokes_m[1] or SampledTransmissions(plan, torch.empty(0)).is_any_sampled
    )
    model = AutogradModel if needs_autograd else ForwardModel
    return model(plan, double=double, device=device, rows_at_a_time=rows_at_a_time, kernels=kernels, threads=threads)
