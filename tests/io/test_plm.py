"""Memory cells of a phase light modulator: known words, and nothing lost on the way."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.io.pictures import CELL_MAPS, memory_cells
from holoview.util.errors import UserError


def test_the_first_level_of_p67_is_the_word_3() -> None:
    # bits 1, 3 / 0, 2 of 0b0011 are 1, 0 / 1, 0; mirrored left to right: 0, 1 / 0, 1
    np.testing.assert_array_equal(memory_cells(np.array([[0]]), "p67"), [[0, 1], [0, 1]])


def test_full_stroke_is_the_word_12() -> None:
    # bits 1, 3 / 0, 2 of 0b1100 are 0, 1 / 0, 1; mirrored: 1, 0 / 1, 0
    np.testing.assert_array_equal(memory_cells(np.array([[15]]), "p67"), [[1, 0], [1, 0]])


def test_every_level_has_its_own_cells_in_its_own_mirrored_place() -> None:
    levels = np.random.default_rng(0).integers(0, 16, (5, 7))
    cells = memory_cells(levels, "p67")
    assert cells.shape == (10, 14)
    assert set(np.unique(cells)) == {0, 1}
    upright = cells[:, ::-1].reshape(5, 2, 7, 2)
    layout, words = CELL_MAPS["p67"].bit_of_cell, np.array(CELL_MAPS["p67"].level_codes)
    read = sum(upright[:, r, :, c].astype(int) << layout[r][c] for r in (0, 1) for c in (0, 1))
    np.testing.assert_array_equal(read, words[levels])
    assert sorted(words) == list(range(16))


def test_unknown_devices_and_levels_are_refused() -> None:
    with pytest.raises(UserError, match='cells: "p76"; expected p67; did you mean p67'):
        memory_cells(np.zeros((2, 2), dtype=int), "p76")
    with pytest.raises(UserError, match="levels from 0 to 16; expected 0 to 15"):
        memory_cells(np.array([[0, 16]]), "p67")
