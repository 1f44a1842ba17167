"""The parts of `propagation`, by the compiled passes of `vector_kernels`: the same results, up to rounding.

Spectra, transfer functions and pixels lie row by row here (`by_rows` in `beams`), since neighbouring columns are
transformed side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.beams import (
    VECTOR,
    BeamFields,
    FlatView,
    KeptRows,
    KeptViews,
    Rows,
    SpectralAxis,
    TransferFunctions,
    flat_view,
    make_rows,
    strided_view,
)
from holoview.holograms.optimise.chain_executor import ChainExecutor, dark_inputs
from holoview.holograms.optimise.compiled_chain import CompiledChain, fits_chain_passes
from holoview.holograms.optimise.lasers import Laser
from holoview.holograms.optimise.propagation import Kernels, ModulatorLight, PlanePropagation
from holoview.holograms.optimise.vector_fft import LANES, has_fft
from holoview.holograms.optimise.vector_kernels import (
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
    write_phasors,
)
from holoview.light.model.plan import Plan
from holoview.light.optics.slm import sum_pool
from holoview.util.packages import compiled

Tensor = torch.Tensor
Floats = NDArray[np.float64]
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
        self._kept = KeptRows(torch.empty(0, dtype=transfer_functions.dtype))
        self._pixels: dict[tuple[int, int], list[Rows]] = {}

    def compute_spectra(self, fields: BeamFields, opd_m: Tensor) -> list[Tensor]:
        """As there."""
        if self.transfer_functions.pixel_shapes is not None:
            return super().compute_spectra(fields, opd_m)
        phasors, beams, (y, x) = self._phasors(fields, opd_m), fields.group.shape, self.axes
        pixels = self._pixels_of(fields)
        lines = self._kept.of("lines", *beams, y.pixels.count, x.pixels.frequencies).flat
        transform_rows(*self._flat_light(fields, pixels[0]), *lines, (*beams, y.pixels.count), self._pixels_x[0])
        spectra, transforms = fields.flat_spectra[0], fields.gap_lines is not None
        target = fields.flat_gap_lines if transforms else spectra
        ways = (self._pixels_y[0], self._gap_y[1], self._number(1 / y.gap.padded))
        factors = self.transfer_functions.flat_gap(fields.group.wavelengths)
        spread_columns(*lines, *factors, *target, transforms, beams, self._widths, *ways)
        if not transforms:
            return phasors
        shape, scale = (*beams, y.last.count), self._number(1 / x.gap.padded)
        views = (*fields.flat_gap_lines, *fields.flat_plane_lines, *pixels[1].flat)
        modulate_rows(*views, self.plan.grid.upsample, shape, self._gap_x[1], self._last_x[0], scale)
        one, columns = self._number(1), x.last.frequencies
        transform_columns(*fields.flat_plane_lines, *spectra, beams, columns, self._last_y[0], one)
        return phasors

    def backpropagate(
        self, fields: BeamFields, phasors: Sequence[Tensor], incident_adjoint: Tensor | None = None
    ) -> list[Tensor]:
        """As there. The products are overwritten by the next call in the same thread."""
        if self.transfer_functions.pixel_shapes is not None or incident_adjoint is not None:
            return super().backpropagate(fields, phasors, incident_adjoint)
        (y, x), beams, later = self.axes, fields.group.shape, []
        if fields.gap_lines is not None:
            later.append(self._backpropagate_second_modulator(fields, phasors[1]))
        transforms = fields.gap_lines is not None
        source = fields.flat_gap_lines if transforms else fields.flat_spectra[1]
        lines = self._kept.of("lines", *beams, y.pixels.count, x.pixels.frequencies).flat
        ways = (self._gap_y[0], self._pixels_y[1], self._number(1 / y.gap.padded))
        factors = self.transfer_functions.flat_gap(fields.group.wavelengths)
        gather_columns(*source, transforms, *factors, *lines, beams, self._widths, *ways)
        pixels = self._kept.of("pixels", *beams, y.pixels.count, x.pixels.count)
        transform_rows(*lines, *pixels.flat, (*beams, y.pixels.count), self._pixels_x[1])
        return [sum_pool(pixels.values.mul_(self._illuminated(fields.group, phasors[0])), self._repeats), *later]

    def _backpropagate_second_modulator(self, fields: BeamFields, pixels: Tensor) -> Tensor:
        if self.transfer_functions.pixel_shapes is not None:
            return super()._backpropagate_second_modulator(fields, pixels)
        (y, x), beams, lines = self.axes, fields.group.shape, fields.flat_plane_lines
        transform_columns(*fields.flat_spectra[1], *lines, beams, x.last.frequencies, self._last_y[1], self._number(1))
        products = self._kept.of("products", *beams, *pixels.shape[1:])
        shape, scale = (*beams, y.last.count), self._number(1 / x.gap.padded)
        views = (*fields.flat_gap_lines, *lines, *self._pixels_of(fields)[1].flat)
        ways = (self._gap_x[1], self._last_x[1], self._gap_x[0], scale)
        backpropagate_rows(*views, self.plan.grid.upsample, shape, *ways, *products.flat)
        return products.values

    def _pixels_of(self, fields: BeamFields) -> list[Rows]:
        """The memory of each modulator's pixels (laser, y, x) of a group."""
        key = (fields.group.lasers.start, fields.group.sources.start)
        if key not in self._pixels:
            shapes = [(len(self.lasers[fields.group.lasers]), *m.shape) for m in self.plan.system.modulators]
            self._pixels[key] = [make_rows(*shape, like=fields.plane_lines) for shape in shapes]
        return self._pixels[key]

    def _phasors(self, fields: BeamFields, opd_m: Tensor) -> list[Tensor]:
        """As there, in rows for compiled passes."""
        lasers, pixels = self.lasers[fields.group.lasers], self._pixels_of(fields)
        frames = np.array([frame for frame, _ in lasers])
        paths, strides = strided_view(opd_m)
        per_metre = (1 / self.plan.system.wavelengths_m[[λ for _, λ in lasers]]).astype(paths.dtype)
        shape = (len(lasers), *opd_m.shape[2:])
        for modulator, rows in enumerate(pixels):
            write_phasors(paths, modulator * strides[1], strides, frames, per_metre, *rows.flat, shape)
        return [rows.values for rows in pixels]

    def _flat_light(self, fields: BeamFields, pixels: Rows) -> FlatView:
        """`_illuminated` for compiled passes."""
        if self._repeats == 1 and self.transfer_functions.illumination is None:
            flat, (of_laser, of_row) = pixels.flat
            return flat, (of_laser, 0, of_row)
        light = self._illuminated(fields.group, pixels.values)
        rows = self._kept.of("light", *light.shape)
        rows.values.copy_(light)
        return rows.flat


class CompiledPlanePropagation(PlanePropagation):
    """`PlanePropagation` in compiled passes."""

    evaluates_lines = True

    def __init__(self, axes: tuple[SpectralAxis, SpectralAxis], dtype: torch.dtype) -> None:
        super().__init__(axes)
        self._lines = [plane_line(axis.last, double=dtype == torch.complex128) for axis in axes]
        self._views = KeptViews()  # of a model's lines, its targets and its picture
        self._number = np.float64 if dtype == torch.complex128 else np.float32

    def move(
        self, fields: BeamFields, block: int, transfers: TransferFunctions, before: int | None, after: int | None
    ) -> None:
        """Carries a block of columns back from a plane and on to the next, in one pass."""
        assert block == 0
        (spectra, _), adjoints = fields.flat_spectra
        move_columns(
            *fields.flat_plane_lines,
            spectra,
            *adjoints,
            *transfers.flat_plane(fields.group.wavelengths, before or 0),
            *transfers.flat_plane(fields.group.wavelengths, after or 0),
            transfers.flat_rows,
            (before is not None, after is not None),
            fields.group.shape,
            self._x.frequencies,
            self._lines[0],
        )

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
    ) -> tuple[Tensor, Floats]:
        """As there."""
        norms = weights.new_empty(2)
        products = np.zeros((weights.shape[0], sum(weights.shape)))
        wants = (carry_back, picture is not None, correlates)
        flat, shown = self._views.of(target), self._views.of(target if picture is None else picture)
        limits, beams, colours = (rows.start, rows.stop), tuple(lines.shape[:2]), weights.contiguous().numpy()
        evaluate_rows(
            *self._views.of(lines),
            limits,
            beams,
            self._lines[1],
            colours,
            *flat,
            self._number(factor),
            *shown,
            wants,
            norms.numpy(),
            products,
        )
        return norms, products


class CompiledKernels(Kernels):
    """`Kernels` by numba, on the CPU; of fields whose rows are contiguous.

    No lock of Python is held, so that each thread of a `ThreadTeam` works on its own block.
    """

    name = "compiled"

    def has_passes(self, axes: tuple[SpectralAxis, SpectralAxis]) -> bool:
        return fits_passes(axes)

    def chain_executor(self, plan: Plan, *, double: bool, device: str) -> ChainExecutor:
        if not fits_chain_passes(plan):
            return super().chain_executor(plan, double=double, device=device)
        return CompiledChain(plan, dark_inputs(plan), double=double)

    def mix(self, fields: Tensor, weights: Tensor) -> Tensor:
        image = weights.new_empty(weights.shape[1], *fields.shape[2:])
        _mix_loops(*flat_view(fields), weights.contiguous().numpy(), image.numpy())
        return image

    def replace_by_adjoint(self, fields: Tensor, weights: Tensor, slopes: Tensor) -> None:
        _weight_loops(*flat_view(fields), (2 * weights).contiguous().numpy(), slopes.contiguous().numpy())

    def add_imaginary(self, products: Tensor, factors: Tensor, out: Tensor) -> None:
        _imaginary_loops(*flat_view(products), factors.contiguous().numpy(), out.numpy())

    def replace_by_residual(self, image: Tensor, target: Tensor, factor: float) -> tuple[Tensor, Tensor]:
        norms = image.new_empty(2)
        _residual_loops(*flat_view(image), *flat_view(target)[::2], image.new_full((1,), factor).numpy(), norms.numpy())
        return norms[0], norms[1]


# --- loops of `CompiledKernels`; all other passes stand in `vector_kernels` ---


@compiled
def _mix_loops(flat: Any, shape: Any, strides: Any, weights: Any, image: Any) -> None:
    channels, rows, samples = image.shape
    power = np.empty(samples, image.dtype)
    for row in range(rows):
        image[:, row] = 0
        for laser in range(shape[0]):
            for source in range(shape[1]):
                first = laser * strides[0] + source * strides[1] + row * strides[2]
                field = flat[first : first + 2 * samples]
                for x in range(samples):
                    power[x] = field[2 * x] * field[2 * x] + field[2 * x + 1] * field[2 * x + 1]
                for channel in range(channels):
                    weight, line = weights[laser * shape[1] + source, channel], image[channel, row]
                    for x in range(samples):
                        line[x] += weight * power[x]


@compiled
def _weight_loops(flat: Any, shape: Any, strides: Any, weights: Any, slopes: Any) -> None:
    channels, rows, samples = slopes.shape
    slope = np.empty(samples, slopes.dtype)
    for row in range(rows):
        for laser in range(shape[0]):
            for source in range(shape[1]):
                slope[:] = 0
                for channel in range(channels):
                    weight, line = weights[laser * shape[1] + source, channel], slopes[channel, row]
                    for x in range(samples):
                        slope[x] += weight * line[x]
                first = laser * strides[0] + source * strides[1] + row * strides[2]
                field = flat[first : first + 2 * samples]
                for x in range(samples):
                    field[2 * x] *= slope[x]
                    field[2 * x + 1] *= -slope[x]


@compiled
def _residual_loops(
    flat: Any, shape: Any, strides: Any, target_flat: Any, target_strides: Any, factor: Any, norms: Any
) -> None:
    samples = shape[2]
    low, high, scale = norms.dtype.type(0), norms.dtype.type(1), factor[0]
    residuals = errors = 0.0
    for channel in range(shape[0]):
        for row in range(shape[1]):
            first = channel * strides[0] + row * strides[1]
            image = flat[first : first + samples]
            first = channel * target_strides[0] + row * target_strides[1]
            target = target_flat[first : first + samples]
            for x in range(samples):
                residual = image[x] - target[x]
                error = min(max(image[x], low), high) - min(max(target[x], low), high)
                residuals += residual * residual
                errors += error * error
                image[x] = residual * scale
    norms[0], norms[1] = np.sqrt(residuals), np.sqrt(errors)


@compiled
def _imaginary_loops(flat: Any, shape: Any, strides: Any, factors: Any, out: Any) -> None:
    for row in range(shape[2]):
        line = out[row]
        for laser in range(shape[0]):
            factor = factors[laser]
            for source in range(shape[1]):
                first = laser * strides[0] + source * strides[1] + row * strides[2]
                field = flat[first : first + shape[3]]
                for x in range(line.size):
                    line[x] += factor * field[2 * x + 1]
