"""Parts in which fields are computed: few enough numbers for a processor's cache, many enough for a GPU."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from holoview.optimise.lasers import Laser
from holoview.optimise.memory import CPU_BLOCK_BYTES

Tensor = torch.Tensor

DEVICE_BLOCK_BYTES = 1 << 30
"""Size of a block of complex numbers on other devices than the CPU: as much as a batch may take, for few calls."""


@dataclass(frozen=True)
class BeamGroup:
    """Beams that are computed together.

    lasers, sources: slices of fields (laser, source, …). wavelengths: the lasers' transfer functions, in their order.
    """

    lasers: slice
    sources: slice
    wavelengths: slice

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of lasers and of sources."""
        return self.lasers.stop - self.lasers.start, self.sources.stop - self.sources.start


def block_bytes(device: torch.device) -> int:
    """How many bytes of complex numbers to compute at a time on a device."""
    return CPU_BLOCK_BYTES if device.type == "cpu" else DEVICE_BLOCK_BYTES


def slices(total: int, at_most: int) -> list[slice]:
    """0 … total in slices of `at_most`, at least 1, entries."""
    size = max(1, at_most)
    return [slice(start, min(start + size, total)) for start in range(0, total, size)]


def group_beams(
    lasers: Sequence[Laser], wavelengths: Sequence[int], sources: int, beam_bytes: int, limit: int
) -> list[BeamGroup]:
    """The beams in groups of at most `limit` bytes, or one beam where `beam_bytes` is more.

    A group consists of some sources of one laser, or of all sources of lasers whose wavelengths follow each other in
    `wavelengths`, those in use. Their transfer functions are then a slice, which takes no copy.
    """
    at_most = max(1, limit // max(1, beam_bytes))
    positions = [wavelengths.index(wavelength) for _, wavelength in lasers]
    if at_most < sources:
        return [
            BeamGroup(slice(i, i + 1), part, slice(position, position + 1))
            for i, position in enumerate(positions)
            for part in slices(sources, at_most)
        ]
    groups: list[BeamGroup] = []
    for i, position in enumerate(positions):
        last = groups[-1] if groups else None
        if last and last.wavelengths.stop == position and (i + 1 - last.lasers.start) * sources <= at_most:
            joined = slice(last.wavelengths.start, position + 1)
            groups[-1] = BeamGroup(slice(last.lasers.start, i + 1), last.sources, joined)
        else:
            groups.append(BeamGroup(slice(i, i + 1), slice(0, sources), slice(position, position + 1)))
    return groups


class ZeroTails:
    """Buffers whose entries from some index of an axis on are zero; each thread has its own and uses them again.

    Only the entries before may be written, so that padding with zeros costs nothing.
    """

    def __init__(self) -> None:
        self._local = threading.local()

    def buffer(self, like: Tensor, dim: int, length: int) -> Tensor:
        """A buffer of the shape of `like` but `length` long in an axis, zero beyond the length of `like` there."""
        shape = list(like.shape)
        shape[dim] = length
        key = (tuple(shape), dim, like.shape[dim])
        buffers: dict[tuple[object, ...], Tensor] = self._local.__dict__.setdefault("buffers", {})
        if key not in buffers:
            buffers[key] = torch.zeros(shape, dtype=like.dtype, device=like.device)
        return buffers[key]
