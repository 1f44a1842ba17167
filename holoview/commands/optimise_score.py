"""How good an optimised hologram is, on the preset's own grid: at the planes it was made for and between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.commands.optimise_options import TargetSource
from holoview.io.hologram import Hologram
from holoview.metrics.image_quality import (
    ImageQuality,
    central_region,
    eyebox_uniformity_of,
    measure_image_quality,
    plane_midpoints,
)
from holoview.model.system import System
from holoview.numerics.image_region import Region
from holoview.util import units
from holoview.util.errors import UserError
from holoview.view import View, simulate

Floats = NDArray[np.floating]


def score_hologram(hologram: Hologram, source: TargetSource, region: Region | None) -> dict[str, Any] | str:
    """Scores inside the region that was optimised; in words why there are none, e.g. of 4 x 4 pixels.

    Held-out planes lie halfway between neighbours; a ready stack has no pictures for them.
    """
    planes = hologram.system.planes_m
    held_out = np.array([]) if source.is_stack else plane_midpoints(planes)
    every = np.concatenate([planes, held_out])
    stack = source.build(None if source.is_stack else every).stack
    view = simulate(hologram.system, hologram.drive, every, backend="torch")
    try:
        quality = _score(view.at(range(len(planes))), stack[: len(planes)], region)
        eyebox = eyebox_uniformity_of(hologram)
        between = [_score(view.at([i]), stack[i : i + 1], region) for i in range(len(planes), len(every))]
    except UserError as error:
        return str(error)
    return {
        "psnr_db": quality.psnr.mean_db,
        "psnr_planes_db": list(quality.psnr.planes_db),
        "psnr_luminance_db": quality.psnr_luminance.mean_db,
        "held_out_planes_mm": [round(float(z) * 1e3, 6) for z in held_out],
        "held_out_psnr_planes_db": [one.psnr.mean_db for one in between],
        "held_out_psnr_db": float(np.mean([one.psnr.mean_db for one in between])) if between else None,
        "delta_e": quality.delta_e,
        "speckle_contrast": quality.mean_speckle_contrast,
        "eyebox_uniformity": eyebox.uniformity,
        "eyebox_variation": eyebox.coefficient_of_variation,
        "eyebox_centre_share": eyebox.centre_share,
    }


def format_scores(scores: dict[str, Any], system: System) -> list[str]:
    """The scores as lines for people."""
    if not scores:
        return []
    lines = [
        f"PSNR {scores['psnr_db']:.2f} dB (linear sRGB, mean over planes, scored on the "
        f"{system.sampling.propagation} grid)"
    ]
    if scores["held_out_psnr_db"] is not None:
        where = ", ".join(units.format_rounded(z * 1e-3, "mm") for z in scores["held_out_planes_mm"])
        lines.append(f"between the planes ({where}): {scores['held_out_psnr_db']:.2f} dB")
    return [
        *lines,
        f"luminance PSNR {scores['psnr_luminance_db']:.2f} dB, mean CIEDE2000 {scores['delta_e']:.2f}",
        f"speckle contrast {scores['speckle_contrast']:.3f}",
        f"eyebox: uniformity {scores['eyebox_uniformity']:.2f}, variation {scores['eyebox_variation']:.2f}",
    ]


def _score(view: View, stack: Floats, region: Region | None) -> ImageQuality:
    if region is not None:
        x, y, width, height = region
        view, stack = view.cropped(region), stack[:, y : y + height, x : x + width]
    return measure_image_quality(view, stack, _speckle_region(stack))


def _speckle_region(stack: Floats) -> Region | None:
    """Where to judge speckle: the central half, or everything when that is black in some plane."""
    x, y, w, h = central_region(stack.shape[1:3])
    lit = stack[:, y : y + h, x : x + w].any(axis=(1, 2, 3)).all()
    return None if lit else (0, 0, stack.shape[2], stack.shape[1])
