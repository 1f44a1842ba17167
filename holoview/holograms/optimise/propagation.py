"""From the modulators' pixels to the spectra behind the last one, to a focal plane, to its image, and back; by torch.

`ModulatorLight`     from the pixels to the spectra
`PlanePropagation`   from the spectra to the fields at a plane
`Kernels`            from these fields to the image

`forward_model` has the equations, `compiled_model` the same in compiled passes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.beams import (
    BeamFields,
    BeamGroup,
    SpectralAxis,
    TransferFunctions,
    ZeroTails,
    block_bytes,
    samples_a_pixel,
    slices,
)
from holoview.holograms.optimise.chain_executor import ChainExecutor, dark_inputs
from holoview.holograms.optimise.lasers import Laser
from holoview.light.model.plan import Plan
from holoview.light.numerics.resample import upsample_nearest
from holoview.light.optics.slm import phasor, sum_pool

Tensor = torch.Tensor
Result = TypeVar("Result")


class ModulatorLight:
    """From the pixels of the modulators to the spectra behind the last one, and back to gradients of the pixels.

        V = B·H_gap·F[s·p₁],  w = [F⁻¹V]·p₂,  W = F w          (one modulator: W = V)
        c_w = F c_W,  ∂L/∂opd₂ = −(2π/λ)·Im(c_w·w),  c_V = F⁻¹(c_w·p₂),  ∂L/∂opd₁ = −(2π/λ)·Im(s·p₁·F[B·H_gap·c_V])

    with products c·w summed over the samples of each pixel. Transforms along x and along y alternate. Those along x,
    and all operations between two of them, pass over blocks of rows, those along y over blocks of columns, so that a
    block stays in the cache from its first operation to its last.
    """

    def __init__(self, plan: Plan, lasers: Sequence[Laser], transfer_functions: TransferFunctions) -> None:
        self.plan, self.lasers, self.axes = plan, lasers, transfer_functions.axes
        self.transfer_functions = transfer_functions
        self._repeats = plan.grid.upsample // samples_a_pixel(plan)
        self._wavelengths_m = torch.empty(0)

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
        chosen, dtype = fields.group.lasers, fields.plane_lines.dtype
        λ = self._wavelengths_of_lasers(opd_m)[chosen, None, None]
        paths_m = torch.stack([opd_m[frame] for frame, _ in self.lasers[chosen]], dim=1)
        return [phasor(path_m, λ, dtype) for path_m in paths_m]

    def _wavelengths_of_lasers(self, like: Tensor) -> Tensor:
        """The wavelength (laser,) of each laser, m, copied to the device once."""
        if self._wavelengths_m.dtype != like.dtype or len(self._wavelengths_m) != len(self.lasers):
            self._wavelengths_m = torch.from_numpy(self.plan.system.wavelengths_m[[λ for _, λ in self.lasers]]).to(like)
        return self._wavelengths_m

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
    """From the spectra behind the last modulator to the fields at a focal plane, and back; repeated for every plane.

        E = [F⁻¹ H W],  c_W += H·F⁻¹c_E

    Both ways are a multiplication by H, an FFT along y in blocks of columns, and an FFT along x in blocks of rows. The
    band lies at the first bins of the FFT, with the padding zeros behind it. Transfer functions contain 1/(P_y·P_x), so
    that inverse FFTs aren't normalised.
    """

    evaluates_lines = False
    """Whether `evaluate_rows`, which goes from lines to the loss and back in one pass, is implemented."""

    def __init__(self, axes: tuple[SpectralAxis, SpectralAxis]) -> None:
        self._y, self._x = (axis.last for axis in axes)
        assert self._y.lowest == self._x.lowest == 0
        self._zero_tails = ZeroTails()

    def move(
        self, fields: BeamFields, block: int, transfers: TransferFunctions, before: int | None, after: int | None
    ) -> None:
        """Carries a block of columns back from a plane, and on to another, where these are given."""
        if before is not None:
            self.carry_back(fields, block, transfers.of_plane(block, fields.group.wavelengths, before)[:, None])
        if after is not None:
            self.to_plane(fields, block, transfers.of_plane(block, fields.group.wavelengths, after)[:, None])

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

    def evaluate_rows(
        self,
        lines: Tensor,
        rows: slice,
        weights: Tensor,
        target: Tensor,
        factor: float,
        picture: Tensor | None,
        *,
        carry_back: bool,
        correlates: bool = False,
    ) -> tuple[Tensor, NDArray[np.float64]]:
        """Compares rows of a plane with their target; carry_back: replaces their lines by those of c_E.

        lines (laser, source, y, k_x). weights (beam, channel). target (channel, y, x). factor: of image − target in
        ∂L/∂image. picture (channel, y, x): where to write the image. Returns the two norms
        of `Kernels.replace_by_residual` and, if correlates, sums over samples (beam, beam and channel) of products of
        intensities I_i·I_j, for j ≥ i, and I_i·target_c.
        """
        raise AssertionError("`evaluates_lines` is False")

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


class Kernels:
    """From the fields of a plane (laser, source, row, x), complex, to its image and back, by torch. name: of these."""

    name = "torch"

    def has_passes(self, axes: tuple[SpectralAxis, SpectralAxis]) -> bool:
        """Whether compiled passes do the transforms along these axes, and the operations between them."""
        return False

    def chain_executor(self, plan: Plan, *, double: bool, device: str) -> ChainExecutor:
        """The stages of a chain."""
        return ChainExecutor(plan, dark_inputs(plan), double=double, device=device)

    def mix(self, fields: Tensor, weights: Tensor) -> Tensor:
        """The image (channel, row, x) Σ weight·|E|². weights (beam, channel): of each laser from each source."""
        squares = torch.view_as_real(fields.movedim(2, 0)).square().flatten(1, 2).flatten(2)
        products = weights.T @ squares
        pairs = products.view(*products.shape[:-1], -1, 2)
        return (pairs[..., 0] + pairs[..., 1]).movedim(1, 0)

    def replace_by_adjoint(self, fields: Tensor, weights: Tensor, slopes: Tensor) -> None:
        """Replaces fields E by c_E = 2·g·conj(E), with g the slopes weighted for each beam.

        weights (beam, channel). slopes (channel, row, x): ∂L/∂image.
        """
        # g·(1 − i): pairs (g, −g) for the real and the imaginary part of conj(E)
        pairs = torch.view_as_real(slopes.movedim(1, 0).to(fields.dtype) * (1 - 1j)).flatten(2)
        parts = torch.view_as_real(fields.movedim(2, 0))
        parts.mul_(((2 * weights) @ pairs).view(parts.shape))

    def add_imaginary(self, products: Tensor, factors: Tensor, out: Tensor) -> None:
        """Adds Σ factor·Im(product), (y, x). products (laser, source, y, x). factors (laser,)."""
        out.add_(torch.sum(products.imag * factors[:, None, None, None], dim=(0, 1)))

    def replace_by_residual(self, image: Tensor, target: Tensor, factor: float) -> tuple[Tensor, Tensor]:
        """Replaces an image (channel, row, x) by factor·(image − target).

        Returns two norms: of image − target, and of the same difference with both clipped to 0…1.
        """
        error_norm = torch.linalg.vector_norm(image.clamp(0, 1).sub_(target.clamp(0, 1)))
        residual_norm = torch.linalg.vector_norm(image.sub_(target))
        image.mul_(factor)
        return residual_norm, error_norm


TORCH_KERNELS = Kernels()
"""The reference."""
