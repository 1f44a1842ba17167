"""Results kept on the device: fields and intensities, each with the identity of what it was computed from."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.engine.compositor import Compositor, WeightedIntensity
from holoview.engine.device_tables import Fingerprint
from holoview.engine.fused import BufferRegion, FusedFrame, WavelengthSpan
from holoview.gpu.device import Buffer

FrameWavelength = tuple[int, int]
"""A frame and a wavelength."""
XyzWeight = NDArray[np.float64]
"""The XYZ (3,) that an intensity of one adds."""


class FieldCache:
    """Rows of fields by name and span, as many as a budget of `room_bytes` has room for.

    A buffer holds the `together` neighbouring wavelengths that may be computed at a time.
    """

    def __init__(self, frame: FusedFrame, budget_bytes: int) -> None:
        self._frame = frame
        self._room = budget_bytes // (frame.field_bytes * frame.max_wavelengths)
        self._buffers: dict[Hashable, Buffer] = {}
        self._identities: dict[tuple[str, int, int, int], Fingerprint] = {}

    def region(self, name: str, span: WavelengthSpan) -> BufferRegion | None:
        """Where the fields of a span are kept under that name; None when there is no room for them."""
        chunk, first = divmod(span.wavelength, self._frame.max_wavelengths)
        key = (name, span.frame, span.source, chunk)
        if key not in self._buffers:
            if len(self._buffers) >= self._room:
                return None
            self._buffers[key] = self._frame.allocate_fields(f"{name} rows, frame {span.frame}").buffer
        return BufferRegion(self._buffers[key], first)

    def has_room_for(self, fields: int) -> bool:
        """Whether so many fields can be kept, were it empty."""
        return -(-fields // self._frame.max_wavelengths) <= self._room

    def is_current(self, name: str, span: WavelengthSpan, fingerprints: Sequence[Fingerprint]) -> bool:
        """Whether the fields that are kept are those of these identities, one a wavelength."""
        kept = (self._identities.get(key) for key in _keys(name, span))
        return all(mine == wanted for mine, wanted in zip(kept, fingerprints, strict=True))

    def invalidate(self) -> None:
        """Nothing that is kept counts any longer."""
        self._identities.clear()

    @property
    def memory_bytes(self) -> int:
        """Memory of what is kept."""
        return sum(buffer.nbytes for buffer in self._buffers.values())

    def set_fingerprints(self, name: str, span: WavelengthSpan, fingerprints: Sequence[Fingerprint]) -> None:
        """Notes what the fields of a span have been computed from."""
        self._identities.update(zip(_keys(name, span), fingerprints, strict=True))


def _keys(name: str, span: WavelengthSpan) -> list[tuple[str, int, int, int]]:
    return [(name, span.frame, span.source, span.wavelength + i) for i in range(span.count)]


class IntensityCache:
    """Intensities by frame and wavelength at unit amplitude, in few large buffers, since blending reads them together.

    As many as `room_bytes` has room for, in the order in which they are given, have a place each: they are housed.
    The others share one place and have to be blended at once. The `together` neighbouring wavelengths of a frame that
    may be computed at a time lie next to one another.
    """

    def __init__(
        self, display: Compositor, order: Iterable[FrameWavelength], max_wavelengths: int, budget_bytes: int
    ) -> None:
        self._together = max_wavelengths
        groups = list(dict.fromkeys((frame, wavelength // max_wavelengths) for frame, wavelength in order))
        group_bytes = display.intensity_bytes * max_wavelengths
        housed = groups[: max(budget_bytes // group_bytes, 0)]
        a_bank = max(display.largest_bytes // group_bytes, 1)
        self.buffers: list[Buffer] = []
        self._places: dict[FrameWavelength, BufferRegion] = {}
        for start in range(0, len(housed), a_bank):
            some = housed[start : start + a_bank]
            self.buffers.append(display.intensity_buffer(len(some) * max_wavelengths))
            self._places |= {group: BufferRegion(self.buffers[-1], i * max_wavelengths) for i, group in enumerate(some)}
        self._shared = BufferRegion(display.intensity_buffer(max_wavelengths)) if len(housed) < len(groups) else None
        self.memory_bytes = group_bytes * len(housed)
        self.fingerprints: dict[FrameWavelength, Fingerprint] = {}

    def is_resident(self, lit: FrameWavelength) -> bool:
        """Whether an intensity has a place of its own."""
        return self._group(lit) in self._places

    def region(self, lit: FrameWavelength) -> BufferRegion:
        """Where an intensity is written."""
        place = self._places.get(self._group(lit), self._shared)
        assert place is not None, "an intensity without a place of its own needs the shared one"
        return BufferRegion(place.buffer, place.first + lit[1] % self._together)

    def blend_terms(self, weights: Mapping[FrameWavelength, XyzWeight], buffer: Buffer) -> list[WeightedIntensity]:
        """Those of the weighted intensities that lie in `buffer`."""
        places = ((self.region(lit), weight) for lit, weight in weights.items())
        return [(place.first, weight) for place, weight in places if place.buffer is buffer]

    def _group(self, lit: FrameWavelength) -> FrameWavelength:
        return lit[0], lit[1] // self._together
