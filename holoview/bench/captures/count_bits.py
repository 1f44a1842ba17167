"""Counts of captures in the bits that are stated: left-justified, filled up to 16 bits, or clipped too low.

`counts_as_stated` puts right what is sure when pictures are imported, `with_clipped_as_saturated` what a diagnosis or a
calibration can't use; `bits_error` is the error for captures whose counts contradict `bit_depth`, with the advice that
mends them.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.light.numerics.sample_bits import SampleBits, find_bits, find_clipping
from holoview.util.errors import UserError
from holoview.util.progress import TextCallback

_MOST_JUDGED = 1 << 25  # counts, of captures evenly spread
_WHERE = "camera/images"


def counts_as_stated(images: NDArray[np.uint16], bit_depth: int, tell: TextCallback) -> NDArray[np.uint16]:
    """The pictures (capture, y, x) in counts of a camera of so many bits; `tell` hears what was changed.

    Counts that are left-justified or filled up to 16 bits are brought back where `bit_depth` says how many bits they
    are of. Counts at which the camera clips below its full scale become saturated ones. Raises UserError as
    `bits_error` describes for others.
    """
    if not 1 <= bit_depth <= 16:
        return images  # an error of the description, which `check_captures` names
    saturation = (1 << bit_depth) - 1
    bits = find_bits(_some(images))
    if int(images.max()) > saturation:
        counts = _in_lower_bits(images, bits, bit_depth)
        if counts is not None:
            tell(
                f"all counts are {_words(bits)}: they were brought back to {bit_depth} bits, as bit_depth says; "
                "black_level and electrons_per_count are taken as of these counts"
            )
            return counts_as_stated(counts, bit_depth, tell)
    error = bits_error(images, bit_depth)
    if error is not None:
        raise error
    return _clipped_as_saturated(images, saturation, tell)


def with_clipped_as_saturated(captures: Captures, tell: TextCallback) -> Captures:
    """The captures with the counts at which the camera clips below its full scale as saturated ones, which say of the
    light only that it was more; `tell` hears of them. The same captures where nothing is clipped."""
    images = _clipped_as_saturated(captures.images, captures.camera.saturation, tell)
    return captures if images is captures.images else dataclasses.replace(captures, images=images)


def _clipped_as_saturated(images: NDArray[np.uint16], saturation: int, tell: TextCallback) -> NDArray[np.uint16]:
    clip = find_clipping(_some(images))
    if clip is None or clip.level >= saturation:
        return images
    said = f"{clip.share:.2%} of the counts are {clip.level:g}, the largest, and few are just below"
    tell(f"{said}: the camera clipped there, below the {saturation} of its bit_depth; they are taken as saturated")
    return np.where(images >= clip.level, np.uint16(saturation), images)


def bits_error(images: NDArray[np.uint16], bit_depth: int) -> UserError | None:
    """The error for counts (capture, y, x) that contradict the bits that are stated, None where they don't.

    These are counts above the full scale, counts with a factor in common, and counts that are clipped at the full scale
    of fewer bits.
    """
    saturation, highest = (1 << bit_depth) - 1, int(images.max())
    bits = find_bits(_some(images))
    expected = f"0 to {saturation} at {bit_depth} bits"
    if bits.layout == "plain":
        clip = find_clipping(_some(images))
        if clip is not None and bits.significant < bit_depth and clip.level == (1 << bits.significant) - 1:
            found = f"{clip.share:.2%} of the counts are {clip.level:g}, the largest, as of {bits.significant} bits"
            return UserError(_WHERE, found, expected=expected, remedy=f"state bit_depth = {bits.significant}")
        if highest > saturation:
            return UserError(_WHERE, f"{highest} counts", expected=expected, remedy="correct bit_depth")
        return None
    container = bit_depth if highest <= saturation else 16
    used = container - bits.step.bit_length() + 1 if bits.layout == "left-justified" else bits.significant
    found = f"all counts up to {highest} are {_words(bits)}"
    of_them = f"counts divided by {bits.step}" if bits.step > 1 else f"counts of {used} bits"
    remedy = (
        f"state bit_depth = {used}, black_level and electrons_per_count of {of_them}: `captures import` "
        "then brings them back, in a capture file do it yourself"
    )
    return UserError(_WHERE, found, expected="the counts of the camera", remedy=remedy)


def _in_lower_bits(images: NDArray[np.uint16], bits: SampleBits, bit_depth: int) -> NDArray[np.uint16] | None:
    """Counts of `bit_depth` bits that were left-justified, multiplied or filled up to 16, None for others."""
    if bits.layout in ("left-justified", "scaled") and bits.step > 1:
        justified = 1 << (16 - bit_depth)
        step = justified if bits.layout == "left-justified" and bits.step % justified == 0 else bits.step
        is_whole = not (images % np.uint16(step)).any()
        return images // np.uint16(step) if is_whole and images.max() // step < 1 << bit_depth else None
    if bits.layout == "plain" or bits.significant != bit_depth:
        return None
    counts: NDArray[np.uint16] = np.rint(images * (((1 << bit_depth) - 1) / 65535)).astype(np.uint16)
    return counts


def _some(images: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Captures by which all are judged."""
    step = max(images.size // _MOST_JUDGED, 1)
    return images[:: min(step, len(images))]


def _words(bits: SampleBits) -> str:
    """The layout in words, without the bits of counts that are multiples: these follow from those that are stated."""
    return f"multiples of {bits.step}" if bits.step > 1 else bits.describe()
