"""Scores of a hologram on its bench's own grid: at its planes, between them, and from places of the eye's pupil."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.io.hologram import Hologram
from holoview.metrics.image_quality import (
    ImageQuality,
    central_region,
    eyebox_uniformity_of,
    measure_image_quality,
    plane_midpoints,
)
from holoview.metrics.perceptual import measure_perceptual_scores
from holoview.metrics.psnr import psnr_linear_srgb
from holoview.model.focus import focused_planes, with_pupil_at
from holoview.numerics.tensors import Region, region_slices
from holoview.optimise.eyes import PupilPlaces
from holoview.targets.target_source import TargetSource
from holoview.view import View, simulate

PLACE_SCORES = ("pupil_psnr_db", "held_out_pupil_psnr_db", "held_out_pupil_psnr_between_db")
"""Scores from the places of the pupil, from places that weren't used, and from these between the planes."""

Floats = NDArray[np.floating]


@dataclass(frozen=True)
class ScoredImages:
    """What an observer sees of a hologram, and the target, at the planes of its bench and at held-out planes.

    view: at all planes, the held-out ones last. target: (plane, y, x, 3), linear sRGB, at the same planes.
    held_out_m: distances of the held-out planes, for which the patterns weren't optimised.
    """

    view: View
    target: Floats
    held_out_m: NDArray[np.float64]


def render_for_score(hologram: Hologram, source: TargetSource) -> ScoredImages:
    """Renders a hologram at its planes and halfway between neighbouring ones.

    A target that is a focal stack has no images between its planes, so that no plane is held out.
    """
    planes_m = focused_planes(hologram.system)
    held_out_m = np.array([]) if source.is_stack else plane_midpoints(planes_m)
    all_m = np.concatenate([planes_m, held_out_m])
    target = source.build(None if source.is_stack else all_m).stack
    return ScoredImages(simulate(hologram.system, hologram.drive, all_m, backend="torch"), target, held_out_m)


def score_hologram(
    hologram: Hologram, images: ScoredImages, region: Region | None, further: Sequence[str] = ()
) -> dict[str, Any]:
    """The scores of a hologram as JSON keys and values.

    region: x, y, width, height in samples, inside which images are compared; None for all of them. further: names of
    `OPTIONAL_SCORES` to add.

    Raises UserError when an image is too small for one of the scores.
    """
    view, target, held_out = images.view, images.target, images.held_out_m
    count = len(view.planes_m) - len(held_out)
    quality = _measure(view.at(range(count)), target[:count], region)
    eyebox = eyebox_uniformity_of(hologram)
    perceptual = measure_perceptual_scores(*_cropped(view.at(range(count)), target[:count], region), further)
    between = [_measure(view.at([i]), target[i : i + 1], region) for i in range(count, len(view.planes_m))]
    return {
        "psnr_db": quality.psnr.mean_db,
        "psnr_planes_db": list(quality.psnr.planes_db),
        "psnr_luminance_db": quality.psnr_luminance.mean_db,
        "held_out_planes_mm": [round(float(z) * 1e3, 6) for z in held_out],
        "held_out_psnr_planes_db": [one.psnr.mean_db for one in between],
        "held_out_psnr_db": float(np.mean([one.psnr.mean_db for one in between])) if between else None,
        "delta_e": quality.delta_e,
        "ms_ssim": None if quality.ms_ssim is None else quality.ms_ssim.mean,
        "ms_ssim_scales": None if quality.ms_ssim is None else quality.ms_ssim.scales,
        **{name: score.mean for name, score in perceptual.items()},
        **{f"{name}_planes": list(score.planes) for name, score in perceptual.items()},
        "speckle_contrast": quality.mean_speckle_contrast,
        "eyebox_uniformity": eyebox.uniformity,
        "eyebox_variation": eyebox.coefficient_of_variation,
        "eyebox_centre_share": eyebox.centre_share,
    }


def _measure(view: View, target: Floats, region: Region | None) -> ImageQuality:
    """Quality of a view beside its target (plane, y, x, 3) inside a region."""
    view, target = _cropped(view, target, region)
    return measure_image_quality(view, target, _speckle_region(target))


def _cropped(view: View, target: Floats, region: Region | None) -> tuple[View, Floats]:
    """A view and its target (plane, y, x, 3) inside a region."""
    return (view, target) if region is None else (view.cropped(region), target[:, *region_slices(region)])


def _speckle_region(target: Floats) -> Region | None:
    """The region for the speckle contrast: None for the central half, or all of it if that is black in some plane."""
    lit = target[:, *region_slices(central_region(target.shape[1:3]))].any(axis=(1, 2, 3)).all()
    return None if lit else (0, 0, target.shape[2], target.shape[1])


def score_places(
    hologram: Hologram, source: TargetSource, pupils: PupilPlaces, region: Region | None
) -> dict[str, list[float]]:
    """PSNR (dB) from each place, and from places that weren't used, as JSON keys and values; empty without places.

    From the latter also focused halfway between neighbouring planes, for which nothing was optimised either.
    """
    planes_m = focused_planes(hologram.system)
    count, all_m = len(planes_m), np.concatenate([planes_m, plane_midpoints(planes_m)])
    scores: dict[str, list[float]] = {key: [] for key in PLACE_SCORES}
    for place in pupils.fixed:
        scores["pupil_psnr_db"].append(float(np.mean(_psnr_db(hologram, source, place, planes_m, region))))
    for place in pupils.held_out:
        found = _psnr_db(hologram, source, place, all_m, region)
        scores["held_out_pupil_psnr_db"].append(float(np.mean(found[:count])))
        if len(found) > count:
            scores["held_out_pupil_psnr_between_db"].append(float(np.mean(found[count:])))
    return {key: values for key, values in scores.items() if values}


def _psnr_db(
    hologram: Hologram,
    source: TargetSource,
    place: tuple[float, float],
    planes_m: NDArray[np.float64],
    region: Region | None,
) -> tuple[float, ...]:
    """PSNR on each plane, seen from a place."""
    system = with_pupil_at(hologram.system, place)
    view = simulate(system, hologram.drive, planes_m, backend="torch")
    target = source.build(planes_m, system=system).stack
    if region is not None:
        view, target = view.cropped(region), target[:, *region_slices(region)]
    return psnr_linear_srgb(view.rgb, target).planes_db
