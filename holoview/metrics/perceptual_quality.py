"""The perceptual scores of images, by their names in `holoview.metrics.perceptual_scores`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.metrics.color_video_vdp import color_video_vdp
from holoview.metrics.flip import flip
from holoview.metrics.ms_ssim import ms_ssim
from holoview.metrics.perceptual_scores import samples_per_degree
from holoview.metrics.plane_scores import PlaneScores
from holoview.view import View

Image = NDArray[np.floating]

_MEASURES: dict[str, Callable[[Image, Image, float], PlaneScores]] = {
    "ms_ssim": lambda image, target, _: ms_ssim(image, target),
    "flip": flip,
    "jod": color_video_vdp,
}


def measure_score(name: str, image: Image, target: Image, density: float) -> PlaneScores:
    """A score of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3), not clipped.

    density: samples a degree of visual angle. White is 100 cd/m² for ColorVideoVDP.
    Raises UserError for a score that isn't installed, and for images that have other shapes or are too small for it.
    """
    return _MEASURES[name](image, target, density)


def measure_perceptual_scores(view: View, stack: Image, names: Sequence[str]) -> dict[str, PlaneScores]:
    """The named scores of a view against its target (plane, y, x, 3) in linear sRGB.

    The visual angle is that of the view's eyepiece, and without an eye that of the default one. Raises UserError as
    `measure_score` does.
    """
    angle = view.degrees_per_sample
    density = samples_per_degree(view.pitch_m, None) if angle is None else 1 / angle
    return {name: measure_score(name, view.rgb, stack, density) for name in names}
