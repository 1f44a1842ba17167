"""Results kept on the device: fields and intensities, each with the identity of what it was computed from."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.engine.display import Display, Share
from holoview.engine.fused import FusedFrame, Rows, Span
from holoview.engine.inputs import Identity
from holoview.gpu.device import Buffer

Lit = tuple[int, int]
"""A frame and a wavelength."""
Weight = NDArray[np.float64]
"""The XYZ (3,) that an intensity of one adds."""


class Shelf:
    """Rows of fields by name and span, as many as a budget of `room_bytes` has room for.

    A buffer holds the `together` neighbouring wavelengths that may be computed at a time.
    """

    def __init__(self, frame: FusedFrame, room_bytes: int) -> None:
        self._frame = frame
        self._room = room_bytes // (frame.field_bytes * frame.together)
        self._buffers: dict[Hashable, Buffer] = {}
        self._identities: dict[tuple[str, int, int, int], Identity] = {}

    def rows(self, name: str, span: Span) -> Rows | None:
        """Where the fields of a span are kept under that name; None when there is no room for them."""
        chunk, first = divmod(span.wavelength, self._frame.together)
        key = (name, span.frame, span.source, chunk)
        if key not in self._buffers:
            if len(self._buffers) >= self._room:
                return None
            self._buffers[key] = self._frame.rows(f"{name} rows, frame {span.frame}").buffer
        return Rows(self._buffers[key], first)

    def has_room_for(self, fields: int) -> bool:
        """Whether so many fields can be kept, were it empty."""
        return -(-fields // self._frame.together) <= self._room

    def holds(self, name: str, span: Span, identities: Sequence[Identity]) -> bool:
        """Whether the fields that are kept are those of these identities, one a wavelength."""
        kept = (self._identities.get(key) for key in _keys(name, span))
        return all(mine == wanted for mine, wanted in zip(kept, identities, strict=True))

    def forget(self) -> None:
        """Nothing that is kept counts any longer."""
        self._identities.clear()

    @property
    def memory_bytes(self) -> int:
        """Memory of what is kept."""
        return sum(buffer.nbytes for buffer in self._buffers.values())

    def mark(self, name: str, span: Span, identities: Sequence[Identity]) -> None:
        """Notes what the fields of a span have been computed from."""
        self._identities.update(zip(_keys(name, span), identities, strict=True))


def _keys(name: str, span: Span) -> list[tuple[str, int, int, int]]:
    return [(name, span.frame, span.source, span.wavelength + i) for i in range(span.count)]


class Slices:
    """Intensities by frame and wavelength at unit amplitude, in few large buffers, since blending reads them together.

    As many as `room_bytes` has room for, in the order in which they are given, have a place each: they are housed.
    The others share one place and have to be blended at once. The `together` neighbouring wavelengths of a frame that
    may be computed at a time lie next to one another.
    """

    def __init__(self, display: Display, order: Iterable[Lit], together: int, room_bytes: int) -> None:
        self._together = together
        groups = list(dict.fromkeys((frame, wavelength // together) for frame, wavelength in order))
        group_bytes = display.intensity_bytes * together
        housed = groups[: max(room_bytes // group_bytes, 0)]
        a_bank = max(display.largest_bytes // group_bytes, 1)
        self.banks: list[Buffer] = []
        self._places: dict[Lit, Rows] = {}
        for start in range(0, len(housed), a_bank):
            some = housed[start : start + a_bank]
            self.banks.append(display.intensities(len(some) * together))
            self._places |= {group: Rows(self.banks[-1], i * together) for i, group in enumerate(some)}
        self._shared = Rows(display.intensities(together)) if len(housed) < len(groups) else None
        self.memory_bytes = group_bytes * len(housed)
        self.identities: dict[Lit, Identity] = {}

    def is_housed(self, lit: Lit) -> bool:
        """Whether an intensity has a place of its own."""
        return self._group(lit) in self._places

    def place(self, lit: Lit) -> Rows:
        """Where an intensity is written."""
        place = self._places.get(self._group(lit), self._shared)
        assert place is not None, "an intensity without a place of its own needs the shared one"
        return Rows(place.buffer, place.first + lit[1] % self._together)

    def shares(self, weights: Mapping[Lit, Weight], buffer: Buffer) -> list[Share]:
        """Those of the weighted intensities that lie in `buffer`."""
        places = ((self.place(lit), weight) for lit, weight in weights.items())
        return [(place.first, weight) for place, weight in places if place.buffer is buffer]

    def _group(self, lit: Lit) -> Lit:
        return lit[0], lit[1] // self._together
