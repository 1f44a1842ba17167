"""How much single pixels, columns and rows of each modulator stand out, at the modulator's full resolution.

Smooth maps (`free_maps`) can't show what a single line does. Here, what χ² would gain if a pixel showed one level
whatever is sent (`replacement_gains`) is compared with that of all other pixels, and of whole lines with other lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.fit import FittedValues
from holoview.diagnose.search_context import SearchContext
from holoview.diagnose.starts.stuck import LEVELS, LINE_SEGMENTS
from holoview.diagnose.starts.transmission_slopes import line_gains, replacement_gains, significance

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

    @property
    def line_sigmas(self) -> float:
        """How far the column or the row does so that stands out most."""
        return float(max(self.columns.max(), self.rows.max()))

    def describe_line(self) -> str:
        """The column or the row that stands out most."""
        lines = zip(("row", "column"), (self.rows, self.columns), self.first_pixel, strict=True)
        name, sigmas, first = max(lines, key=lambda line: float(line[1].max()))
        number = first + int(sigmas.argmax())
        return f"{name} {number} of modulator {self.number + 1} ({self.line_sigmas:.0f} σ)"


def find_pixel_maps(context: SearchContext, base: FittedValues) -> tuple[PixelMap, ...]:
    """The maps of all modulators, of what the fine captures leave to explain on top of a base."""
    captures = context.data.captures
    comparison = context.half_tolerant_comparison(context.split.fine, context.relative_model_error(base))
    found = []
    for number, gains in sorted(replacement_gains(context, base, comparison, LEVELS).items()):
        columns, rows = (significance(line_gains(gains, axis, LINE_SEGMENTS)).max(axis=0) for axis in (1, 2))
        found.append(PixelMap(number, significance(gains).max(axis=0), columns, rows, captures.first_pixel))
    return tuple(found)


def line_notes(maps: Sequence[PixelMap], min_sigmas: float) -> list[str]:
    """A note on the line that stands out most, if it does by `min_sigmas`; light spreads, so that others may too."""
    most = max(maps, key=lambda one: one.line_sigmas, default=None)
    if most is None or most.line_sigmas < min_sigmas:
        return []
    return [f"Of all columns and rows of modulators, {most.describe_line()} stands out most from its neighbours."]
