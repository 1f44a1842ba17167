"""2-D FFTs of complex64 fields in a buffer, without barriers: in-place passes, spectrum in digit-reversed order.

Forward, X[f] = Σ x[p]·exp(−2πi·f·p/n) along rows and then columns, not normalised; inverse with the other sign,
columns and then rows, divided by nx·ny. Sizes are 2^a·3^b·5^c up to 8192 a side.
The relative L2 error of either, against float64, stays below 7e-7.

The order suits what a spectrum is for here: it is multiplied by a function of frequency and transformed back, which
needs the frequency at each position (`frequency_x`, `frequency_y`) and no sorting.
"""

from __future__ import annotations

from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from holoview.gpu.device import Buffer, Device, Pipeline
from holoview.gpu.fft_codegen import LINES, Direction, PassShape, generate_pass, pass_shapes, workgroups_of
from holoview.gpu.fft_radices import frequency_order, radices
from holoview.gpu.recorder import Pass, Recorder, spread
from holoview.gpu.shader import Generated, link

Complex = NDArray[np.complex64]
Rows = tuple[int, int]
_COMPLEX_BYTES = 8
_ROW_PADDING = 8
"""Complex numbers after each row: without them, columns of 2^k rows compete for the same few cache lines."""


class FftPlan:
    """Transforms of `batch` fields of shape (ny, nx) that lie in one buffer, shape (batch, ny, stride).

    `stride` is complex numbers from row to row, nx + 8 by default; `buffer_bytes` is the size of the buffer.
    `frequency_y` (ny,) and `frequency_x` (nx,) hold the signed frequency index at each position of a spectrum.
    Shaders are compiled when a direction is first recorded. Raises UserError for a size that can't be transformed.
    """

    def __init__(self, device: Device, shape: tuple[int, int], batch: int = 1, stride: int | None = None) -> None:
        self._device = device
        self.shape, self.batch = shape, batch
        ny, nx = shape
        self.stride = nx + _ROW_PADDING if stride is None else stride
        self._shapes = pass_shapes("x", nx, radices(nx)) + pass_shapes("y", ny, radices(ny))
        if self.stride < nx or batch < 1:
            raise ValueError(f"stride {self.stride} and batch {batch}: expected at least {nx} and 1")
        self.buffer_bytes = batch * ny * self.stride * _COMPLEX_BYTES
        self.frequency_y, self.frequency_x = frequency_order(ny), frequency_order(nx)
        self._lines: dict[Rows, Buffer] = {}
        self._bound: WeakKeyDictionary[Buffer, dict[tuple[Direction, Rows], list[Pass]]] = WeakKeyDictionary()

    def forward(self, recorder: Recorder, buffer: Buffer, rows: Rows | None = None) -> None:
        """Record the forward transform of `buffer`, in place.

        With rows = (first, count), all other rows have to be zero, and the passes along x leave them alone.
        """
        self._record(recorder, buffer, "forward", rows)

    def inverse(self, recorder: Recorder, buffer: Buffer, rows: Rows | None = None) -> None:
        """Record the inverse transform of `buffer`, in place.

        With rows = (first, count), only these rows are worth reading afterwards: the passes along x skip the others.
        """
        self._record(recorder, buffer, "inverse", rows)

    def pack(self, fields: NDArray[np.complexfloating]) -> Complex:
        """Fields of shape (batch, ny, nx), or (ny, nx), as the buffer holds them: (batch, ny, stride)."""
        ny, nx = self.shape
        packed = np.zeros((self.batch, ny, self.stride), np.complex64)
        packed[:, :, :nx] = fields
        return packed

    def download(self, buffer: Buffer) -> Complex:
        """The fields in `buffer`, shape (batch, ny, nx)."""
        ny, nx = self.shape
        return self._device.download(buffer, np.complex64, (self.batch, ny, self.stride))[:, :, :nx]

    def natural_order(self, spectrum: NDArray[np.complexfloating]) -> NDArray[np.complexfloating]:
        """A downloaded spectrum, shape (…, ny, nx), sorted as `numpy.fft.fft2` does."""
        ny, nx = self.shape
        rows, columns = np.argsort(self.frequency_y % ny), np.argsort(self.frequency_x % nx)
        return spectrum[..., rows[:, None], columns]

    def _record(self, recorder: Recorder, buffer: Buffer, direction: Direction, rows: Rows | None) -> None:
        ny = self.shape[0]
        chosen = (0, ny) if rows is None else rows
        if chosen[0] < 0 or chosen[1] < 1 or sum(chosen) > ny:
            raise ValueError(f"rows {rows}: expected (first, count) within {ny} rows")
        if buffer.nbytes < self.buffer_bytes:
            raise ValueError(f"{buffer.label}: {buffer.nbytes} bytes, expected at least {self.buffer_bytes}")
        bound = self._bound.setdefault(buffer, {})
        if (direction, chosen) not in bound:
            bound[direction, chosen] = self._bind(buffer, direction, chosen)
        for step in bound[direction, chosen]:
            recorder.add(step)

    def _bind(self, buffer: Buffer, direction: Direction, rows: Rows) -> list[Pass]:
        pipelines = self._forward if direction == "forward" else self._inverse
        bound = []
        for shape, pipeline in pipelines:
            lines = rows if shape.axis == "x" else (0, self.shape[1])
            across, down = spread(workgroups_of(shape, lines[1]), self._device)
            groups = [[self._lines_buffer(lines)], [buffer]]
            bound.append(Pass.bind(self._device, pipeline, groups, (across, down, self.batch)))
        return bound

    def _lines_buffer(self, lines: Rows) -> Buffer:
        if lines not in self._lines:
            packed = LINES.pack(first=lines[0], count=lines[1])
            self._lines[lines] = self._device.uniform(packed, "FFT lines")
        return self._lines[lines]

    @cached_property
    def _forward(self) -> list[tuple[PassShape, Pipeline]]:
        return [(shape, self._compile(shape, "forward", 1.0)) for shape in self._shapes]

    @cached_property
    def _inverse(self) -> list[tuple[PassShape, Pipeline]]:
        last = self._shapes[:1]
        scale = 1 / (self.shape[0] * self.shape[1])
        shapes = self._shapes[::-1]
        return [(shape, self._compile(shape, "inverse", scale if shape in last else 1.0)) for shape in shapes]

    def _compile(self, shape: PassShape, direction: Direction, scale: float) -> Pipeline:
        name = f"{direction} FFT pass along {shape.axis}, block {shape.block}, radix {shape.radix}"
        source = link("fft/buffer.wgsl", Generated(name, generate_pass(shape, direction, scale=scale)))
        return self._device.pipeline(source, {"row_stride": self.stride, "field_stride": self.stride * self.shape[0]})
