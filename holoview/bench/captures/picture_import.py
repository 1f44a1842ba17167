"""Captures from camera pictures and the patterns that were shown: a Fourier bench of which little is known.

What nobody stated is found or assumed, and said: the orientation, the scale (and so the focal length) and the axis by
`picture_geometry`, one for all pictures; the camera, powers and exposures by `unknown_settings`. The saturated zero
order, and what the user masks, count nowhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Camera, Captures, Masks, SlmSpec, undone
from holoview.bench.captures.picture_files import KnownNumber
from holoview.bench.captures.picture_geometry import (
    SpectrumPlacement,
    common_placement,
    find_placements,
    simple_prediction,
    upright_place,
    zero_order_mask,
)
from holoview.bench.captures.retrieved_placement import retrieved_placement
from holoview.bench.captures.unknown_settings import PLACE, with_estimates
from holoview.bench.captures.validation import check_captures
from holoview.light.model.fields import Integer, Maybe, Number, described_field, flag_of, validate, with_field_docs
from holoview.light.numerics.speckle_match import SpeckleMatch
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.figures import CaptionedTile, contact_sheet, greyscale_pixels
from holoview.util.progress import ProgressCallback, no_progress

_CLEAR = 1.1  # ratio of the speckle's correlation over that of the next placement
_LEAST_SIGNIFICANCE = 7.0
"""Standard deviations by which the speckle of a placement has to stand out. Other patterns of the same target, whose
envelopes are alike, reached 5.7, unlike ones 3.9; those that were shown 13 with 2 rad of coma, 37 with less."""
_LEAST_SEEN = 0.2  # of the pattern's far field that the picture's longer side has to show
_MOST_APART_PX = 3  # by which a picture's speckle may lie beside that of the others without a word
_ZOOM_PX = 160  # of the window in which an overlay shows speckle
_WHITE = 0.995  # of the pixels are darker than what an overlay shows white


@dataclass(frozen=True)
class PictureAndPattern:
    """A camera picture (y, x), counts, and the pattern (row, column), levels, that was shown.

    name, pattern_name: for messages. power, exposure_s: NaN where nobody knows.
    """

    picture: NDArray[np.unsignedinteger]
    pattern: NDArray[np.unsignedinteger]
    name: str = "picture"
    pattern_name: str = "pattern"
    power: float = math.nan
    exposure_s: float = math.nan


@with_field_docs
@dataclass(frozen=True)
class KnownBench:
    """What is known of the Fourier bench of pictures. Raises UserError for lengths and numbers out of range.

    Fields:
    """

    wavelength_m: float = described_field(Number("nm", low=100e-9, high=10e-6), "Of the laser.")
    pitch_m: float = described_field(Number("um", low=0.1e-6, high=1e-3), "Of the modulator's pixels.")
    camera_pitch_m: float = described_field(Number("um", low=0.05e-6, high=1e-3), "Of the camera's pixels.")
    focal_length_m: float | None = described_field(
        Maybe(Number("mm", low=1e-4, high=10.0)),
        "About, within 15 %, which saves time; the focal length is found in any case.",
        default=None,
    )
    stroke_m: float | None = described_field(
        Maybe(Number("nm", low=1e-9, high=20e-6)),
        "Optical path of the modulator's highest level; a wavelength if absent.",
        default=None,
    )
    levels: int | None = described_field(
        Maybe(Integer(2, 65536)), "Of the modulator; 256 if absent, or 65 536 for patterns with more.", default=None
    )
    bit_depth: int | None = described_field(
        Maybe(Integer(1, 16)), "Of the camera; the least that holds the counts if absent.", default=None
    )
    electrons_per_count: float = described_field(
        KnownNumber(), "Photo-electrons a count; estimated if unknown.", default=math.nan
    )
    read_noise: float = described_field(
        KnownNumber(has_zero=True), "Electrons r.m.s.; estimated if unknown.", default=math.nan
    )
    black_level: float = described_field(
        KnownNumber(has_zero=True), "Counts without light; estimated if unknown.", default=math.nan
    )
    power: float = described_field(
        KnownNumber(), "Of the laser, in any unit, of all pictures; estimated if unknown.", default=math.nan
    )
    exposure_s: float = described_field(
        KnownNumber(), "Seconds, of all pictures; estimated if unknown.", default=math.nan
    )

    def __post_init__(self) -> None:
        validate(self, flag_of)


@dataclass(frozen=True, eq=False)
class ImportedPictures:
    """The captures of pictures, their placement with the other ones, and what was found and assumed, in sentences."""

    captures: Captures
    placements: tuple[SpectrumPlacement, ...]
    notes: tuple[str, ...]


def import_pictures(
    shown: Sequence[PictureAndPattern],
    known: KnownBench,
    *,
    usable: Masks | None = None,
    compression_counts: float = 0.0,
    progress: ProgressCallback = no_progress,
) -> ImportedPictures:
    """Captures of pictures and their patterns on one Fourier bench.

    usable: (y, x), False for pixels of the pictures, as they were taken, that don't count. compression_counts: r.m.s.
    error of compressed pictures.

    Raises UserError for pictures that are nearly dark or show too little of the far field, and where no placement of a
    pattern's spectrum lets speckle stand: then the pattern isn't that of the picture, which is named, or the geometry
    isn't that of a Fourier bench.
    """
    per_m = known.wavelength_m / (known.pitch_m * known.camera_pitch_m)
    scale = None if known.focal_length_m is None else known.focal_length_m * per_m
    _require_placeable(shown, scale)
    bits = known.bit_depth or _fewest_bits(shown)
    saturation = 2**bits - 1
    of_levels = known.levels or (256 if all(int(one.pattern.max()) < 256 for one in shown) else 65536)
    pictures = [one.picture.astype(np.float64) for one in shown]
    cuts = [zero_order_mask(one.picture, saturation) | (usable is not None and ~usable) for one in shown]
    phases = [one.pattern / (of_levels - 1) for one in shown]
    slm = SlmSpec(known.pitch_m, of_levels, known.stroke_m or known.wavelength_m)
    sensor = Camera(known.camera_pitch_m, bits, known.electrons_per_count, known.read_noise, known.black_level)
    found_by = f"{PLACE}, from the speckle of the pictures"

    def captures_of(placed: SpectrumPlacement) -> Captures:
        keep = np.stack([undone(~cut, placed.orientation) for cut in cuts])
        captures = _upright_captures(shown, placed, known, slm, sensor)
        captures = replace(captures, usable=None if keep.all() else keep, estimated=(found_by,))
        return with_estimates(captures, compression_counts)

    placements, stands = _placements(pictures, cuts, phases, scale, progress)
    if stands:
        best, matches = common_placement(pictures, cuts, phases, placements[0])
    else:
        best, matches = retrieved_placement(placements, captures_of)
    _require_standing(shown, matches)
    found_m = best.scale_px / per_m
    keep = np.stack([undone(~cut, best.orientation) for cut in cuts])
    captures = captures_of(best)
    notes = (
        *_placement_notes(placements, best, matches, found_m, known.focal_length_m),
        *_apart_notes(shown, matches),
        *_left_out_notes(shown, keep, saturation, usable is not None),
        *([] if known.stroke_m else [_assumed_turn(of_levels, known.wavelength_m)]),
        *(f"estimated: {sentence}" for sentence in captures.estimated if sentence != found_by),
    )
    check_captures(captures)
    return ImportedPictures(captures, (best, *placements[1:]), notes)


def _assumed_turn(levels: int, wavelength_m: float) -> str:
    turn = units.format_rounded(wavelength_m, "nm")
    return f"assumed: level {levels - 1} is a full turn at {turn}, even light, one modulator"


def _fewest_bits(shown: Sequence[PictureAndPattern]) -> int:
    """The least bits of a camera that hold all counts."""
    highest = max(int(one.picture.max()) for one in shown)
    return next(bits for bits in (8, 10, 12, 14, 16) if highest < 2**bits)


def _upright_captures(
    shown: Sequence[PictureAndPattern], placed: SpectrumPlacement, known: KnownBench, slm: SlmSpec, camera: Camera
) -> Captures:
    """The captures with upright pictures, whose focal length and axis are those of the placement."""
    axis = upright_place(placed.axis_px, shown[0].picture.shape, placed.orientation)
    images = np.stack([undone(one.picture, placed.orientation) for one in shown]).astype(np.uint16)
    rows, columns = images.shape[1:]
    return Captures(
        levels=np.stack([one.pattern for one in shown])[:, None],
        images=images,
        wavelength_m=np.full(len(shown), known.wavelength_m),
        distance_m=np.zeros(len(shown)),
        power=np.array([one.power if math.isnan(known.power) else known.power for one in shown]),
        exposure_s=np.array([one.exposure_s if math.isnan(known.exposure_s) else known.exposure_s for one in shown]),
        slms=(slm,),
        camera=camera,
        focal_length_m=placed.scale_px * slm.pitch_m * camera.pitch_m / known.wavelength_m,
        axis_m=((axis[0] - (rows - 1) / 2) * camera.pitch_m, (axis[1] - (columns - 1) / 2) * camera.pitch_m),
    )


def _require_placeable(shown: Sequence[PictureAndPattern], scale: float | None) -> None:
    """Raises UserError for pictures that can't be placed together. scale: pixels a cycle of the pattern, if known."""
    _require_alike(shown)
    for one in shown:
        _require_speckle(one)
    _require_far_field(shown[0], scale)


def _require_alike(shown: Sequence[PictureAndPattern]) -> None:
    """Raises UserError for pictures, or patterns, of several shapes: they aren't of one bench."""
    for one in shown[1:]:
        for name, own, first in (
            (one.name, one.picture, shown[0].picture),
            (one.pattern_name, one.pattern, shown[0].pattern),
        ):
            if own.shape != first.shape:
                found = f"{own.shape[1]} × {own.shape[0]} pixels"
                raise UserError(name, found, expected=f"{first.shape[1]} × {first.shape[0]}, as the first")


def _require_speckle(one: PictureAndPattern) -> None:
    """Raises UserError for pictures and patterns in which no speckle can be compared."""
    if min(one.pattern.shape) < 16 or min(one.picture.shape) < 64:
        found = f"a picture of {one.picture.shape} and a pattern of {one.pattern.shape} pixels"
        raise UserError(one.name, found, expected="at least 64 pixels and 16 pixels to a side")
    if float(np.quantile(one.picture, 0.999)) < 8:
        raise UserError(
            one.name, f"at most {one.picture.max()} counts", expected="a picture of speckle", remedy="expose longer"
        )
    if one.pattern.min() == one.pattern.max():
        found = f"level {one.pattern.max()} everywhere"
        raise UserError(one.pattern_name, found, expected="a pattern that diffracts light")


def _require_far_field(one: PictureAndPattern, scale_px: float | None) -> None:
    longer = max(one.picture.shape)
    if scale_px is not None and longer < _LEAST_SEEN * scale_px:
        found = f"{longer} pixels of a far field that is {scale_px:.0f} pixels wide at this focal length"
        expected = f"at least {100 * _LEAST_SEEN:g} % of it"
        raise UserError(one.name, found, expected=expected, remedy="give the whole picture, or check the pitches")


def _placements(
    pictures: Sequence[NDArray[np.float64]],
    cuts: Sequence[Masks],
    phases: Sequence[NDArray[np.float64]],
    scale: float | None,
    progress: ProgressCallback,
) -> tuple[list[SpectrumPlacement], bool]:
    """The placements by the first picture whose speckle stands with a simple beam; else of the first, and False."""
    first = None
    for picture, cut, phase in zip(pictures, cuts, phases, strict=True):
        found = find_placements(picture, phase, cut, scale, progress)
        speckle = found[0].speckle
        if speckle is not None and speckle.significance >= _LEAST_SIGNIFICANCE:
            return found, True
        first = first or found
    return first or [], False


def _require_standing(shown: Sequence[PictureAndPattern], matches: Sequence[SpeckleMatch]) -> None:
    for one, match in zip(shown, matches, strict=True):
        if match.significance < _LEAST_SIGNIFICANCE:
            raise _never_shown(one, match.significance)


def _never_shown(one: PictureAndPattern, significance: float) -> UserError:
    found = f"the speckle of {one.pattern_name} stands nowhere in it (best at {significance:.1f} standard deviations)"
    return UserError(
        one.name,
        found,
        expected=f"a pattern whose speckle stands out by {_LEAST_SIGNIFICANCE:g}",
        remedy="check that this pattern was shown, the pitches and the wavelength",
    )


def _placement_notes(
    placements: Sequence[SpectrumPlacement],
    best: SpectrumPlacement,
    matches: Sequence[SpeckleMatch],
    found_m: float,
    stated_m: float | None,
) -> list[str]:
    """How the pictures were placed, with the next best placement where that is nearly as likely."""
    y, x = best.axis_px
    stated = "" if stated_m is None else f" (stated: {units.format_rounded(stated_m, 'mm')})"
    least = min(match.significance for match in matches)
    of_all = f" in each of {len(matches)} pictures, at least" if len(matches) > 1 else ""
    notes = [
        f"found: orientation {best.orientation}, focal length {units.format_rounded(found_m, 'mm', 4)}{stated}, axis "
        f"at row {y:.0f}, column {x:.0f}; the speckle stands{of_all} at {least:.1f} standard deviations"
    ]
    first, second = placements[0].speckle, placements[1].speckle if len(placements) > 1 else None
    if first is not None and second is not None:
        ratio = first.correlation / max(second.correlation, 1e-6)
        if ratio < _CLEAR:
            notes.append(
                f"orientation {placements[1].orientation} is nearly as likely: its speckle correlates {ratio:.2f} "
                "times less"
            )
    return notes


def _left_out_notes(shown: Sequence[PictureAndPattern], keep: Masks, saturation: int, is_masked: bool) -> list[str]:
    if keep.all():
        return []
    zero = float(np.mean([zero_order_mask(one.picture, saturation).mean() for one in shown]))
    masked = f", with what the mask leaves out {100 * (1 - keep.mean()):.2g} %" if is_masked else ""
    return [f"the saturated zero order and its rim ({100 * zero:.2g} % of a picture{masked}) are left out"]


def _apart_notes(shown: Sequence[PictureAndPattern], matches: Sequence[SpeckleMatch]) -> list[str]:
    shifts = np.array([match.shift for match in matches], dtype=np.float64)
    beside = np.abs(shifts - np.median(shifts, axis=0)).max(axis=1)
    return [
        f"{one.name}: its speckle lies {distance:.0f} pixels beside that of the other pictures"
        for one, distance in zip(shown, beside, strict=True)
        if distance > _MOST_APART_PX
    ]


def overlay_sheet(imported: ImportedPictures) -> NDArray[np.uint8]:
    """A sheet (y, x, 3) with a row for each picture (at most four): measured, predicted, both, and both enlarged.

    Upright; the square root of the light. In "both" the measured picture is red and the predicted one green, so that
    what agrees is yellow; the cross is the axis, blue is left out. Predicted with the simple beam and stroke whose
    speckle stood best.
    """
    captures, best = imported.captures, imported.placements[0]
    rows = []
    for k in np.unique(np.linspace(0, len(captures) - 1, 4).round().astype(int)).tolist():
        image, usable = captures.images[k].astype(np.float64), captures.usable_pixels(k)
        phase = captures.levels[k, 0] / (captures.slms[0].num_levels - 1)
        whole = (slice(0, captures.shape[0]), slice(0, captures.shape[1]))
        upright = replace(best, orientation="none", axis_px=_axis_px(captures))
        predicted = simple_prediction(phase, upright, captures.shape, whole)
        measured = _shades(image - captures.camera.black_level, usable)
        predicted = _shades(predicted, usable)
        both = greyscale_pixels(np.zeros_like(image))
        both[..., 0], both[..., 1] = greyscale_pixels(measured)[..., 0], greyscale_pixels(predicted)[..., 0]
        zoom = _zoom(measured, usable)
        enlarged = both[zoom].copy()
        both[..., 2] = np.where(usable, 0, 200)
        _draw_axis(both, upright.axis_px)
        tiles = [greyscale_pixels(measured), greyscale_pixels(predicted), both, enlarged]
        captions = [f"capture {k}", f"beam {best.beam:g}, stroke {best.stroke:g} of the assumed", "cross: axis"]
        captions.append(f"rows {zoom[0].start} to {zoom[0].stop}, columns {zoom[1].start} to {zoom[1].stop}")
        rows.append([CaptionedTile(pixels, text) for pixels, text in zip(tiles, captions, strict=True)])
    titles = ["measured", "predicted", "red measured, green predicted", "enlarged"]
    return contact_sheet("predicted over measured", titles, rows)


def _axis_px(captures: Captures) -> tuple[float, float]:
    y, x = (a / captures.camera.pitch_m + (n - 1) / 2 for a, n in zip(captures.axis_m, captures.shape, strict=True))
    return y, x


def _shades(light: NDArray[np.float64], usable: Masks) -> NDArray[np.float64]:
    white = max(float(np.quantile(light[usable], _WHITE)), 1e-30)
    return np.where(usable, np.sqrt(np.clip(light / white, 0, 1)), 0.0)


def _zoom(shades: NDArray[np.float64], usable: Masks) -> tuple[slice, slice]:
    """The square window of the picture with the most light."""
    side = min(_ZOOM_PX, *shades.shape)
    sums = np.pad(np.where(usable, shades, 0.0), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    light = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    y, x = (int(k) for k in np.unravel_index(int(light.argmax()), light.shape))
    return slice(y, y + side), slice(x, x + side)


def _draw_axis(pixels: NDArray[np.uint8], axis_px: tuple[float, float]) -> None:
    """Draws a white cross, in place, where the axis is in the picture."""
    y, x = (round(a) for a in axis_px)
    arm, width = max(pixels.shape[:2]) // 30, max(1, max(pixels.shape[:2]) // 480)
    for rows, columns in ((arm, width), (width, arm)):
        pixels[max(y - rows, 0) : max(y + rows + 1, 0), max(x - columns, 0) : max(x + columns + 1, 0)] = 255
