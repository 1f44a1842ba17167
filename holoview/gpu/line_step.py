"""What a transform of a line is to do: its direction, the points and frequencies that aren't needed, and its length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from holoview.gpu.spectrum_order import Range

Direction = Literal["forward", "inverse"]


@dataclass(frozen=True)
class Step:
    """A transform of lines of n points.

    points: those that may differ from 0 in a forward transform, or that an inverse one has to compute; None means all.
    band: the frequencies that a forward transform has to compute, or that may differ from 0 in an inverse one.
    repeats: a forward transform followed by an inverse one may have n/repeats points. Its spectrum is then repeated to
    n frequencies, which is the spectrum of these points with repeats − 1 zeros after each.
    """

    direction: Direction
    points: Range | None = None
    band: Range | None = None
    repeats: int = 1
