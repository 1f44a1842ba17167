"""What comes after the intensities: the observer's XYZ, and a picture of it in 8-bit sRGB. Both stay on the device."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.colour import XYZ_TO_SRGB
from holoview.engine.shader_structs import BLEND, BLEND_TERM, SRGB_ENCODING
from holoview.gpu.device import Buffer, Device
from holoview.gpu.recorder import CommandRecorder, Dispatch, workgroup_grid
from holoview.gpu.shader import GeneratedWgsl, link

QUAD = 4
"""Pixels that a thread blends: an intensity on the device is padded to a multiple of it."""
_WORKGROUP = 64
_PITCH = 64  # pixels: rows of 256 bytes, as copies to a texture ask for
_F32, _VEC4, _RGBA8 = 4, 16, 4

WeightedIntensity = tuple[int, NDArray[np.float64]]
"""Number of an intensity in its buffer, and the XYZ (3,) that one unit of it adds."""


def padded_pixels(shape: tuple[int, int]) -> int:
    """Pixels from one intensity to the next in a buffer that holds several."""
    return -(-math.prod(shape) // QUAD) * QUAD


class Compositor:
    """Blends intensities of `shape` (y, x) into XYZ, and XYZ into pictures."""

    def __init__(self, device: Device, shape: tuple[int, int]) -> None:
        self._device, self.shape = device, shape
        self.pitch = -(-shape[1] // _PITCH) * _PITCH
        self._pixels = padded_pixels(shape)
        self._uniforms: dict[Hashable, Buffer] = {}
        self._passes: dict[Hashable, Dispatch] = {}

    @property
    def intensity_bytes(self) -> int:
        """Size of an intensity on the device."""
        return self._pixels * _F32

    @property
    def largest_bytes(self) -> int:
        """Size of the largest buffer that the device takes."""
        return min(self._device.limits[f"max-{name}-size"] for name in ("storage-buffer-binding", "buffer"))

    def intensity_buffer(self, count: int, label: str = "intensities") -> Buffer:
        """Storage for `count` intensities."""
        return self._device.buffer(count * self.intensity_bytes, label)

    def xyz_buffer(self, label: str) -> Buffer:
        """Storage for XYZ (y, x, 4), f32."""
        return self._device.buffer(self._pixels * _VEC4, label)

    def srgb_buffer(self, label: str) -> Buffer:
        """Storage for a picture, `pitch` pixels of 8-bit RGBA a row."""
        return self._device.buffer(self.shape[0] * self.pitch * _RGBA8, label)

    def composite(
        self,
        recorder: CommandRecorder,
        intensity: Buffer,
        terms: Sequence[WeightedIntensity],
        xyz_buffer: Buffer,
        *,
        adds: bool = False,
    ) -> None:
        """Records XYZ = Σ share·intensity, or adding it to XYZ; the shares hold for all that isn't submitted."""
        quads = self._pixels // QUAD
        blend = self._uniform(("blend", intensity, xyz_buffer, adds), BLEND.size, "blend")
        table = self._table(("shares", intensity, xyz_buffer, adds), max(len(terms), 1))
        self._device.write(blend, BLEND.pack(quads=quads, count=len(terms)))
        if terms:
            items = ({"xyz": xyz, "slice": number} for number, xyz in terms)
            self._device.write(table, BLEND_TERM.pack_array(items))
        key = ("composite", intensity, table, xyz_buffer, adds)
        if key not in self._passes:
            source = link(GeneratedWgsl("structs", BLEND.wgsl + BLEND_TERM.wgsl), "display/composite.wgsl")
            groups = [[blend, table], [intensity, xyz_buffer]]
            workgroups = (*workgroup_grid(-(-quads // _WORKGROUP), self._device), 1)
            self._passes[key] = Dispatch.bind(
                self._device, self._device.pipeline(source, {"adds": adds}), groups, workgroups
            )
        recorder.add(self._passes[key])

    def encode_srgb(
        self, recorder: CommandRecorder, xyz_buffer: Buffer, srgb_buffer: Buffer, exposure_stops: float = 0.0
    ) -> None:
        """Records the picture of XYZ × 2^exposure_stops. The exposure holds for all that isn't submitted."""
        rows, columns = self.shape
        screen = self._uniform(("screen", xyz_buffer, srgb_buffer), SRGB_ENCODING.size, "screen")
        matrix = np.zeros((3, 4))
        matrix[:, :3] = XYZ_TO_SRGB.T * 2.0**exposure_stops
        x, y, z = matrix
        packed = SRGB_ENCODING.pack(from_x=x, from_y=y, from_z=z, width=columns, pitch=self.pitch)
        self._device.write(screen, packed)
        key = ("show", xyz_buffer, srgb_buffer)
        if key not in self._passes:
            source = link(GeneratedWgsl("structs", SRGB_ENCODING.wgsl), "display/show.wgsl")
            groups = [[screen], [xyz_buffer, srgb_buffer]]
            workgroups = (-(-columns // _WORKGROUP), rows, 1)
            self._passes[key] = Dispatch.bind(self._device, self._device.pipeline(source), groups, workgroups)
        recorder.add(self._passes[key])

    def download_intensity(self, buffer: Buffer, number: int) -> NDArray[np.float32]:
        """One of the intensities in a buffer, (y, x), on the host."""
        count = buffer.nbytes // self.intensity_bytes
        flat = self._device.download(buffer, np.float32, (count, self._pixels))[number]
        return flat[: math.prod(self.shape)].reshape(self.shape)

    def download_xyz(self, seen: Buffer) -> NDArray[np.float32]:
        """XYZ (y, x, 3) on the host."""
        return self._device.download(seen, np.float32, (*self.shape, 4))[..., :3]

    def download_srgb8(self, picture: Buffer) -> NDArray[np.uint8]:
        """A picture (y, x, 3) on the host."""
        return self._device.download(picture, np.uint8, (self.shape[0], self.pitch, 4))[:, : self.shape[1], :3]

    def _uniform(self, key: Hashable, nbytes: int, label: str) -> Buffer:
        if key not in self._uniforms:
            self._uniforms[key] = self._device.uniform(bytes(nbytes), label)
        return self._uniforms[key]

    def _table(self, key: Hashable, count: int) -> Buffer:
        """A table of at least `count` shares."""
        known = self._uniforms.get(key)
        if known is None or known.nbytes < count * BLEND_TERM.size:
            self._uniforms[key] = self._device.buffer(count * BLEND_TERM.size, "shares")
        return self._uniforms[key]
