"""Targets and scores of a hologram for several places of the eye's pupil, at those that were used and at others."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.commands.optimise_target import TargetSource
from holoview.commands.pupil_places import PupilPlaces
from holoview.io.hologram import Hologram
from holoview.metrics.image_quality import measure_image_quality, plane_midpoints
from holoview.model.focus import focused_planes
from holoview.model.system import System
from holoview.numerics.image_region import Region, region_slices
from holoview.optimise.drawn_pupils import StacksAt
from holoview.util.errors import UserError
from holoview.view import simulate

_HEADINGS = {
    "pupil_psnr_db": "from the pupil's places",
    "held_out_pupil_psnr_db": "from places that weren't used",
    "held_out_pupil_psnr_between_db": "from these, focused between the planes",
}


def target_at_places(source: TargetSource, system: System, pupils: PupilPlaces) -> NDArray[np.float32] | StacksAt:
    """The focal stacks (place · plane, y, x, 3) as an eye at each place sees them; from its own place without any.

    For places that are drawn, a function of the places that gives them.
    """
    if pupils.drawn:
        return source.moving(pupils.radius_m, system)
    if not pupils.fixed:
        return source.build(system=system).stack
    if source.is_stack:
        raise UserError(
            "--pupils", "with a focal stack", expected="a picture or a light field, which is seen from every place"
        )
    return np.concatenate([source.build(system=_seen_from(system, place)).stack for place in pupils.fixed])


def score_places(
    hologram: Hologram, source: TargetSource, pupils: PupilPlaces, region: Region | None
) -> dict[str, list[float]]:
    """PSNR (dB) from each place, and from places that weren't used, as JSON keys and values; empty without places.

    From the latter also focused halfway between neighbouring planes, for which nothing was optimised either.
    """
    planes_m = focused_planes(hologram.system)
    between_m = plane_midpoints(planes_m)
    scores: dict[str, list[float]] = {key: [] for key in _HEADINGS}
    scores["pupil_psnr_db"] = [_psnr_db(hologram, source, place, None, region) for place in pupils.fixed]
    for place in pupils.held_out:
        scores["held_out_pupil_psnr_db"].append(_psnr_db(hologram, source, place, None, region))
        if len(between_m):
            scores["held_out_pupil_psnr_between_db"].append(_psnr_db(hologram, source, place, between_m, region))
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
    planes_m: NDArray[np.float64] | None,
    region: Region | None,
) -> float:
    system = _seen_from(hologram.system, place)
    view = simulate(system, hologram.drive, planes_m, backend="torch")
    target = source.build(planes_m, system=system).stack
    if region is not None:
        view, target = view.cropped(region), target[:, *region_slices(region)]
    return measure_image_quality(view, target).psnr.mean_db


def _seen_from(system: System, place: tuple[float, float]) -> System:
    assert system.eye is not None
    return system.with_(eye=system.eye.moved_to(place))
