"""The scale of a file's numbers: white or a whole turn, their bits, and where a camera clipped them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.interpret.properties import FileFindings
from holoview.light.numerics.sample_bits import find_bits, find_clipping

TURN = 2 * math.pi


def full_scale(samples: Sequence[NDArray[Any]]) -> float:
    """The greatest value of the integers of all parts of a field, as their bits show.

    It is that of the bits which the largest of them needs, 255, 1023, 4095 …; of left-justified ones, and of those that
    were filled up to 16 bits, that of their layout.
    """
    dtype, high = samples[0].dtype, max(float(sample.max()) for sample in samples)
    if dtype == np.uint16:
        found = [find_bits(sample) for sample in samples]
        if found[0].layout != "plain" and all((f.layout, f.step) == (found[0].layout, found[0].step) for f in found):
            return float(max(f.full_scale for f in found))
    bits = 8 * dtype.itemsize - (dtype.kind == "i")
    used = next((b for b in (8, 10, 12, 14, bits) if high < 2**b and b <= bits), bits)
    return float(2**used - 1)


def phase_levels(samples: Sequence[NDArray[Any]]) -> tuple[float, str]:
    """The number that stands for 2π in all parts, and why."""
    low = min(float(sample.min()) for sample in samples)
    high = max(float(sample.max()) for sample in samples)
    if samples[0].dtype.kind in "iu":
        full = full_scale(samples)
        return full, f"values up to {high:g}: {full:g} stands for 2π (programs differ: {full:g} or {full + 1:g})"
    if low >= 0 and high <= 1.0001:
        return 1.0, "values from 0 to 1: 1 stands for 2π"
    if low >= 0 and 7 < high <= 255.5:
        return 255.0, f"values up to {high:g}: 255 stands for 2π"
    return TURN, "radians"


def tell_bits(samples: Sequence[NDArray[Any]], findings: FileFindings) -> None:
    """States the bits of a camera's pictures of 16 bits, and at which number and how often they are clipped."""
    if samples[0].dtype == np.uint16:
        bits = find_bits(samples[0])
        findings.add("bits", bits.describe(), "file", f"its numbers, up to {bits.top:g}")
    clips = [clip for sample in samples if (clip := find_clipping(sample)) is not None]
    if clips:
        worst = max(clips, key=lambda clip: clip.share)
        said = f"{worst.share:.2%} of the samples are {worst.level:g}, the largest, and few are just below"
        findings.notes.append(f"{said}: the camera was saturated there")
