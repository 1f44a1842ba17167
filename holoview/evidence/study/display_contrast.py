"""The contrast ratio of a display: a white and a black picture and a checkerboard, optimised for its bench.

Sequential contrast is the light of the white picture over that of the black one of the same lasers, checkerboard
contrast that of the white fields over that of the black ones of one picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.hologram_study import optimise_job
from holoview.evidence.study.study import StatusCallback
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.sharpness import ContrastRatio, checkerboard, checkerboard_contrast, sequential_contrast
from holoview.holograms.view import View, simulate
from holoview.light.model.system import System
from holoview.light.numerics.sampling import central_region, region_slices

WHITE = 0.5
"""Linear light of a white picture: bright enough to need most lasers, with room for the checkerboard."""

_BLACK = 1e-6  # of white: the optimiser takes no target without light


@dataclass(frozen=True, eq=False)
class DisplayContrast:
    """Both ratios, the holograms from which they are, and their views in the middle plane.

    settings: with which further pictures are optimised for the lasers' powers of the white one.
    """

    sequential: ContrastRatio
    checkerboard: ContrastRatio
    white: Hologram
    board: Hologram
    white_view: View
    board_view: View
    settings: Mapping[str, Any]


def display_contrast(system: System, settings: Mapping[str, Any], status: StatusCallback) -> DisplayContrast:
    """Optimises a white picture with free laser powers, and a black one and a checkerboard with its powers.

    settings: of `optimise_job`. Raises UserError where a ratio isn't defined.
    """
    rows, columns = system.way.shape
    even = np.full((len(system.planes_m), rows, columns, 3), WHITE)
    white = optimise_job(system, even, settings, status).best
    kept = {**settings, "options": {"free": ["patterns"]}}
    black = optimise_job(white.system, _BLACK * even, kept, status).best
    board = optimise_job(white.system, checkerboard((rows, columns))[None, :, :, None] * even, kept, status).best
    lit, dark, fields = (middle_view(hologram) for hologram in (white, black, board))
    centre = region_slices(central_region(lit.xyz.shape[1:3]))
    return DisplayContrast(
        sequential_contrast(_luminance(lit)[centre], _luminance(dark)[centre]),
        checkerboard_contrast(_luminance(fields)),
        white,
        board,
        lit,
        fields,
        kept,
    )


def middle_view(hologram: Hologram) -> View:
    """The view of the middle plane."""
    planes_m = hologram.system.planes_m
    return simulate(hologram.system, hologram.drive, planes_m[len(planes_m) // 2 :][:1], backend="torch")


def _luminance(view: View) -> NDArray[np.floating]:
    return view.xyz[0, ..., 1]
