"""Wave propagation from patterns to intensities at each focal plane, and its hand-written adjoint.

A beam is one laser of one frame from one source direction. With the FFT F, the modulators' pixels
p_m = exp(2πi·opd_m/λ), the illumination s, the spectrum B of a pixel's shape, the transfer functions H, and brackets
for what lies on the modulator's area:

    V = B·H_gap·F[s·p₁],  w = [F⁻¹V]·p₂,  W = F w,  E_k = [F⁻¹ H_k W],  I_k = |E_k|²          (one modulator: W = V)

Only frequencies that pass the relays' stops are computed (`beams.SpectralAxis`). The first FFT is one of pixels, not of
samples: the spectrum of an upsampled pattern is that of its pixels, repeated.

The adjoint carries conjugate gradients c, defined by dL = Re Σ c·dx, from the planes back to the modulators. They need
the H themselves where gradients would need their conjugates:

    c_E = ∂L/∂I·conj(E)·2,  c_W = Σ_k H_k·F⁻¹c_E,  and from there on as `ModulatorLight` says

An evaluation calls `forward` once, `process_planes`, and at last `accumulate_gradients`. Planes come one after the
other, so that the fields of only one are in memory. The loss at a sample depends on the fields at this sample only, so
that a plane is processed in blocks of rows: transformed along x, compared with the target and transformed back while
the block is in the cache. A structural loss takes a whole plane as one block.

The adjoint by hand costs this file, `beams` and `transfer_functions`. It saves processor time and memory: autograd
through the same bench (`autograd_model`) takes 1.2 to 1.3 times the time (0.24 s → 0.31 s, 1.04 s → 1.33 s) and 1.7 to
1.9 times the memory (93 → 156 MiB, 278 → 520 MiB; holochrome-8, 192 × 256 and 384 × 512 pixels, 5 planes, complex64,
one thread, medians of 7 runs in turn of an evaluation with its gradient).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import TypeVar

import torch

from holoview.model.plan import Plan
from holoview.numerics.resample import upsample_nearest
from holoview.optics.slm import phasor, sum_pool
from holoview.optimise.beams import (
    BeamFields,
    BeamGroup,
    ColumnBlocks,
    SpectralAxis,
    ZeroTails,
    block_bytes,
    group_beams,
    make_beam_fields,
    make_lines,
    samples_a_pixel,
    slices,
    spectral_axes,
)
from holoview.optimise.kernels import TORCH_KERNELS, Kernels
from holoview.optimise.lasers import Laser, lit_lasers
from holoview.optimise.level_gradients import LevelSteps, secant_gradient
from holoview.optimise.parallel import ThreadTeam
from holoview.optimise.transfer_functions import TransferFunctions
from holoview.optimise.wavelengths import BeamAdjoint, wavelength_derivative

Tensor = torch.Tensor
Result = TypeVar("Result")
ProcessRows = Callable[[int, slice, Tensor], Result]
"""Is given a plane, rows and the fields E (laser, source, row, x) there; replaces these by c_E to carry them back."""


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
        limit, number_bytes, (rows, columns) = block_bytes(self.device), self.complex_dtype.itemsize, plan.grid.padded
        self.transfer_functions = TransferFunctions(
            plan, self.axes, max(1, limit // (rows * number_bytes)), self.complex_dtype, self.device
        )
        wavelengths = self.transfer_functions.wavelengths
        groups = group_beams(self.lasers, wavelengths, self.source_count, rows * columns * number_bytes, limit)
        beams, frequencies = (len(self.lasers), self.source_count), self.axes[1].last.frequencies
        self._lines = make_lines(beams, plan.grid.shape[0], frequencies, self.complex_dtype, self.device)
        blocks = self.transfer_functions.columns
        self._fields = [
            make_beam_fields(group, self.axes, blocks, self._lines, self.has_second_modulator) for group in groups
        ]
        self._light = ModulatorLight(plan, self.lasers, self.transfer_functions)
        self._propagation = PlanePropagation(self.axes)

    def set_eyes(self, plan: Plan) -> None:
        """Changes to a plan whose planes are seen from other places of the pupil (`Plan.seen_from`)."""
        self.plan = plan
        self.transfer_functions.set_eyes(plan)

    def spectrum(self, laser: int, source: int) -> ColumnBlocks:
        """W of a beam, (k_y, k_x) at the frequencies of `axes`; what is written to it is used from then on."""
        return self._of_beam(laser, source, [fields.spectra for fields in self._fields])

    def adjoint_spectrum(self, laser: int, source: int) -> ColumnBlocks:
        """c_W of a beam, as `spectrum`."""
        return self._of_beam(laser, source, [fields.adjoint_spectra for fields in self._fields])

    def forward(self, opd_m: Tensor, *, wavelength_gradient: bool = False) -> None:
        """Computes the spectra behind the last modulator for optical paths (frame, modulator, y, x), m.

        wavelength_gradient: also prepare what `accumulate_gradients` needs for the gradient of the wavelengths.
        """
        self.opd_m = opd_m
        self._phasors = self._team.map(lambda fields: self._light.compute_spectra(fields, opd_m), self._fields)
        self._clear_adjoints(wavelength_gradient)

    def process_planes(
        self, planes: Sequence[int], process_rows: ProcessRows[Result], *, carry_back: bool
    ) -> list[list[Result]]:
        """Calls a function with the fields at each plane, block by block of rows.

        Returns its results for each plane, from top to bottom. carry_back: the function leaves c_E in place of the
        fields, whose part in c_W is then added.
        """
        blocks = [(i, block) for i in range(len(self._fields)) for block in range(len(self.transfer_functions.columns))]
        results, before = [], None
        for plane in planes:
            self._team.map(partial(self._process_columns, before, plane), blocks)
            results.append(self._process_rows(plane, process_rows, carry_back))
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
        for fields, (gradients, derivatives) in zip(self._fields, parts, strict=True):
            for i, (frame, _) in enumerate(self.lasers[fields.group.lasers]):
                path_gradient[frame].add_(gradients[i])
            for wavelength, derivative in derivatives:
                assert wavelength_gradient is not None
                wavelength_gradient[wavelength] += derivative

    def carrier(self) -> Tensor:
        """The plane wave (y, x) that all fields E contain beside the light's own phase: their spectra are displaced."""
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
        """Carries a block of columns back from the plane before and on to the next one, if there are these planes."""
        index, block = chosen
        fields, transfers = self._fields[index], self.transfer_functions.planes[block]
        wavelengths = fields.group.wavelengths
        if before is not None:
            adjoint = self._propagation.carry_back(fields, block, transfers[wavelengths, before, None])
            if self._z_weighted_adjoints:
                z_m = float(self.plan.planes_m[before])
                weighted = self._z_weighted_adjoints[index].blocks[block]
                weighted.addcmul_(adjoint, transfers[wavelengths, before, None], value=z_m)
        if plane is not None:
            self._propagation.to_plane(fields, block, transfers[wavelengths, plane, None])

    def _process_rows(self, plane: int, process_rows: ProcessRows[Result], carry_back: bool) -> list[Result]:
        def process(rows: slice) -> Result:
            return self._propagation.process_rows(
                self._lines[:, :, rows], lambda fields: process_rows(plane, rows, fields), carry_back=carry_back
            )

        total = self.plan.grid.shape[0]
        if self._rows_at_a_time is not None:
            return [process(rows) for rows in slices(total, self._rows_at_a_time)]
        row_bytes = len(self.lasers) * self.source_count * self.plan.grid.padded[1] * self.complex_dtype.itemsize
        return self._team.map(process, slices(total, block_bytes(self.device) // row_bytes))

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
    ) -> tuple[Tensor, list[tuple[int, float]]]:
        """∂L/∂opd (laser, modulator, y, x) through some beams, and ∂L/∂λ of each: its wavelength and the derivative."""
        fields, phasors = self._fields[index], self._phasors[index]
        incident_adjoint = None
        if has_wavelengths:
            y, x = (axis.gap.frequencies for axis in self.axes)
            incident_adjoint = self._lines.new_empty(*fields.group.shape, y, x)
        products = torch.stack(self._light.backpropagate(fields, phasors, incident_adjoint), dim=2)
        derivatives = []
        if incident_adjoint is not None:
            derivatives = self._wavelength_derivatives(index, products, incident_adjoint)
        return self._path_gradients(fields.group.lasers, products, level_steps), derivatives

    def _path_gradients(self, lasers: slice, products: Tensor, level_steps: LevelSteps | None) -> Tensor:
        """∂L/∂opd (laser, modulator, y, x) or its secant, from products c·w (laser, source, modulator, y, x)."""
        share = products.shape[1] / self.source_count
        products, gradients = products.sum(dim=1), []
        for laser, product in zip(range(lasers.start, lasers.stop), products, strict=True):
            frame, wavelength = self.lasers[laser]
            λ = float(self.plan.system.wavelengths_m[wavelength])
            if level_steps is None:
                gradients.append(product.imag * (-2 * math.pi / λ))
                continue
            curvatures = (level_steps.curvature[laser] * share).tolist()
            steps = zip(product, level_steps.path_m[frame], curvatures, strict=True)
            gradients.append(torch.stack([secant_gradient(p, step_m, λ, κ) for p, step_m, κ in steps]))
        return torch.stack(gradients)

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


class ModulatorLight:
    """From the pixels of the modulators to the spectra behind the last one, and back to gradients of the pixels.

        V = B·H_gap·F[s·p₁],  w = [F⁻¹V]·p₂,  W = F w          (one modulator: W = V)
        c_w = F c_W,  ∂L/∂opd₂ = −(2π/λ)·Im(c_w·w),  c_V = F⁻¹(c_w·p₂),  ∂L/∂opd₁ = −(2π/λ)·Im(s·p₁·F[B·H_gap·c_V])

    with products c·w summed over the samples of each pixel. Transforms along x and along y alternate: those along x,
    and all that lies between two of them, pass over blocks of rows, those along y over blocks of columns, so that a
    block stays in the cache from its first operation to its last.
    """

    def __init__(self, plan: Plan, lasers: Sequence[Laser], transfer_functions: TransferFunctions) -> None:
        self.plan, self.lasers, self.axes = plan, lasers, transfer_functions.axes
        self.transfer_functions = transfer_functions
        self._repeats = plan.grid.upsample // samples_a_pixel(plan)

    def compute_spectra(self, fields: BeamFields, opd_m: Tensor) -> list[Tensor]:
        """Writes W of some beams for optical paths (frame, modulator, y, x), m.

        Returns the modulators' pixels p, (laser, y, x) complex each.
        """
        phasors = self._phasors(fields, opd_m)
        incident = self._incident_columns(fields.group, phasors[0])
        y, x = self.axes
        if fields.gap_lines is None:  # the blocks are then those of the last band
            for columns, spectrum in incident:
                fields.spectra.write(columns, spectrum)
            return phasors
        for columns, spectrum in incident:
            fields.gap_lines[..., columns] = y.gap.inverse(spectrum.mT, -1).mT
        for rows, pixel_rows in self._row_blocks(fields):
            field = x.gap.inverse(fields.gap_lines[..., rows, :], -1)
            self._modulate(field, phasors[1][:, pixel_rows])
            fields.plane_lines[..., rows, :] = x.last.forward(field, -1)
        for columns, spectrum in zip(fields.spectra.columns, fields.spectra.blocks, strict=True):
            spectrum.copy_(y.last.forward(fields.plane_lines[..., columns].mT, -1).mT)
        return phasors

    def incident_spectra(self, fields: BeamFields, first_pixels: Tensor) -> Tensor:
        """V of some beams, (laser, source, k_y, k_x) in the gap's band."""
        y, x = self.axes
        spectra = fields.plane_lines.new_empty(*fields.group.shape, y.gap.frequencies, x.gap.frequencies)
        for columns, incident in self._incident_columns(fields.group, first_pixels):
            spectra[..., columns] = incident
        return spectra

    def backpropagate(
        self, fields: BeamFields, phasors: Sequence[Tensor], incident_adjoint: Tensor | None = None
    ) -> list[Tensor]:
        """Products c·w of each modulator, summed over the samples of a pixel, (laser, source, y, x).

        Overwrites the lines of these beams. incident_adjoint: where to write c_V.
        """
        later_products = []
        if fields.gap_lines is not None:
            later_products.append(self._backpropagate_second_modulator(fields, phasors[1]))
        lines = self._backpropagate_columns(fields, incident_adjoint)
        pixels = self.axes[1].pixels.forward_transposed(lines, -1)
        pixels = pixels.mul_(self._illuminated(fields.group, phasors[0]))
        return [sum_pool(pixels, self._repeats), *later_products]

    # --- modulator 1 and the gap ------------------------------------------------------------------------------------

    def _phasors(self, fields: BeamFields, opd_m: Tensor) -> list[Tensor]:
        """exp(2πi·opd/λ) of each modulator's pixels, (laser, y, x)."""
        lasers = self.lasers[fields.group.lasers]
        λ = torch.from_numpy(self.plan.system.wavelengths_m[[λ for _, λ in lasers]]).to(opd_m)[:, None, None]
        frames = [frame for frame, _ in lasers]
        return [phasor(opd_m[frames, m], λ, fields.plane_lines.dtype) for m in range(opd_m.shape[1])]

    def _illuminated(self, group: BeamGroup, pixels: Tensor) -> Tensor:
        """The light behind the first modulator's pixels, (laser, source, y, x)."""
        light = upsample_nearest(pixels, self._repeats)[:, None] if self._repeats > 1 else pixels[:, None]
        if self.transfer_functions.illumination is None:
            return light.expand(-1, group.shape[1], -1, -1)
        y, x = (wave[group.wavelengths, group.sources] for wave in self.transfer_functions.illumination)
        return light * y[..., None] * x[..., None, :]

    def _incident_columns(self, group: BeamGroup, first_pixels: Tensor) -> Iterator[tuple[slice, Tensor]]:
        """V of some beams in blocks of columns, (laser, source, k_y, column)."""
        y, x = self.axes
        lines = x.pixels.forward(self._illuminated(group, first_pixels), -1)
        factors = iter(self.transfer_functions.gap)
        for part, tiles in self.transfer_functions.gap_tiles:
            spectrum = y.pixels.forward(lines[..., part].mT, -1).mT
            for columns, entries in tiles:
                factor = next(factors)[group.wavelengths, None]
                incident = spectrum.new_empty(*group.shape, columns.stop - columns.start, y.gap.frequencies).mT
                for rows, row_entries in y.tiles:
                    source = spectrum[..., row_entries, entries]
                    torch.mul(source, factor[..., rows, :], out=incident[..., rows, :])
                yield columns, self._times_pixel_shape(incident, group, columns)

    def _times_pixel_shape(self, spectrum: Tensor, group: BeamGroup, columns: slice) -> Tensor:
        """Columns of a spectrum times B, in place, unless the transfer functions contain it."""
        if self.transfer_functions.pixel_shapes is None:
            return spectrum
        y, x = (shape[group.wavelengths, group.sources] for shape in self.transfer_functions.pixel_shapes)
        return spectrum.mul_(y[..., None]).mul_(x[..., None, columns])

    def _backpropagate_columns(self, fields: BeamFields, incident_adjoint: Tensor | None) -> Tensor:
        """Conjugate gradients of the pixels of modulator 1, transformed along x, (laser, source, y, k_x)."""
        (y, x), group = self.axes, fields.group
        lines = fields.plane_lines.new_empty(*group.shape, y.pixels.count, x.pixels.frequencies)
        factors = iter(self.transfer_functions.gap)
        for part, tiles in self.transfer_functions.gap_tiles:
            folded = lines.new_zeros(*group.shape, part.stop - part.start, y.pixels.frequencies).mT
            for columns, entries in tiles:
                if fields.gap_lines is None:
                    adjoint = fields.adjoint_spectra.read(columns)
                else:
                    adjoint = y.gap.inverse_transposed(fields.gap_lines[..., columns].mT, -1).mT
                if incident_adjoint is not None:
                    incident_adjoint[..., columns] = adjoint
                product = self._times_pixel_shape(adjoint * next(factors)[group.wavelengths, None], group, columns)
                for rows, row_entries in y.tiles:
                    folded[..., row_entries, entries] += product[..., rows, :]
            lines[..., part] = y.pixels.forward_transposed(folded.mT, -1).mT
        return lines

    # --- modulator 2 ------------------------------------------------------------------------------------------------

    def _backpropagate_second_modulator(self, fields: BeamFields, pixels: Tensor) -> Tensor:
        """Products c·w of modulator 2, (laser, source, y, x); the lines in the gap become those of c_V."""
        assert fields.gap_lines is not None
        (y, x), lines = self.axes, fields.plane_lines
        for columns, spectrum in zip(fields.adjoint_spectra.columns, fields.adjoint_spectra.blocks, strict=True):
            lines[..., columns] = y.last.forward_transposed(spectrum.mT, -1).mT
        products = lines.new_empty(*fields.group.shape, *pixels.shape[1:])
        for rows, pixel_rows in self._row_blocks(fields):
            gap_rows = fields.gap_lines[..., rows, :]
            field = x.gap.inverse(gap_rows, -1)
            adjoint = x.last.forward_transposed(lines[..., rows, :], -1)
            products[..., pixel_rows, :] = sum_pool(field.mul_(adjoint), self.plan.grid.upsample)
            self._modulate(adjoint, pixels[:, pixel_rows])
            gap_rows.copy_(x.gap.inverse_transposed(adjoint, -1))
        return products.mul_(pixels[:, None])

    def _modulate(self, field: Tensor, pixels: Tensor) -> None:
        """Multiplies rows of a field (laser, source, y, x) by a modulator's pixels (laser, y, x), in place."""
        upsample = self.plan.grid.upsample
        pixel_rows = pixels.repeat_interleave(upsample, dim=-1)[:, None, :, None, :]
        field.view(*field.shape[:2], -1, upsample, field.shape[-1]).mul_(pixel_rows)

    def _row_blocks(self, fields: BeamFields) -> list[tuple[slice, slice]]:
        """Blocks of rows of samples, and their rows of pixels."""
        upsample, lines = self.plan.grid.upsample, fields.plane_lines
        row_bytes = math.prod(fields.group.shape) * self.plan.grid.padded[1] * lines.element_size()
        pixel_rows = slices(lines.shape[-2] // upsample, block_bytes(lines.device) // (row_bytes * upsample))
        return [(slice(p.start * upsample, p.stop * upsample), p) for p in pixel_rows]


class PlanePropagation:
    """From the spectra behind the last modulator to the fields at a focal plane, and back: the part that planes repeat.

        E = [F⁻¹ H W],  c_W += H·F⁻¹c_E

    Both ways are a multiplication by H, an FFT along y in blocks of columns, and one along x in blocks of rows. The
    band lies at the first bins of the FFT, so that the zeros that pad it lie behind it. Transfer functions contain
    1/(P_y·P_x), so that inverse FFTs aren't normalised.
    """

    def __init__(self, axes: tuple[SpectralAxis, SpectralAxis]) -> None:
        self._y, self._x = (axis.last for axis in axes)
        assert self._y.lowest == self._x.lowest == 0
        self._zero_tails = ZeroTails()

    def to_plane(self, fields: BeamFields, block: int, transfer: Tensor) -> None:
        """Writes a block of columns of a plane's lines. transfer (laser, 1, k_y, k_x): H in this block."""
        spectrum = fields.spectra.blocks[block]
        padded = self._zero_tails.buffer(spectrum, -2, self._y.padded)
        torch.mul(spectrum, transfer, out=padded.narrow(-2, 0, self._y.frequencies))
        lines = fields.plane_lines[..., fields.spectra.columns[block]]
        lines.copy_(_inverse_fft(padded, -2).narrow(-2, 0, self._y.count))

    def carry_back(self, fields: BeamFields, block: int, transfer: Tensor) -> Tensor:
        """Adds a plane's part to a block of columns of c_W. Returns that part without H."""
        lines = fields.plane_lines[..., fields.spectra.columns[block]]
        padded = self._zero_tails.buffer(lines, -2, self._y.padded)
        padded.narrow(-2, 0, self._y.count).copy_(lines)
        adjoint = _inverse_fft(padded, -2).narrow(-2, 0, self._y.frequencies)
        fields.adjoint_spectra.blocks[block].addcmul_(adjoint, transfer)
        return adjoint

    def process_rows(self, lines: Tensor, process: Callable[[Tensor], Result], *, carry_back: bool) -> Result:
        """Calls a function with the fields of lines (laser, source, row, k_x); carry_back: back to lines again."""
        rows = lines.movedim(2, 0)  # as they are stored
        padded = rows
        if self._x.frequencies < self._x.padded:
            padded = self._zero_tails.buffer(rows, -1, self._x.padded)
            padded.narrow(-1, 0, self._x.frequencies).copy_(rows)
        whole = _inverse_fft(padded, -1)
        result = process(whole.narrow(-1, 0, self._x.count).movedim(0, 2))
        if carry_back:
            whole.narrow(-1, self._x.count, self._x.padded - self._x.count).zero_()
            rows.copy_(_inverse_fft(whole, -1).narrow(-1, 0, self._x.frequencies))
        return result


def _inverse_fft(values: Tensor, dim: int) -> Tensor:
    """Σ_k X_k·exp(2πi·k·n/P), which is its own transpose; no lines give no lines."""
    return torch.fft.ifft(values, dim=dim, norm="forward") if values.numel() else values.clone()
