"""The parts of `propagation` by the compiled passes of `vector_kernels`: the same results, up to rounding.

Spectra, transfer functions and pixels lie row by row here (`by_rows` in `beams`), since neighbouring columns are
transformed side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from holoview.model.plan import Plan
from holoview.optics.slm import sum_pool
from holoview.optimise.beams import VECTOR, BeamFields, SpectralAxis, flat_view, padded_rows
from holoview.optimise.lasers import Laser
from holoview.optimise.propagation import ModulatorLight, PlanePropagation
from holoview.optimise.transfer_functions import TransferFunctions
from holoview.optimise.vector_fft import LANES, has_fft
from holoview.optimise.vector_kernels import (
    backpropagate_rows,
    evaluate_rows,
    gather_columns,
    line_to_band,
    line_to_window,
    modulate_rows,
    move_columns,
    plane_line,
    spread_columns,
    transform_columns,
    transform_rows,
)

Tensor = torch.Tensor
assert VECTOR == LANES


def fits_passes(axes: tuple[SpectralAxis, SpectralAxis]) -> bool:
    """Whether the passes compute a plan: lengths without factors above 5, and light that fills a vector."""
    lengths = [line.padded for axis in axes for line in (axis.pixels, axis.last)]
    counts = [n for axis in axes for n in (axis.last.count, axis.last.frequencies, axis.gap.frequencies)]
    return all(map(has_fft, lengths)) and min(counts) >= LANES


class CompiledModulatorLight(ModulatorLight):
    """`ModulatorLight` in compiled passes, for one source; with several sources the spectra of a pixel's shape
    differ."""

    def __init__(self, plan: Plan, lasers: Sequence[Laser], transfer_functions: TransferFunctions) -> None:
        super().__init__(plan, lasers, transfer_functions)
        y, x = self.axes
        double = transfer_functions.dtype == torch.complex128

        def both(axis: Any, forward: bool) -> tuple[Any, Any]:
            options = {"forward": forward, "double": double}
            return line_to_band(axis, **options), line_to_window(axis, **options)

        self._pixels_y, self._pixels_x = both(y.pixels, True), both(x.pixels, True)
        self._gap_y, self._gap_x = both(y.gap, False), both(x.gap, False)
        self._last_y, self._last_x = both(y.last, True), both(x.last, True)
        self._number = np.float64 if double else np.float32
        self._widths = (x.pixels.frequencies, x.gap.frequencies)

    def compute_spectra(self, fields: BeamFields, opd_m: Tensor) -> list[Tensor]:
        """As there."""
        if self.transfer_functions.pixel_shapes is not None:
            return super().compute_spectra(fields, opd_m)
        phasors = [_padded(pixels) for pixels in self._phasors(fields, opd_m)]
        light, beams, (y, x) = self._illuminated(fields.group, phasors[0]), fields.group.shape, self.axes
        lines = padded_rows(*beams, y.pixels.count, x.pixels.frequencies, like=light)
        transform_rows(*_view(_padded(light)), *_view(lines), (*beams, y.pixels.count), self._pixels_x[0])
        spectra = fields.spectra.blocks[0]
        target, transforms = (spectra, False) if fields.gap_lines is None else (fields.gap_lines, True)
        scale = self._number(1 / y.gap.padded)
        ways = (self._pixels_y[0], self._gap_y[1], scale)
        factors = self._factors(fields)
        spread_columns(*_view(lines), *factors, *_view(target), transforms, beams, self._widths, *ways)
        if fields.gap_lines is None:
            return phasors
        shape, scale = (*beams, y.last.count), self._number(1 / x.gap.padded)
        views = (*_view(fields.gap_lines), *_view(fields.plane_lines), *_view(phasors[1]))
        modulate_rows(*views, self.plan.grid.upsample, shape, self._gap_x[1], self._last_x[0], scale)
        one, columns = self._number(1), x.last.frequencies
        transform_columns(*_view(fields.plane_lines), *_view(spectra), beams, columns, self._last_y[0], one)
        return phasors

    def backpropagate(
        self, fields: BeamFields, phasors: Sequence[Tensor], incident_adjoint: Tensor | None = None
    ) -> list[Tensor]:
        """As there."""
        if self.transfer_functions.pixel_shapes is not None or incident_adjoint is not None:
            return super().backpropagate(fields, phasors, incident_adjoint)
        (y, x), beams, later = self.axes, fields.group.shape, []
        if fields.gap_lines is not None:
            later.append(self._backpropagate_second_modulator(fields, phasors[1]))
        source = fields.adjoint_spectra.blocks[0] if fields.gap_lines is None else fields.gap_lines
        lines = padded_rows(*beams, y.pixels.count, x.pixels.frequencies, like=source)
        ways = (self._gap_y[0], self._pixels_y[1], self._number(1 / y.gap.padded))
        transforms = fields.gap_lines is not None
        gather_columns(*_view(source), transforms, *self._factors(fields), *_view(lines), beams, self._widths, *ways)
        pixels = padded_rows(*beams, y.pixels.count, x.pixels.count, like=source)
        transform_rows(*_view(lines), *_view(pixels), (*beams, y.pixels.count), self._pixels_x[1])
        return [sum_pool(pixels.mul_(self._illuminated(fields.group, phasors[0])), self._repeats), *later]

    def _backpropagate_second_modulator(self, fields: BeamFields, pixels: Tensor) -> Tensor:
        if self.transfer_functions.pixel_shapes is not None:
            return super()._backpropagate_second_modulator(fields, pixels)
        assert fields.gap_lines is not None
        (y, x), beams = self.axes, fields.group.shape
        adjoints, columns, one = fields.adjoint_spectra.blocks[0], x.last.frequencies, self._number(1)
        transform_columns(*_view(adjoints), *_view(fields.plane_lines), beams, columns, self._last_y[1], one)
        products = padded_rows(*beams, *pixels.shape[1:], like=adjoints)
        shape, scale = (*beams, y.last.count), self._number(1 / x.gap.padded)
        views = (*_view(fields.gap_lines), *_view(fields.plane_lines), *_view(pixels))
        ways = (self._gap_x[1], self._last_x[1], self._gap_x[0], scale)
        backpropagate_rows(*views, self.plan.grid.upsample, shape, *ways, *_view(products))
        return products

    def _factors(self, fields: BeamFields) -> tuple[Any, tuple[int, ...]]:
        """B·H_gap of the group's lasers (laser, k_y, tile, k_x)."""
        storage = self.transfer_functions.gap_storage
        assert storage is not None
        return _view(storage[fields.group.wavelengths])


class CompiledPlanePropagation(PlanePropagation):
    """`PlanePropagation` in compiled passes."""

    evaluates_lines = True

    def __init__(self, axes: tuple[SpectralAxis, SpectralAxis], dtype: torch.dtype) -> None:
        super().__init__(axes)
        self._lines = [plane_line(axis.last, double=dtype == torch.complex128) for axis in axes]
        self._number = np.float64 if dtype == torch.complex128 else np.float32

    def move(
        self, fields: BeamFields, block: int, transfers: TransferFunctions, before: int | None, after: int | None
    ) -> None:
        """Carries a block of columns back from a plane and on to the next, in one pass."""
        stored, does = transfers.planes[block][fields.group.wavelengths], (before is not None, after is not None)
        first, second = (stored[:, 0 if plane is None else plane] for plane in (before, after))
        move_columns(
            *_view(fields.plane_lines),
            _view(fields.spectra.blocks[block])[0],
            *_view(fields.adjoint_spectra.blocks[block]),
            *_view(first),
            *_view(second),
            transfers.plane_rows.numpy(),
            does,
            fields.group.shape,
            self._x.frequencies,
            self._lines[0],
        )

    def evaluate_rows(
        self,
        lines: Tensor,
        weights: Tensor,
        target: Tensor,
        factor: float,
        picture: Tensor | None,
        *,
        carry_back: bool,
    ) -> tuple[Tensor, Tensor]:
        """As there."""
        norms = weights.new_empty(2)
        wants = (carry_back, picture is not None)
        views = (*_view(target), self._number(factor), *_view(target if picture is None else picture))
        rows, beams = lines.shape[2], tuple(lines.shape[:2])
        evaluate_rows(
            *_view(lines), rows, beams, self._lines[1], weights.contiguous().numpy(), *views, wants, norms.numpy()
        )
        return norms[0], norms[1]


def _view(values: Tensor) -> tuple[Any, tuple[int, ...]]:
    """The flat array and the strides of all axes but the last."""
    flat, _, strides = flat_view(values)
    return flat, strides


def _padded(values: Tensor) -> Tensor:
    """Values whose rows are followed by zeros; the values themselves if they are stored like that."""
    room = padded_rows(*values.shape, like=values)
    return room.copy_(values)
