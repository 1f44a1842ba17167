"""The bits in the memory cells of a phase light modulator for a picture of levels.

A pixel of a TI phase light modulator lies over 2 × 2 binary memory cells. A level, counted in rising order of optical
path, has a 4-bit code. One bit of it goes to each cell of the pixel, and some devices mirror the picture of cells left
to right. The tables of "p67" (the 0.67-inch device, DLP6750) are those that TI publishes with its MIT-licensed Python
package ti_plm 1.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError, suggest_matches


@dataclass(frozen=True)
class CellMap:
    """How a device stores levels.

    level_codes: code of each level, in rising order of optical path.
    bit_of_cell: which bit of the code the cell in each row and column of a pixel holds.
    mirrored: whether the picture of cells is mirrored left to right.
    """

    level_codes: tuple[int, ...]
    bit_of_cell: tuple[tuple[int, ...], ...]
    mirrored: bool


CELL_MAPS = {
    "p67": CellMap(
        level_codes=(3, 2, 1, 7, 0, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12), bit_of_cell=((1, 3), (0, 2)), mirrored=True
    )
}


def memory_cells(levels: NDArray[np.integer], device: str) -> NDArray[np.uint8]:
    """The bits, 0 or 1, of all memory cells, (2·rows, 2·columns).

    levels: (rows, columns) level of each pixel, counted from 0.
    device: a key of `CELL_MAPS`.

    Raises UserError for an unknown device and for levels that it doesn't have.
    """
    if device not in CELL_MAPS:
        raise UserError(
            "cells", f'"{device}"', expected=", ".join(CELL_MAPS), remedy=suggest_matches(device, CELL_MAPS)
        )
    cell_map = CELL_MAPS[device]
    highest = len(cell_map.level_codes) - 1
    if levels.min() < 0 or levels.max() > highest:
        found = f"levels from {levels.min()} to {levels.max()}"
        raise UserError("cells", found, expected=f"0 to {highest}, the levels of {device}")
    codes = np.array(cell_map.level_codes, dtype=np.uint8)[levels]
    shifts = np.array(cell_map.bit_of_cell, dtype=np.uint8)
    bits = (codes[:, None, :, None] >> shifts[None, :, None, :]) & 1
    cells = bits.reshape(len(levels) * shifts.shape[0], -1)
    return cells[:, ::-1] if cell_map.mirrored else cells
