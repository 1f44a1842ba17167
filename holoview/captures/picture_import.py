"""Captures from one camera picture and the pattern that was shown: a Fourier bench of which little is known.

What nobody stated is found or assumed, and said: the orientation, the scale (and so the focal length) and the axis by
`picture_geometry`, the black level from the darkest pixels, the noise from neighbouring dark pixels. Electrons per
count, which a single picture doesn't tell, are assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Camera, Captures, SlmSpec, undone
from holoview.captures.picture_geometry import Placement, find_placements, upright_place, zero_order_mask
from holoview.captures.validation import check_captures
from holoview.numerics.speckle_match import SpeckleMatch
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback, no_progress

_FULL_WELL = 10_000.0  # electrons of a full pixel, where nobody knows
_DARK_SHARE = 0.005  # of the pixels, the darkest, which tell the black level
_CLEAR = 1.1  # ratio of the speckle's correlation over that of the next placement
_LEAST_SIGNIFICANCE = 4.0  # standard deviations by which the speckle of a placement has to stand out


@dataclass(frozen=True, eq=False)
class ImportedPicture:
    """The captures of a picture, its placement with the other ones, and what was assumed, in sentences."""

    captures: Captures
    placements: tuple[Placement, ...]
    notes: tuple[str, ...]


def import_picture(
    picture: NDArray[np.unsignedinteger],
    pattern: NDArray[np.unsignedinteger],
    *,
    wavelength_m: float,
    pitch_m: float,
    camera_pitch_m: float,
    focal_length_m: float | None = None,
    stroke_m: float | None = None,
    bit_depth: int | None = None,
    progress: ProgressCallback = no_progress,
) -> ImportedPicture:
    """Captures of a picture (y, x) in counts and a pattern (row, column) in levels, on a Fourier bench.

    focal_length_m: stated, which is looked for within 15 %; any when None. stroke_m: optical path between level 0 and
    the highest; a wavelength when None. bit_depth: of the picture; the smallest that holds its counts when None.

    Raises UserError for pictures that are nearly dark, and where no placement of the pattern's spectrum lets speckle
    stand: then the pattern isn't that of the picture, or the geometry isn't that of a Fourier bench.
    """
    notes: list[str] = []
    bits = bit_depth or next(b for b in (8, 10, 12, 14, 16) if int(picture.max()) < 2**b)
    saturation = 2**bits - 1
    levels = 256 if int(pattern.max()) < 256 else 65536
    _require_speckle(picture, pattern)
    scale = None if focal_length_m is None else wavelength_m * focal_length_m / (pitch_m * camera_pitch_m)
    placements = find_placements(picture.astype(np.float64), pattern / (levels - 1), saturation, scale, progress)
    best, speckle = placements[0], _standing(placements[0])
    found_m = best.scale_px * pitch_m * camera_pitch_m / wavelength_m
    shift = speckle.shift
    upright_axis = upright_place(best.axis_px, picture.shape, best.orientation)
    axis = (upright_axis[0] + shift[0], upright_axis[1] + shift[1])
    notes += _placement_notes(placements, found_m, focal_length_m)
    images = undone(picture, best.orientation).astype(np.uint16)
    cut = undone(zero_order_mask(picture, saturation), best.orientation)
    if cut.any():
        images = np.where(cut, saturation, images).astype(np.uint16)
        notes.append(f"the saturated zero order and its rim ({100 * cut.mean():.2g} % of the picture) are left out")
    camera = _assumed_camera(picture, camera_pitch_m, bits, notes)
    if stroke_m is None:
        notes.append(f"assumed: the highest level is a full turn at {units.format_rounded(wavelength_m, 'nm')}")
    middle = [(n - 1) / 2 for n in images.shape]
    axis_m = ((axis[0] - middle[0]) * camera_pitch_m, (axis[1] - middle[1]) * camera_pitch_m)
    captures = Captures(
        levels=pattern[None, None],
        images=images[None],
        wavelength_m=np.array([wavelength_m]),
        distance_m=np.zeros(1),
        power=np.ones(1),
        exposure_s=np.ones(1),
        slms=(SlmSpec(pitch_m, levels, stroke_m or wavelength_m),),
        camera=camera,
        focal_length_m=found_m,
        axis_m=axis_m,
    )
    check_captures(captures)
    return ImportedPicture(captures, tuple(placements), tuple(notes))


def _require_speckle(picture: NDArray[np.unsignedinteger], pattern: NDArray[np.unsignedinteger]) -> None:
    """Raises UserError for pictures and patterns in which no speckle can be compared."""
    if min(pattern.shape) < 16 or min(picture.shape) < 64:
        found = f"a picture of {picture.shape} and a pattern of {pattern.shape} pixels"
        raise UserError("picture", found, expected="at least 64 pixels and 16 pixels to a side")
    if float(np.quantile(picture, 0.999)) < 8:
        raise UserError(
            "picture", f"at most {picture.max()} counts", expected="a picture of speckle", remedy="expose longer"
        )
    if pattern.min() == pattern.max():
        raise UserError("pattern", f"level {pattern.max()} everywhere", expected="a pattern that diffracts light")


def _standing(best: Placement) -> SpeckleMatch:
    """The match of the best placement's speckle. Raises UserError where it doesn't stand out."""
    if best.speckle is not None and best.speckle.significance >= _LEAST_SIGNIFICANCE:
        return best.speckle
    significance = 0.0 if best.speckle is None else best.speckle.significance
    raise UserError(
        "picture",
        f"the pattern's speckle stands nowhere in it (best at {significance:.1f} standard deviations)",
        expected=f"a pattern whose speckle stands out by {_LEAST_SIGNIFICANCE:g}",
        remedy="check that this pattern was shown, the pitches and the wavelength",
    )


def _placement_notes(placements: list[Placement], found_m: float, stated_m: float | None) -> list[str]:
    """How the picture was placed, with the next best placement where that is nearly as likely."""
    best = placements[0]
    speckle, (y, x) = _standing(best), best.axis_px
    stated = "" if stated_m is None else f" (stated: {units.format_rounded(stated_m, 'mm')})"
    notes = [
        f"found: orientation {best.orientation}, focal length {units.format_rounded(found_m, 'mm', 4)}{stated}, axis "
        f"at row {y:.0f}, column {x:.0f}; the speckle stands at {speckle.significance:.1f} standard deviations"
    ]
    if len(placements) > 1 and placements[1].speckle is not None:
        ratio = speckle.correlation / max(placements[1].speckle.correlation, 1e-6)
        if ratio < _CLEAR:
            notes.append(
                f"orientation {placements[1].orientation} is nearly as likely: its speckle correlates {ratio:.2f} "
                "times less"
            )
    return notes


def _assumed_camera(picture: NDArray[np.unsignedinteger], pitch_m: float, bits: int, notes: list[str]) -> Camera:
    """The camera of a picture of so many bits; what was measured and assumed is added to the notes."""
    black = float(np.quantile(picture, _DARK_SHARE))
    noise = dark_noise(picture)
    gain = _FULL_WELL / (2**bits - 1)
    notes.append(
        f"assumed: black level {black:g} counts (the darkest {100 * _DARK_SHARE:g} %), read noise {noise:.2g} counts "
        f"(from neighbouring dark pixels), {gain:.3g} electrons a count (a full pixel of {_FULL_WELL:g}), which no "
        "single picture tells: χ²/n is relative to these"
    )
    return Camera(pitch_m, bits, gain, noise * gain, black)


def dark_noise(picture: NDArray[np.unsignedinteger]) -> float:
    """Standard deviation (counts) of dark pixels, from differences of neighbours in the darkest tenth, at least 0.3."""
    light = picture.astype(np.float64)
    means = (light[:, 1:] + light[:, :-1]) / 2
    differences = (light[:, 1:] - light[:, :-1])[means <= np.quantile(means, 0.1)]
    return max(float(differences.std()) / math.sqrt(2), 0.3) if len(differences) else 0.3
