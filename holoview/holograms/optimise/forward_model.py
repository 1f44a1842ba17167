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

The adjoint by hand costs this file, `propagation`, `beams` and `transfer_functions`. It saves processor time and
memory: by torch, autograd through the same bench (`autograd_model`) takes 1.2 to 1.3 times the time and 1.7 to 1.9
times the memory (93 → 156 MiB, 278 → 520 MiB; holochrome-8, 192 × 256 and 384 × 512 pixels, 5 planes, complex64, one
thread). Compiled passes (`compiled_model`) take less again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from itertools import groupby
from typing import TypeVar

import torch

from holoview.holograms.optimise.beams import (
    VECTOR,
    BeamFields,
    ColumnBlocks,
    SpectralAxis,
    block_bytes,
    group_beams,
    make_beam_fields,
    make_lines,
    slices,
    spectral_axes,
)
from holoview.holograms.optimise.kernels import TORCH_KERNELS, Kernels
from holoview.holograms.optimise.lasers import lit_lasers
from holoview.holograms.optimise.level_gradients import LevelSteps, secant_gradient
from holoview.holograms.optimise.parallel import MIN_SAMPLES_FOR_THREADS, ThreadTeam
from holoview.holograms.optimise.propagation import ModulatorLight, PlanePropagation
from holoview.holograms.optimise.transfer_functions import TransferFunctions
from holoview.holograms.optimise.wavelengths import BeamAdjoint, wavelength_derivative
from holoview.light.model.plan import Plan

Tensor = torch.Tensor
Result = TypeVar("Result")
_SMALL_FIELDS_BYTES = 1 << 23
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
    blocks that fit the cache, in several threads.
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
    ) -> None:
        self.device, self.kernels = torch.device(device), kernels
        self.complex_dtype = torch.complex128 if double else torch.complex64
        self.real_dtype = torch.float64 if double else torch.float32
        self.lasers = lit_lasers(plan)
        self.source_count = len(plan.slopes)
        self.has_second_modulator = plan.system.gap_m is not None
        self._rows_at_a_time, self._team = rows_at_a_time, ThreadTeam(self.device)
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
        self._block_bytes = limit = self._bytes_at_a_time(rows * columns, by_rows)
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

    def _bytes_at_a_time(self, samples: int, by_rows: bool) -> int:
        """Bytes of a block. Compiled passes take one beam after the other: all beams of fields for which one thread is
        enough are a block, so that Python calls less often."""
        is_small = by_rows and samples < MIN_SAMPLES_FOR_THREADS
        return _SMALL_FIELDS_BYTES if is_small else block_bytes(self.device)

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
        parts = self._team.map(
            lambda index: self._group_gradients(index, has_wavelengths, level_steps), range(len(self._fields))
        )
        for gradients, derivatives in parts:
            for frame, gradient in gradients:
                path_gradient[frame].add_(gradient)
            for wavelength, derivative in derivatives:
                assert wavelength_gradient is not None
                wavelength_gradient[wavelength] += derivative

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

    def _group_gradients(
        self, index: int, has_wavelengths: bool, level_steps: LevelSteps | None
    ) -> tuple[list[tuple[int, Tensor]], list[tuple[int, float]]]:
        """Parts of some beams: frames and ∂L/∂opd (modulator, y, x) of each, wavelengths and ∂L/∂λ of each."""
        fields, phasors = self._fields[index], self._phasors[index]
        incident_adjoint = None
        if has_wavelengths:
            y, x = (axis.gap.frequencies for axis in self.axes)
            incident_adjoint = self._lines.new_empty(*fields.group.shape, y, x)
        of_modulators = self._light.backpropagate(fields, phasors, incident_adjoint)
        if incident_adjoint is None and level_steps is None:
            return self._path_gradients(fields.group.lasers, of_modulators), []
        products, derivatives = torch.stack(of_modulators, dim=2), []
        if incident_adjoint is not None:
            derivatives = self._wavelength_derivatives(index, products, incident_adjoint)
        if level_steps is None:
            return self._path_gradients(fields.group.lasers, of_modulators), derivatives
        return self._secants(fields.group.lasers, products, level_steps), derivatives

    def _path_gradients(self, lasers: slice, products: Sequence[Tensor]) -> list[tuple[int, Tensor]]:
        """Frames and ∂L/∂opd (modulator, y, x) of each, from modulators' products c·w (laser, source, y, x)."""
        frames, factors, gradients = [frame for frame, _ in self.lasers[lasers]], self._path_factors[lasers], []
        for frame, members in groupby(range(len(frames)), frames.__getitem__):
            first, *others = members
            part = slice(first, first + 1 + len(others))
            gradient = factors.new_empty(len(products), *products[0].shape[2:])
            for product, out in zip(products, gradient, strict=True):
                self.kernels.sum_imaginary(product[part], factors[part], out)
            gradients.append((frame, gradient))
        return gradients

    def _secants(self, lasers: slice, products: Tensor, level_steps: LevelSteps) -> list[tuple[int, Tensor]]:
        """The secants in place of `_path_gradients`, from products c·w (laser, source, modulator, y, x)."""
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
