"""Scores of a hologram for several places of the eye's pupil, at those that were used and at others."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.commands.optimise_target import TargetSource
from holoview.io.hologram import Hologram
from holoview.metrics.image_quality import plane_midpoints
from holoview.metrics.psnr import psnr_linear_srgb
from holoview.model.focus import focused_planes, with_pupil_at
from holoview.numerics.tensors import Region, region_slices
from holoview.optimise.eyes import PupilPlaces
from holoview.view import simulate

_HEADINGS = {
    "pupil_psnr_db": "from the pupil's places",
    "held_out_pupil_psnr_db": "from places that weren't used",
    "held_out_pupil_psnr_between_db": "from these, focused between the planes",
}


def score_places(
    hologram: Hologram, source: TargetSource, pupils: PupilPlaces, region: Region | None
) -> dict[str, list[float]]:
    """PSNR (dB) from each place, and from places that weren't used, as JSON keys and values; empty without places.

    From the latter also focused halfway between neighbouring planes, for which nothing was optimised either.
    """
    planes_m = focused_planes(hologram.system)
    count, all_m = len(planes_m), np.concatenate([planes_m, plane_midpoints(planes_m)])
    scores: dict[str, list[float]] = {key: [] for key in _HEADINGS}
    for place in pupils.fixed:
        scores["pupil_psnr_db"].append(float(np.mean(_psnr_db(hologram, source, place, planes_m, region))))
    for place in pupils.held_out:
        found = _psnr_db(hologram, source, place, all_m, region)
        scores["held_out_pupil_psnr_db"].append(float(np.mean(found[:count])))
        if len(found) > count:
            scores["held_out_pupil_psnr_between_db"].append(float(np.mean(found[count:])))
    return {key: values for key, values in scores.items() if values}


def format_place_scores(scores: dict[str, Any]) -> list[str]:
    """The scores of `score_places` as lines of text."""
    return [
        f"{what}: {np.mean(scores[key]):.2f} dB, {min(scores[key]):.2f} to {max(scores[key]):.2f}"
        for key, what in _HEADINGS.items()
        if key in scores
    ]


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
