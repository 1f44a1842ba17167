"""The demonstration: the shipped picture on two displays, rendered, scored and shown beside the target."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.pictures import write_png
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.fidelity import PlaneScores
from holoview.holograms.metrics.image_quality import (
    EyeboxUniformity,
    ImageQuality,
    eyebox_uniformity_of,
    measure_image_quality,
)
from holoview.holograms.metrics.perceptual import measure_perceptual_scores
from holoview.holograms.targets.focal_stack import Target
from holoview.holograms.view import View, simulate
from holoview.light.colour import to_srgb8
from holoview.util import units
from holoview.util.figures import CaptionedTile, contact_sheet
from holoview.util.progress import StepCallback

DISPLAYS = ("holochrome-8", "simultaneous")
"""The presets that are compared."""
_COLUMN_TITLES = ("target", "HoloChrome, 8 wavelengths", "simultaneous, 3 wavelengths")
_DEFOCUSED_PLANE_M = 0.014
# Regions of the still life (x, y, width, height as shares of the picture): the die in front, the vase behind.
_WHOLE, _FRONT, _BACK = (0, 0, 1, 1), (0.36, 0.68, 0.28, 0.28), (0.70, 0.06, 0.28, 0.28)


@dataclass(frozen=True)
class DisplayResult:
    """One display's hologram, its views at the target's planes and far out of focus, and its scores.

    perceptual: optional scores of the middle plane, by name.
    """

    name: str
    hologram: Hologram
    view: View
    defocused_view: View
    score: ImageQuality
    eyebox: EyeboxUniformity
    perceptual: Mapping[str, PlaneScores]


def render_display(
    name: str,
    hologram: Hologram,
    target: Target,
    scores: Sequence[str],
    progress: StepCallback,
    *,
    backend: str,
    adapter: str | None,
) -> DisplayResult:
    """Renders all planes and one far out of focus in one run, and scores the hologram.

    scores: names of the optional scores. backend, adapter: as `simulate` takes them.
    """
    planes = [*hologram.system.planes_m, _DEFOCUSED_PLANE_M]
    view = simulate(hologram.system, hologram.drive, planes, backend, adapter=adapter, progress=progress)
    focused, middle = view.at(range(len(planes) - 1)), (len(planes) - 1) // 2
    return DisplayResult(
        name,
        hologram,
        focused,
        defocused_view=view.at([len(planes) - 1]),
        score=measure_image_quality(focused, target.stack),
        eyebox=eyebox_uniformity_of(hologram),
        perceptual=measure_perceptual_scores(view.at([middle]), target.stack[[middle]], scores),
    )


def write_planes(display: DisplayResult, folder: Path) -> list[Path]:
    """Writes a PNG for each plane; returns their paths."""
    written = []
    for view, note in ((display.view, ""), (display.defocused_view, "-out-of-focus")):
        for i, plane_m in enumerate(view.focus_m):
            plane = units.format_exact(float(plane_m), "mm")
            path = folder / f"{display.name}-{plane.replace(' ', '')}{note}.png"
            texts = {"holoview.preset": display.name, "holoview.plane": plane, "holoview.backend": view.backend}
            write_png(path, view.srgb8[i], texts)
            written.append(path)
    return written


def comparison_sheet(target: Target, results: Sequence[DisplayResult]) -> NDArray[np.uint8]:
    """The contact sheet (y, x, 3): a column for the target and for each display.

    Rows: the middle plane, then regions in and out of focus.
    """
    last = len(target.planes_m) - 1
    target_rgb8 = to_srgb8(target.stack)
    rows = []
    for plane, region, name in (
        (last // 2, _WHOLE, "all"),
        (last, _FRONT, "front"),
        (0, _BACK, "back"),
        (last, _BACK, "back"),
    ):
        focus = f"{name}, focus at {units.format_rounded(target.planes_m[plane], 'mm')}"
        row = [CaptionedTile(_crop(target_rgb8[plane], region), focus)]
        for result in results:
            caption, score = focus, result.score
            if region is _WHOLE:
                contrast = score.speckle[plane].contrast
                caption = f"PSNR {score.psnr.planes_db[plane]:.1f} dB, speckle contrast {contrast:.2f}"
            row.append(CaptionedTile(_crop(result.view.srgb8[plane], region), caption))
        rows.append(row)
    return contact_sheet("One frame, two phase modulators: what the eye sees", _COLUMN_TITLES, rows)


def _crop(picture: NDArray[np.uint8], region: tuple[float, float, float, float]) -> NDArray[np.uint8]:
    """A region of a picture (y, x, 3), given as shares of its width and height."""
    rows, columns = picture.shape[:2]
    x, y, w, h = (round(share * side) for share, side in zip(region, (columns, rows, columns, rows), strict=True))
    return picture[y : y + h, x : x + w]
