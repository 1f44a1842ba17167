"""The middle of captures: large modulators and many captures then cost no more to compare than small ones.

In the near field light walks off sideways by distance × the sine of the steepest ray that the stops pass. With as much
margin around the compared pixels, a crop is predicted like the whole. On a Fourier bench every camera pixel sees all of
the modulator: its levels can't be cut, and not be binned either, since phases wrap. But a Fourier sum is computed at
any window of the camera alone, so that a crop of the picture is predicted exactly.

Crops are centred on the axis, so that mirrored or turned records stay mirrored or turned.
"""

from __future__ import annotations

import dataclasses
import math

from holoview.captures.dataset import Captures


def central_region(captures: Captures, side_px: int, further_px: int = 0) -> Captures:
    """The captures cut to about `side_px` modulator pixels across, with the margin beside.

    further_px: more margin, for light that hard edges of a stop spread beyond its steepest ray. On a Fourier bench the
    pictures are cut to as many speckles of the longest wavelength across, with the margin on either side.
    """
    if captures.is_fourier:
        return _cut_pictures(captures, _speckles_px(captures, side_px + 2 * further_px))
    pitch_m = captures.slms[0].pitch_m
    margin = math.ceil(_walk_off_m(captures) / pitch_m) + further_px
    rows, columns = (_kept(n, side_px + 2 * margin) for n in captures.levels.shape[2:])
    if (rows, columns) == captures.levels.shape[2:]:
        return captures
    scale = pitch_m / captures.camera.pitch_m
    seen = [
        _kept(n, math.floor((kept - 2 * margin) * scale) if kept < whole else n)
        for n, kept, whole in zip(captures.shape, (rows, columns), captures.levels.shape[2:], strict=True)
    ]
    middle = (..., *central_slices(captures.levels.shape[2:], (rows, columns)))
    before, first = captures.levels_before, captures.levels_first
    return dataclasses.replace(
        _cut_pictures(captures, (seen[0], seen[1])),
        levels=captures.levels[middle],
        levels_before=None if before is None else before[middle],
        levels_first=None if first is None else first[middle],
        slm_frame=captures.slm_frame or (captures.levels.shape[2], captures.levels.shape[3]),
    )


def speckle_px(captures: Captures) -> tuple[float, float]:
    """Width (y, x) of a speckle of the longest wavelength on a Fourier bench, λf/(width of the modulator), in pixels.

    At least 1: a smaller one is seen by one pixel.
    """
    light = float(captures.wavelength_m.max()) * (captures.focal_length_m or 0.0) / captures.camera.pitch_m
    y, x = (max(1.0, light / (n * captures.slms[0].pitch_m)) for n in captures.levels.shape[2:])
    return y, x


def _speckles_px(captures: Captures, count: int) -> tuple[int, int]:
    """The pixels (rows, columns) that so many speckles of a Fourier bench take, at most all."""
    rows, columns = (
        _kept(n, math.ceil(count * px)) for n, px in zip(captures.shape, speckle_px(captures), strict=True)
    )
    return rows, columns


def _cut_pictures(captures: Captures, shape: tuple[int, int]) -> Captures:
    """The captures with pictures cut to their middle (rows, columns)."""
    if shape == captures.shape:
        return captures
    middle = (..., *central_slices(captures.shape, shape))
    return dataclasses.replace(captures, images=captures.images[middle], frame=captures.frame or captures.shape)


def central_captures(captures: Captures, most: int) -> Captures:
    """The captures without those at either end, if there are more than about `most`.

    Neighbours stay neighbours, and a column from the last to the first stays one.
    """
    count = _kept(len(captures), most)
    first = (len(captures) - count) // 2
    return captures if count == len(captures) else captures.subset(range(first, first + count))


def _walk_off_m(captures: Captures) -> float:
    """Largest sideways walk of a ray from the first modulator to the camera."""
    pitch_m, longest = captures.slms[0].pitch_m, float(captures.wavelength_m.max())
    paths = ((captures.gap_m or 0.0, captures.relay1), (float(captures.distance_m.max()), captures.relay2))
    return sum(length * relay.first_order_sine(longest, pitch_m) for length, relay in paths if length)


def _kept(n: int, wanted: int) -> int:
    """At most `wanted` of n pixels, as many left out on either side."""
    return n if wanted >= n else wanted + (n - wanted) % 2


def central_slices(whole: tuple[int, ...], kept: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of the middle `kept` of `whole` pixels."""
    first = [(n - k) // 2 for n, k in zip(whole, kept, strict=True)]
    return slice(first[0], first[0] + kept[0]), slice(first[1], first[1] + kept[1])
