"""How many bits the whole numbers of a picture use, where these stand in their type, and where they are clipped.

Cameras of 10, 12 or 14 bits fill types of 16 bits in four ways, v being the camera's number and b its bits:

    plain            v                          the full scale is 2^b − 1
    left-justified   v·2^(16−b)                 all numbers have a common factor
    replicated       v·2^(16−b) + v >> (2b−16)  the upper bits again in the lower ones: white is 65535
    scaled           v·65535/(2^b − 1), rounded, or v times any other whole number

Each tells itself by the values that don't occur: of n different values of 16 bits, all lie by chance on the 2^b that a
layout of b bits has with a probability of 2^(−n(16−b)).

Clipped numbers pile up at the largest value. Below it the histogram goes on smoothly, so that the largest value of a
picture that isn't clipped is about as rare as its neighbours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Layout = Literal["plain", "left-justified", "replicated", "scaled"]

_USUAL_BITS = (8, 10, 12, 14)
_EVIDENCE_BITS = 40.0  # of a layout against chance: 1e-12
_NEIGHBOURS = 16  # share of the range below the largest value with which it is compared
_LEAST_CLIPPED = 8  # samples
_TIMES = 6  # as often as its neighbours must the largest value occur
_WIDEST_GAP = 0.25  # between values that occur, as a share of those compared
_PART = 1 << 22  # samples


@dataclass(frozen=True)
class Clipping:
    """The value at which samples are clipped, and the share of all samples that have it."""

    level: float
    share: float


@dataclass(frozen=True)
class SampleBits:
    """The bits of unsigned whole numbers.

    container: bits of their type. significant: bits that they use. step: the factor that all have in common.
    full_scale: the number of white or of a saturated pixel. is_sure: whether the numbers show this full scale;
    otherwise it is that of the type. top: the largest number.
    """

    container: int
    significant: int
    layout: Layout
    step: int
    full_scale: int
    is_sure: bool
    top: int

    def describe(self) -> str:
        """In words, such as "12 bits left-justified in 16"."""
        if self.layout == "scaled" and self.step > 1:
            return f"multiples of {self.step}"
        if self.significant == self.container:
            return f"{self.container} bits"
        how = {"plain": "", "left-justified": " left-justified", "replicated": " replicated", "scaled": " scaled"}
        return f"{self.significant} bits{how[self.layout]} in {self.container}"


def find_bits(samples: NDArray[Any]) -> SampleBits:
    """The bits of samples (any shape) of the type uint8 or uint16. Raises ValueError for other types and no samples."""
    if samples.dtype not in (np.uint8, np.uint16) or not samples.size:
        raise ValueError(f"{samples.size} samples of type {samples.dtype}")
    container = 8 * samples.dtype.itemsize
    levels = np.flatnonzero(_histogram(samples))
    top, full = int(levels[-1]), (1 << container) - 1
    step = int(np.gcd.reduce(levels))
    if step > 1 and _evidence(levels, math.log2(step)):
        zeros = step.bit_length() - 1
        if step == 257:
            return SampleBits(container, 8, "replicated", step, full, True, top)
        if step == 1 << zeros:
            return SampleBits(container, container - zeros, "left-justified", step, full // step * step, True, top)
        return SampleBits(container, (top // step).bit_length(), "scaled", step, full // step * step, False, top)
    for bits in range(9, 16) if container == 16 else ():
        if (layout := _filled_up(levels, bits)) is not None:
            return SampleBits(container, bits, layout, 1, full, True, top)
    bits = next((b for b in _USUAL_BITS if top < 1 << b), container)
    is_sure = top in ((1 << bits) - 1, full)
    return SampleBits(container, bits, "plain", 1, (1 << bits) - 1 if is_sure else full, is_sure, top)


def _filled_up(levels: NDArray[np.integer], bits: int) -> Layout | None:
    """How all values of so many bits were brought to the whole range of 16, None if they weren't."""
    if not _evidence(levels, 16 - bits):
        return None
    upper = levels >> (16 - bits)
    if ((upper << (16 - bits) | upper >> (2 * bits - 16)) == levels).all():
        return "replicated"
    scale = 65535 / ((1 << bits) - 1)
    number = np.rint(levels / scale)  # of the camera: rounding down moves a value by less than half a step
    is_scaled = (np.rint(number * scale) == levels).all() or (np.floor(number * scale) == levels).all()
    return "scaled" if is_scaled else None


def _evidence(levels: NDArray[np.integer], bits_each: float) -> bool:
    """Whether a layout that keeps a value with the probability 2^−bits_each can't be chance: 0 and the largest value
    tell nothing."""
    return bits_each * (len(levels) - 2) >= _EVIDENCE_BITS


def find_clipping(values: NDArray[Any]) -> Clipping | None:
    """Where real values (any shape) are clipped, None if they aren't.

    The largest value must be more than six times as frequent as any within a sixteenth of the range below it, and these
    must leave no wide gap: drawings of a few even tones, and fringes whose period is nearly a few samples, have no
    values there. At the crest of other fringes it is 1/(√2 − 1) = 2.4 times as frequent as the next one.
    """
    if not values.size:
        return None
    if values.dtype in (np.uint8, np.uint16):
        histogram = _histogram(values)
        levels: NDArray[Any] = np.flatnonzero(histogram)
        counts = histogram[levels]
    else:
        top = values.max()
        if np.count_nonzero(values == top) < _LEAST_CLIPPED or not math.isfinite(top - values.min()):
            return None
        levels, counts = np.unique(values[values >= _first_near(values.min(), top)], return_counts=True)
        levels, counts = np.append(values.min(), levels), np.append(0, counts)
    top, count, first = float(levels[-1]), int(counts[-1]), _first_near(levels[0], levels[-1])
    is_near = levels >= first
    near = counts[is_near][:-1]
    if min(count, near.sum()) < _LEAST_CLIPPED or count <= _TIMES * int(near.max()) + _LEAST_CLIPPED:
        return None
    gaps = np.diff(levels[is_near].astype(float), prepend=first)
    if gaps.max() > max(_WIDEST_GAP * (top - first), 1.0 if values.dtype.kind in "iu" else 0.0):
        return None
    return Clipping(top, count / values.size)


def _first_near(low: Any, top: Any) -> float:
    """The least value that is compared with the largest one."""
    return float(top) - (float(top) - float(low)) / _NEIGHBOURS


def _histogram(samples: NDArray[Any]) -> NDArray[np.int64]:
    """How often each number of the type occurs, counted in parts, because each part is copied to 64 bits."""
    flat = samples.reshape(-1)
    counts = np.zeros(1 << 8 * samples.dtype.itemsize, np.int64)
    for first in range(0, flat.size, _PART):
        counts += np.bincount(flat[first : first + _PART], minlength=counts.size)
    return counts
