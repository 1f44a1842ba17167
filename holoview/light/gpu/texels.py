"""Complex numbers of a buffer as texels, which drivers that execute shaders on the processor read faster.

Such a driver turns each read of a buffer into a loop over the lanes of a vector, which inserts one number after the
other into a register. Reads of a texture have no loop. Shaders write buffers faster, so that a part of a buffer is
copied to a texture before each dispatch that reads it.

A shader binds the texture as `texture_storage_2d<rg32float, read>`; `shaders/lib/texels.wgsl` tells the place of a
number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import wgpu

from holoview.light.gpu.device import INT64, Buffer, Device
from holoview.light.gpu.shader import TEXEL_FORMAT
from holoview.light.numerics.sampling import ceil_div
from holoview.util.errors import UserError

COLUMNS = 8192
"""Texels of a row, as in `shaders/lib/texels.wgsl`."""
_COMPLEX = 8  # bytes
_LIMIT = "max-texture-dimension-2d"


@dataclass(frozen=True, eq=False)
class Texels:
    """A part of a buffer, in complex numbers of two f32, and the texture to which it is copied before a dispatch.

    first, count: of the complex numbers; they begin in the texture's first texel.
    """

    memory: TexelMemory
    buffer: Buffer
    first: int
    count: int

    def __post_init__(self) -> None:
        if not 0 < self.count <= self.memory.size or (self.first + self.count) * _COMPLEX > self.buffer.raw.size:
            last, held = self.first + self.count, self.buffer.nbytes // _COMPLEX
            raise ValueError(f"{self.buffer.label}: numbers {self.first} to {last} as texels, it holds {held}")

    @property
    def view(self) -> Any:
        """What a shader binds."""
        return self.memory.view

    def record(self, encoder: Any) -> None:
        """Record the copy: whole rows, and the rest of the last one."""
        rows, rest = divmod(self.count, COLUMNS)
        for row, size in ((0, (COLUMNS, rows, 1)), (rows, (rest, 1, 1))):
            if size[0] and size[1]:
                source = {
                    "buffer": self.buffer.raw,
                    "offset": (self.first + row * COLUMNS) * _COMPLEX,
                    "bytes_per_row": COLUMNS * _COMPLEX,
                    "rows_per_image": size[1],
                }
                encoder.copy_buffer_to_texture(source, {"texture": self.memory.raw, "origin": (0, row, 0)}, size)


class TexelMemory:
    """A texture for up to `size` complex numbers, which dispatches may share.

    Raises UserError beyond the device's limit.
    """

    def __init__(self, device: Device, size: int, label: str) -> None:
        rows = _row_count(size)
        if not fits_texels(device, size):
            raise UserError(
                f"texture '{label}'",
                f"needs {rows} rows",
                expected=f"at most {device.limits[_LIMIT]} ({_LIMIT} of {device.info.name})",
                remedy="lower the size of the grid or the number of fields at a time",
            )
        self.size, self.nbytes = size, rows * COLUMNS * _COMPLEX
        usage = wgpu.TextureUsage.STORAGE_BINDING | wgpu.TextureUsage.COPY_DST
        self.raw = device.raw.create_texture(label=label, size=(COLUMNS, rows, 1), format=TEXEL_FORMAT, usage=usage)
        self.view = self.raw.create_view()


class TexelPool:
    """Textures by name, each as large as the largest part of a buffer that was asked for under that name."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._memory: dict[str, TexelMemory] = {}

    @property
    def nbytes(self) -> int:
        """Device memory of the textures."""
        return sum(memory.nbytes for memory in self._memory.values())

    def memory(self, name: str, size: int) -> TexelMemory:
        """The texture of a name, replaced by a larger one where it is too small."""
        memory = self._memory.get(name)
        if memory is None or memory.size < size:
            memory = self._memory[name] = TexelMemory(self._device, size, name)
        return memory

    def texels(self, name: str, buffer: Buffer, first: int, count: int) -> Texels:
        """A part of a buffer in the texture of a name."""
        return Texels(self.memory(name, count), buffer, first, count)


def fits_texels(device: Device, size: int) -> bool:
    """Whether a texture of the device holds so many complex numbers."""
    return max(_row_count(size), COLUMNS) <= device.limits.get(_LIMIT, 0)


def reads_texels(device: Device) -> bool:
    """Whether shaders on a device read what other shaders write as texels, and write it as 64-bit integers.

    Vulkan drivers that execute shaders on the processor are faster so. Those of other systems haven't been tried.
    """
    return device.info.is_cpu and device.info.backend == "Vulkan" and INT64 in device.features


def _row_count(size: int) -> int:
    """Rows of a texture for `size` complex numbers, at least three and never a power of two.

    Drivers of the processor compile a shader once more where one size of a texture is a power of two and that of
    another texture isn't: what was compiled beforehand for a small texture would be compiled again in the first frame.
    """
    rows = max(ceil_div(size, COLUMNS), 3)
    return rows + (rows & (rows - 1) == 0)
