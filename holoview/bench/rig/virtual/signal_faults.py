"""What a virtual bench's video signal does to a pattern on its way to a modulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.fields import Integer, Number, Word, described_field, validate

_LIMITED_LOW, _LIMITED_SPAN, _FULL = 16, 219, 255


@dataclass(frozen=True)
class SignalFaults:
    """scale: of the pattern on the modulator, from its upper left corner, the nearest pixels being repeated.

    range: "clipped": a receiver expands a full signal; "compressed": a sender's limited signal isn't expanded. bits:
    that arrive, the others being 0.
    """

    scale: float = described_field(Number(low=0.25, high=4.0), "of the pattern", default=1.0)
    range: str = described_field(Word(("full", "clipped", "compressed")), "of the levels", default="full")
    bits: int = described_field(Integer(1, 16), "that arrive", default=16)

    def __post_init__(self) -> None:
        validate(self)

    def arrived(self, levels: NDArray[np.unsignedinteger], num_levels: int) -> NDArray[np.unsignedinteger]:
        """The levels (y, x) that arrive of those that were sent."""
        found, top = levels.astype(np.float64), num_levels - 1
        if self.scale != 1:
            y, x = (np.minimum((np.arange(n) / self.scale).astype(int), n - 1) for n in levels.shape)
            found = found[np.ix_(y, x)]
        if self.range == "compressed":
            found = np.rint((found / top * _LIMITED_SPAN + _LIMITED_LOW) / _FULL * top)
        elif self.range == "clipped":
            found = np.rint(np.clip((found / top * _FULL - _LIMITED_LOW) / _LIMITED_SPAN, 0, 1) * top)
        lost = max((num_levels - 1).bit_length() - self.bits, 0)
        arrived: NDArray[np.unsignedinteger] = (found.astype(levels.dtype) >> lost << lost).astype(levels.dtype)
        return arrived
