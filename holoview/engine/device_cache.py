"""Caches of complex fields and of intensities in device memory, within a budget, with fingerprints of their inputs."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from holoview.engine.compositor import Compositor, WeightedIntensity
from holoview.engine.device_tables import Fingerprint
from holoview.engine.frame_layout import StoredRows
from holoview.engine.fused import BufferRegion, FusedFrame, WavelengthSpan
from holoview.gpu.device import Buffer
from holoview.numerics.sampling import ceil_div

FieldName = Literal["first", "second"]
"""The field behind the first modulator, or what is kept behind the last one."""
FIELD_NAMES: tuple[FieldName, ...] = ("first", "second")
FrameWavelength = tuple[int, int]
"""Index of a frame and index of a wavelength."""
XyzWeight = NDArray[np.float64]
"""XYZ (3,) of unit intensity."""


class FieldCache:
    """Fields between kernels by name and span, as many as fit `budget_bytes`.

    A buffer holds the `frame.max_wavelengths` successive wavelengths that a dispatch may compute.
    """

    def __init__(self, frame: FusedFrame, budget_bytes: int) -> None:
        self._frame, self._budget_bytes = frame, budget_bytes
        self._buffers: dict[Hashable, Buffer] = {}
        self._fingerprints: dict[tuple[FieldName, int, int, int], Fingerprint] = {}

    def region(self, name: FieldName, span: WavelengthSpan) -> BufferRegion | None:
        """Where the fields of a span are stored, allocated if necessary; None if the budget has no room for them."""
        chunk, first = divmod(span.wavelength, self._frame.max_wavelengths)
        key = (name, span.frame, span.source, chunk)
        if key not in self._buffers:
            if self.memory_bytes + self._buffer_bytes(name) > self._budget_bytes:
                return None
            label = f"{name} rows, frame {span.frame}"
            self._buffers[key] = self._frame.allocate_rows(label, self._rows(name)).buffer
        return BufferRegion(self._buffers[key], first)

    def has_room_for(self, fields: int) -> bool:
        """Whether this many first fields and as many second ones would fit an empty cache."""
        buffers = ceil_div(fields, self._frame.max_wavelengths)
        return buffers * sum(self._buffer_bytes(name) for name in FIELD_NAMES) <= self._budget_bytes

    def clear(self) -> None:
        """Release all memory, because fields of another size are going to be stored."""
        self._buffers.clear()
        self._fingerprints.clear()

    def _rows(self, name: FieldName) -> StoredRows:
        return self._frame.layout.first if name == "first" else self._frame.kept

    def _buffer_bytes(self, name: FieldName) -> int:
        return self._frame.rows_bytes(self._rows(name)) * self._frame.max_wavelengths

    def is_current(self, name: FieldName, span: WavelengthSpan, fingerprints: Sequence[Fingerprint]) -> bool:
        """Whether the stored fields have these fingerprints, one for each wavelength of the span."""
        stored = (self._fingerprints.get(key) for key in _keys(name, span))
        return all(one == other for one, other in zip(stored, fingerprints, strict=True))

    def invalidate(self) -> None:
        """Mark all stored fields as stale."""
        self._fingerprints.clear()

    @property
    def memory_bytes(self) -> int:
        """Device memory of the stored fields."""
        return sum(buffer.nbytes for buffer in self._buffers.values())

    def set_fingerprints(self, name: FieldName, span: WavelengthSpan, fingerprints: Sequence[Fingerprint]) -> None:
        """Set the fingerprints of the stored fields of a span."""
        self._fingerprints.update(zip(_keys(name, span), fingerprints, strict=True))


def _keys(name: FieldName, span: WavelengthSpan) -> list[tuple[FieldName, int, int, int]]:
    return [(name, span.frame, span.source, span.wavelength + i) for i in range(span.count)]


class IntensityCache:
    """Intensities by frame and wavelength at unit amplitude, in few large buffers that compositing reads as a whole.

    Resident intensities, as many as fit `budget_bytes` in the given order, have a region of their own. The others are
    transient: they share one region and have to be added to XYZ before the next one overwrites it. The
    `max_wavelengths` successive wavelengths that a dispatch may compute are adjacent.
    """

    def __init__(
        self, compositor: Compositor, order: Iterable[FrameWavelength], max_wavelengths: int, budget_bytes: int
    ) -> None:
        self._max_wavelengths = max_wavelengths
        groups = list(dict.fromkeys((frame, wavelength // max_wavelengths) for frame, wavelength in order))
        group_bytes = compositor.intensity_bytes * max_wavelengths
        resident = groups[: max(budget_bytes // group_bytes, 0)]
        groups_per_buffer = max(compositor.largest_bytes // group_bytes, 1)
        self.buffers: list[Buffer] = []
        self._regions: dict[FrameWavelength, BufferRegion] = {}
        for start in range(0, len(resident), groups_per_buffer):
            some = resident[start : start + groups_per_buffer]
            buffer = compositor.intensity_buffer(len(some) * max_wavelengths)
            self.buffers.append(buffer)
            self._regions |= {group: BufferRegion(buffer, i * max_wavelengths) for i, group in enumerate(some)}
        has_transient = len(resident) < len(groups)
        self._shared = BufferRegion(compositor.intensity_buffer(max_wavelengths)) if has_transient else None
        self.memory_bytes = group_bytes * len(resident)
        self.fingerprints: dict[FrameWavelength, Fingerprint] = {}

    def is_resident(self, key: FrameWavelength) -> bool:
        """Whether an intensity has a region of its own."""
        return self._group(key) in self._regions

    def region(self, key: FrameWavelength) -> BufferRegion:
        """Where an intensity is stored."""
        region = self._regions.get(self._group(key), self._shared)
        assert region is not None, "a transient intensity needs the shared region"
        return BufferRegion(region.buffer, region.first + key[1] % self._max_wavelengths)

    def blend_terms(self, weights: Mapping[FrameWavelength, XyzWeight], buffer: Buffer) -> list[WeightedIntensity]:
        """Those of the weighted intensities that are stored in `buffer`."""
        regions = ((self.region(key), weight) for key, weight in weights.items())
        return [(region.first, weight) for region, weight in regions if region.buffer is buffer]

    def _group(self, key: FrameWavelength) -> FrameWavelength:
        return key[0], key[1] // self._max_wavelengths
