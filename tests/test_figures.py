"""The contact sheet: every picture in its cell, neither smoothed nor invented, with words around it."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.util.figures import CaptionedTile, contact_sheet

PAPER = (24, 24, 27)
MARGIN, TOP, CAPTION = 16, 96, 33
"""Space around pictures, above the first row, and below each row."""


def _tile(seed: int, rows: int = 6, columns: int = 8) -> CaptionedTile:
    pixels = np.random.default_rng(seed).integers(60, 256, (rows, columns, 3), dtype=np.uint8)
    return CaptionedTile(pixels, f"picture {seed}")


def _cell(sheet: np.ndarray, x: int, y: int, rows: int, columns: int) -> np.ndarray:
    return sheet[y : y + rows, x : x + columns]


def test_the_sheet_is_as_large_as_its_pictures_and_words() -> None:
    sheet = contact_sheet("title", ["a", "b", "c"], [[_tile(i) for i in range(3)]] * 2, width=80)
    assert sheet.dtype == np.uint8
    assert sheet.shape == (TOP + 2 * (60 + CAPTION) + MARGIN, 3 * (80 + MARGIN) + MARGIN, 3)


def test_a_small_picture_is_enlarged_by_whole_pixels() -> None:
    tiles = [_tile(0), _tile(1)]
    sheet = contact_sheet("title", ["a", "b"], [tiles], width=80)
    for column, tile in enumerate(tiles):
        found = _cell(sheet, MARGIN + column * (80 + MARGIN), TOP, 60, 80)
        assert np.array_equal(found, tile.pixels.repeat(10, axis=0).repeat(10, axis=1))


def test_a_large_picture_is_shrunk_by_area_averages() -> None:
    tile = _tile(2, 12, 16)
    sheet = contact_sheet("title", ["a"], [[tile]], width=8)
    means = tile.pixels.reshape(6, 2, 8, 2, 3).mean(axis=(1, 3))
    assert np.abs(_cell(sheet, MARGIN, TOP, 6, 8) - means).max() <= 1  # each axis rounds once


def test_rows_of_different_height_follow_each_other() -> None:
    flat, tall = _tile(3, 4, 8), _tile(4, 16, 8)
    sheet = contact_sheet("title", ["a"], [[flat], [tall]], width=8)
    assert np.array_equal(_cell(sheet, MARGIN, TOP, 4, 8), flat.pixels)
    assert np.array_equal(_cell(sheet, MARGIN, TOP + 4 + CAPTION, 16, 8), tall.pixels)


@pytest.mark.parametrize(
    ("title", "head", "caption", "where"),
    [
        ("title", "", "", slice(MARGIN, MARGIN + 30)),
        ("", "head", "", slice(58, TOP)),
        ("", "", "caption", slice(TOP + 60, TOP + 60 + CAPTION)),
    ],
)
def test_title_heads_and_captions_stand_where_they_belong(title: str, head: str, caption: str, where: slice) -> None:
    tile = CaptionedTile(np.full((6, 8, 3), 90, np.uint8), caption)
    sheet = contact_sheet(title, [head], [[tile]], width=80).copy()
    _cell(sheet, MARGIN, TOP, 60, 80)[:] = PAPER
    inked = np.any(sheet != PAPER, axis=(1, 2))
    assert inked[where].any()
    inked[where] = False
    assert not inked.any()
