"""How much single pixels, columns and rows of each modulator stand out, at the modulator's full resolution.

Smooth maps (`free_maps`) can't show what a single line does. Here, what χ² would gain if a pixel showed one level
whatever is sent (`replacement_gains`) is compared with that of all other pixels, and of whole lines with other lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.replacement_gains import line_gains, replacement_gains, significance
from holoview.diagnose.search_context import SearchContext

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PixelMap:
    """For a modulator by its number (0 for the first) how far its parts stand out from others, in standard deviations.

    pixels (y, x), columns (x,), rows (y,): at the level that gains most. first_pixel: row and column of the first one,
    where these are the middle of a larger modulator.
    """

    number: int
    pixels: Floats
    columns: Floats
    rows: Floats
    first_pixel: tuple[int, int]

    def format_standing_out(self, min_sigmas: float) -> str:
        """The column and the row that stand out most, in words; empty where neither does by `min_sigmas`."""
        lines = zip(("column", "row"), (self.columns, self.rows), self.first_pixel[::-1], strict=True)
        most = [(name, first + int(sigmas.argmax()), float(sigmas.max())) for name, sigmas, first in lines]
        told = [f"{name} {number} ({sigmas:.0f} σ)" for name, number, sigmas in most if sigmas >= min_sigmas]
        return f"{' and '.join(told)} of modulator {self.number + 1}" if told else ""


def find_pixel_maps(context: SearchContext, base: FittedValues) -> tuple[PixelMap, ...]:
    """The maps of all modulators, of what the fine captures leave to explain on top of a base."""
    config, captures = context.config.stuck, context.data.captures
    comparison = context.half_tolerant_comparison(context.split.fine, context.relative_model_error(base))
    found = []
    for number, gains in sorted(replacement_gains(context, base, comparison, config.levels).items()):
        columns, rows = (significance(line_gains(gains, axis, config.line_segments)).max(axis=0) for axis in (1, 2))
        found.append(PixelMap(number, significance(gains).max(axis=0), columns, rows, captures.first_pixel))
    return tuple(found)
