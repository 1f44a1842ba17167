"""Sums intensities, weighted by the observer's response, to CIE XYZ, and encodes XYZ as 8-bit sRGB, on the device."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import XYZ_TO_SRGB
from holoview.light.engine.shader_structs import BLEND, BLEND_TERM, SRGB_ENCODING
from holoview.light.gpu.device import Buffer, Device
from holoview.light.gpu.recorder import CommandRecorder, Dispatch, workgroup_grid
from holoview.light.gpu.shader import GeneratedWgsl, link
from holoview.light.gpu.texels import TexelPool, fits_texels, reads_texels
from holoview.light.numerics.sampling import ceil_div, round_up

OCTET = 8
"""Pixels of an invocation of composite.wgsl: an intensity on the device is padded to a multiple of it."""
MAX_TERMS = 64
"""Terms that a dispatch of composite.wgsl adds. They are uniforms, which drivers on a processor read once for all."""
MOST_TEXELS = 2**24
"""Texels of the intensities that a dispatch adds, if it adds several of successive indices: 128 MiB."""
_WORKGROUP = 64
_PITCH = 64  # pixels: WebGPU copies rows of a multiple of 256 bytes to a texture
_F32, _VEC4, _RGBA8 = 4, 16, 4

WeightedIntensity = tuple[int, NDArray[np.float64]]
"""Index of an intensity in its buffer, and the XYZ (3,) of unit intensity."""


def padded_pixels(shape: tuple[int, int]) -> int:
    """Pixels from one intensity to the next in a buffer of several intensities of `shape` (y, x)."""
    return round_up(math.prod(shape), OCTET)


class Compositor:
    """Computes XYZ from intensities of `shape` (y, x), and sRGB images from XYZ. `pitch` is pixels from row to row."""

    def __init__(self, device: Device, shape: tuple[int, int]) -> None:
        self._device, self.shape = device, shape
        self.pitch = round_up(shape[1], _PITCH)
        self._pixels = padded_pixels(shape)
        self._params: dict[Hashable, Buffer] = {}
        self._dispatches: dict[Hashable, Dispatch] = {}
        self._texels = TexelPool(device)

    @property
    def intensity_bytes(self) -> int:
        """Size of one intensity on the device."""
        return self._pixels * _F32

    @property
    def largest_bytes(self) -> int:
        """Size of the largest buffer that the device supports."""
        return min(self._device.limits[f"max-{name}-size"] for name in ("storage-buffer-binding", "buffer"))

    @property
    def texel_bytes(self) -> int:
        """Device memory of the textures by which intensities and XYZ are read."""
        return self._texels.nbytes

    def intensity_buffer(self, count: int, label: str = "intensities") -> Buffer:
        """A new buffer for `count` intensities, f32."""
        return self._device.buffer(count * self.intensity_bytes, label)

    def xyz_buffer(self, label: str) -> Buffer:
        """A new buffer for XYZ, f32 (y, x, 4)."""
        return self._device.buffer(self._pixels * _VEC4, label)

    def srgb_buffer(self, label: str) -> Buffer:
        """A new buffer for an sRGB image, `pitch` pixels of 8-bit RGBA in each row."""
        return self._device.buffer(self.shape[0] * self.pitch * _RGBA8, label)

    def composite(
        self,
        recorder: CommandRecorder,
        intensity: Buffer,
        terms: Sequence[WeightedIntensity],
        xyz_buffer: Buffer,
        *,
        base: Buffer | None = None,
    ) -> None:
        """Record XYZ = Σ weight·intensity over `terms`, or add it to the XYZ of `base`, which may be `xyz_buffer`.

        The weights hold for all work with these buffers that hasn't been submitted yet.
        """
        most = MAX_TERMS
        if reads_texels(self._device):
            most = min(most, max(MOST_TEXELS // (self._pixels // 2), 1))
        for first in range(0, max(len(terms), 1), most):
            some = terms[first : first + most]
            recorder.add(self._blending((intensity, xyz_buffer, xyz_buffer if first else base, first), some))

    def _blending(self, key: tuple[Buffer, Buffer, Buffer | None, int], terms: Sequence[WeightedIntensity]) -> Dispatch:
        """The dispatch that adds some terms. key: intensity, XYZ, what they are added to, the first term's number."""
        intensity, xyz_buffer, base, _ = key
        octets = self._pixels // OCTET
        blend = self._uniform(("blend", *key), BLEND.size, "blend")
        table = self._uniform(("terms", *key), MAX_TERMS * BLEND_TERM.size, "blend terms")
        self._device.write(blend, BLEND.pack(octets=octets, count=len(terms)))
        indices = [index for index, _ in terms]
        lowest, count = min(indices, default=0), max(indices, default=-1) + 1 - min(indices, default=0)
        largest = max(count * self._pixels // 2, 2 * self._pixels)
        is_copied = reads_texels(self._device) and fits_texels(self._device, largest)
        if terms:
            shift = lowest if is_copied else 0
            items = ({"xyz": xyz, "intensity_index": index - shift} for index, xyz in terms)
            self._device.write(table, BLEND_TERM.pack_array(items))
        bound_key = (*key, lowest, count) if is_copied else key
        if bound_key not in self._dispatches:
            structs = GeneratedWgsl("structs", BLEND.wgsl + BLEND_TERM.wgsl)
            other = None if base is xyz_buffer else base
            resources: list[Any] = [intensity, xyz_buffer, other or intensity]
            if is_copied:
                other = base
                resources = self._as_texels(intensity, lowest, count, base)
                resources.insert(1, xyz_buffer)
            storage = f"display/pixels_{'texels' if is_copied else 'f32'}.wgsl"
            source = link(structs, storage, "display/composite.wgsl")
            switches = {"accumulates": base is not other, "has_base": other is not None}
            pipeline = self._device.pipeline(source, switches)
            workgroups = (*workgroup_grid(ceil_div(octets, _WORKGROUP), self._device), 1)
            self._dispatches[bound_key] = Dispatch.bind(self._device, pipeline, [[blend, table], resources], workgroups)
        return self._dispatches[bound_key]

    def _as_texels(self, intensity: Buffer, lowest: int, count: int, base: Buffer | None) -> list[Any]:
        """Intensities from the lowest on, and XYZ to which they are added, as texels."""
        each = self._pixels // 2  # texels of an intensity; XYZ has two for each pixel
        found: list[Any] = []
        for name, buffer, first, size in (
            ("texels of intensities", intensity, lowest * each, count * each),
            ("texels of XYZ", base, 0, 2 * self._pixels),
        ):
            pool = self._texels
            found.append(pool.texels(name, buffer, first, size) if buffer and size else pool.memory(name, 1).view)
        return found

    def encode_srgb(
        self, recorder: CommandRecorder, xyz_buffer: Buffer, srgb_buffer: Buffer, exposure_stops: float = 0.0
    ) -> None:
        """Record the 8-bit sRGB image of XYZ × 2^exposure_stops.

        The exposure holds for all work with these buffers that hasn't been submitted yet.
        """
        rows, columns = self.shape
        encoding = self._uniform(("encoding", xyz_buffer, srgb_buffer), SRGB_ENCODING.size, "sRGB encoding")
        matrix = np.zeros((3, 4))
        matrix[:, :3] = XYZ_TO_SRGB.T * 2.0**exposure_stops
        x, y, z = matrix
        packed = SRGB_ENCODING.pack(x_to_rgb=x, y_to_rgb=y, z_to_rgb=z, width=columns, pitch=self.pitch)
        self._device.write(encoding, packed)
        key = ("show", xyz_buffer, srgb_buffer)
        if key not in self._dispatches:
            source = link(GeneratedWgsl("structs", SRGB_ENCODING.wgsl), "display/show.wgsl")
            groups = [[encoding], [xyz_buffer, srgb_buffer]]
            workgroups = (ceil_div(columns, _WORKGROUP), rows, 1)
            self._dispatches[key] = Dispatch.bind(self._device, self._device.pipeline(source), groups, workgroups)
        recorder.add(self._dispatches[key])

    def download_intensity(self, buffer: Buffer, index: int) -> NDArray[np.float32]:
        """Intensity `index` of a buffer, (y, x), on the host."""
        count = buffer.nbytes // self.intensity_bytes
        flat = self._device.download(buffer, np.float32, (count, self._pixels))[index]
        return flat[: math.prod(self.shape)].reshape(self.shape)

    def download_xyz(self, xyz_buffer: Buffer) -> NDArray[np.float32]:
        """XYZ (y, x, 3) on the host."""
        return self._device.download(xyz_buffer, np.float32, (*self.shape, 4))[..., :3]

    def download_srgb8(self, srgb_buffer: Buffer) -> NDArray[np.uint8]:
        """8-bit sRGB (y, x, 3) on the host."""
        return self._device.download(srgb_buffer, np.uint8, (self.shape[0], self.pitch, 4))[:, : self.shape[1], :3]

    def _uniform(self, key: Hashable, nbytes: int, label: str) -> Buffer:
        """The uniform buffer of a key."""
        if key not in self._params:
            self._params[key] = self._device.uniform(bytes(nbytes), label)
        return self._params[key]
