"""Memory cells of a phase light modulator: how a level number becomes the bits that its electrodes are given.

A pixel of a TI phase light modulator lies over 2 × 2 binary memory cells. A level, counted in rising order of optical
path, is a 4-bit word (`words`); bit `layout[r][c]` of it goes to the cell in row r and column c of the pixel; the whole
picture of cells is then mirrored left to right where `mirrored`. The tables of "p67" (the 0.67-inch device, DLP6750)
are those that TI publishes with its MIT-licensed Python package ti_plm 1.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError, suggest_matches


@dataclass(frozen=True)
class CellMap:
    """Word of each level, bit of each cell of a pixel, and whether the picture is mirrored left to right."""

    level_codes: tuple[int, ...]
    bit_of_cell: tuple[tuple[int, ...], ...]
    mirrored: bool


CELL_MAPS = {
    "p67": CellMap(
        level_codes=(3, 2, 1, 7, 0, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12), bit_of_cell=((1, 3), (0, 2)), mirrored=True
    )
}


def memory_cells(levels: NDArray[np.integer], device: str) -> NDArray[np.uint8]:
    """Bits (2·rows, 2·columns), 0 or 1, of level numbers (rows, columns).

    Raises UserError for an unknown device and for levels that it doesn't have.
    """
    if device not in CELL_MAPS:
        raise UserError(
            "cells", f'"{device}"', expected=", ".join(CELL_MAPS), remedy=suggest_matches(device, CELL_MAPS)
        )
    memory = CELL_MAPS[device]
    highest = len(memory.level_codes) - 1
    if levels.min() < 0 or levels.max() > highest:
        found = f"levels from {levels.min()} to {levels.max()}"
        raise UserError("cells", found, expected=f"0 to {highest}, the levels of {device}")
    words = np.array(memory.level_codes, dtype=np.uint8)[levels]
    shifts = np.array(memory.bit_of_cell, dtype=np.uint8)
    bits = (words[:, None, :, None] >> shifts[None, :, None, :]) & 1
    cells = bits.reshape(len(levels) * shifts.shape[0], -1)
    return cells[:, ::-1] if memory.mirrored else cells
