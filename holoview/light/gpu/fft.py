"""2-D FFTs of complex64 fields, in place in a buffer.

Forward: X[f] = Σ x[p]·exp(−2πi·f·p/n) along rows, then along columns, not normalised. Inverse: with the other sign
along columns, then along rows, divided by nx·ny. Sizes are 2^a·3^b·5^c up to 8192 on a side, with any strategy of
`line_fft` that supports them. The relative L2 error of either, against float64, is below 7e-7.

A spectrum stays in the order in which the strategy leaves it. Multiplying it by a function of frequency and
transforming it back needs the frequency at each position (`frequency_x`, `frequency_y`), but no sorting.
"""

from __future__ import annotations

from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from holoview.light.gpu.device import Buffer, Device
from holoview.light.gpu.line_fft import (
    ROW_PADDING,
    Axis,
    Direction,
    Hooks,
    LineFft,
    LineTransform,
    Strategy,
    TransformShader,
    check_strategy,
    spectrum_order,
    storage_shader,
)
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.texels import TexelMemory, Texels, fits_texels, reads_texels

Complex = NDArray[np.complex64]
RowRange = tuple[int, int]
_COMPLEX_BYTES = 8


class FftPlan:
    """Transforms of `batch` fields of `shape` (ny, nx) in one buffer of shape (batch, ny, stride).

    `stride` is complex numbers from one row to the next, nx + 8 by default; `buffer_bytes` is the size of the buffer.
    `frequency_y` (ny,) and `frequency_x` (nx,) are the signed frequency indices at the positions of a spectrum.
    Shaders are compiled when a direction is first recorded. Raises UserError for a size that can't be transformed, at
    all or by the strategy.
    """

    def __init__(
        self,
        device: Device,
        shape: tuple[int, int],
        batch: int = 1,
        stride: int | None = None,
        strategy: Strategy = "passes",
    ) -> None:
        self._device = device
        self.shape, self.batch, self.strategy = shape, batch, strategy
        ny, nx = shape
        self.stride = nx + ROW_PADDING if stride is None else stride
        if self.stride < nx or batch < 1:
            raise ValueError(f"stride {self.stride} and batch {batch}: expected at least {nx} and 1")
        self.buffer_bytes = batch * ny * self.stride * _COMPLEX_BYTES
        check_strategy(device, "x", nx, strategy)
        check_strategy(device, "y", ny, strategy)
        self.frequency_y, self.frequency_x = (spectrum_order(device, n, strategy).frequencies() for n in shape)
        self._bound: WeakKeyDictionary[Buffer, dict[tuple[Direction, RowRange], list[Dispatch]]] = WeakKeyDictionary()

    def forward(self, recorder: CommandRecorder, buffer: Buffer, rows: RowRange | None = None) -> None:
        """Record the forward transform of `buffer`, in place.

        With rows = (first, count), all other rows have to be zero, and only these are transformed along x.
        """
        self._record(recorder, buffer, "forward", rows)

    def inverse(self, recorder: CommandRecorder, buffer: Buffer, rows: RowRange | None = None) -> None:
        """Record the inverse transform of `buffer`, in place.

        With rows = (first, count), only these rows are transformed along x; the others are undefined afterwards.
        """
        self._record(recorder, buffer, "inverse", rows)

    def pack(self, fields: NDArray[np.complexfloating]) -> Complex:
        """Fields of shape (batch, ny, nx), or (ny, nx), in the layout of the buffer, (batch, ny, stride)."""
        ny, nx = self.shape
        packed = np.zeros((self.batch, ny, self.stride), np.complex64)
        packed[:, :, :nx] = fields
        return packed

    def download(self, buffer: Buffer) -> Complex:
        """The fields in `buffer`, shape (batch, ny, nx)."""
        ny, nx = self.shape
        return self._device.download(buffer, np.complex64, (self.batch, ny, self.stride))[:, :, :nx]

    def natural_order(self, spectrum: NDArray[np.complexfloating]) -> NDArray[np.complexfloating]:
        """A downloaded spectrum, shape (…, ny, nx), in the order of `numpy.fft.fft2`."""
        ny, nx = self.shape
        rows, columns = np.argsort(self.frequency_y % ny), np.argsort(self.frequency_x % nx)
        return spectrum[..., rows[:, None], columns]

    @property
    def shaders(self) -> list[TransformShader]:
        """The shaders of both directions."""
        return [shader for transform in (*self._forward, *self._inverse) for shader in transform.shaders]

    def _record(self, recorder: CommandRecorder, buffer: Buffer, direction: Direction, rows: RowRange | None) -> None:
        ny = self.shape[0]
        row_range = (0, ny) if rows is None else rows
        if row_range[0] < 0 or row_range[1] < 1 or sum(row_range) > ny:
            raise ValueError(f"rows {rows}: expected (first, count) within {ny} rows")
        if buffer.nbytes < self.buffer_bytes:
            raise ValueError(f"{buffer.label}: {buffer.nbytes} bytes, expected at least {self.buffer_bytes}")
        bound = self._bound.setdefault(buffer, {})
        if (direction, row_range) not in bound:
            bound[direction, row_range] = self._bind(buffer, direction, row_range)
        for dispatch in bound[direction, row_range]:
            recorder.add(dispatch)

    def _bind(self, buffer: Buffer, direction: Direction, rows: RowRange) -> list[Dispatch]:
        resources: list[Buffer | Texels] = [buffer]
        if self._reads_texels:
            resources.append(Texels(self._texels, buffer, 0, self.buffer_bytes // _COMPLEX_BYTES))
        dispatches = []
        for transform in self._forward if direction == "forward" else self._inverse:
            first, count = rows if transform.axis == "x" else (0, self.shape[1])
            dispatches += transform.bind(resources, count, self.batch, first=first)
        return dispatches

    @property
    def _reads_texels(self) -> bool:
        return reads_texels(self._device) and fits_texels(self._device, self.buffer_bytes // _COMPLEX_BYTES)

    @cached_property
    def _texels(self) -> TexelMemory:
        return TexelMemory(self._device, self.buffer_bytes // _COMPLEX_BYTES, "texels of an FFT")

    @cached_property
    def _forward(self) -> list[LineFft]:
        return [self._line_fft("x", "forward"), self._line_fft("y", "forward")]

    @cached_property
    def _inverse(self) -> list[LineFft]:
        return [self._line_fft("y", "inverse"), self._line_fft("x", "inverse", 1 / (self.shape[0] * self.shape[1]))]

    def _line_fft(self, axis: Axis, direction: Direction, scale: float = 1.0) -> LineFft:
        constants = (("row_stride", self.stride), ("field_stride", self.stride * self.shape[0]), ("scale", scale))
        read = f"fft/buffer_{'texels' if self._reads_texels else 'plain'}.wgsl"
        hooks = Hooks("FFT", (storage_shader(self._device), read, "fft/buffer.wgsl"), constants, has_work_hooks=True)
        return LineFft(self._device, axis, self.shape, (LineTransform(direction),), hooks, self.strategy)
