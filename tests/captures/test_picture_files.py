"""Pictures in files of their own: grey in any form, JPEG with its cost, colours refused in words; lists of pairs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.picture_files import read_camera_picture, read_pairs, read_pattern
from holoview.util.errors import UserError

GREY = np.random.default_rng(1).integers(0, 256, (40, 56), dtype=np.uint8)


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P"])
def test_grey_is_read_in_any_form(mode: str, tmp_path: Path) -> None:
    Image.fromarray(GREY).convert(mode).save(tmp_path / "a.png")
    assert np.array_equal(read_pattern(tmp_path / "a.png"), GREY)


def test_unequal_channels_are_refused_with_their_place(tmp_path: Path) -> None:
    colours = np.stack([GREY] * 3, axis=-1)
    colours[7, 9] = (10, 30, 10)
    Image.fromarray(colours).save(tmp_path / "a.png")
    with pytest.raises(UserError, match=r"differ by up to 20 \(row 7, column 9\)"):
        read_pattern(tmp_path / "a.png")


@pytest.mark.parametrize("quality", [40, 80, 95])
def test_a_jpeg_is_read_with_the_error_that_it_costs(quality: int, tmp_path: Path) -> None:
    """Coefficients that are spread over more than a step are wrong by q/√12, others by less; clipping is little."""
    light = 60 + 120 * gaussian_filter(np.random.default_rng(2).random((128, 160)), 0.8)
    picture = np.clip(np.round(light), 0, 255).astype(np.uint8)
    Image.fromarray(picture).save(tmp_path / "a.jpg", quality=quality)
    read, loss = read_camera_picture(tmp_path / "a.jpg")
    assert loss is not None
    error = float(np.sqrt(np.mean((read.astype(float) - picture) ** 2)))
    assert error < 1.1 * loss.error_counts + 0.3  # rounding to whole counts is 0.29
    assert "8 × 8" in loss.sentence("a.jpg")


def test_a_pattern_in_jpeg_is_refused(tmp_path: Path) -> None:
    Image.fromarray(GREY).save(tmp_path / "a.jpg")
    with pytest.raises(UserError, match="blocks change the levels"):
        read_pattern(tmp_path / "a.jpg")


def test_pairs_are_read_with_what_is_known(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("image,slm1,exposure\na.png,m.png,0.5\nb.png,n.png,unknown\n")
    first, second = read_pairs(tmp_path / "p.csv")
    assert (first.picture, first.pattern, first.exposure_s) == (tmp_path / "a.png", tmp_path / "m.png", 0.5)
    assert math.isnan(first.power) and math.isnan(second.exposure_s)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("image,slm1\na.png,\n", "line 2: slm1: is missing"),
        ("image,slm1\n", "is empty"),
        ("image,slm1,power\na.png,m.png,much\n", 'a number above 0, or "unknown"'),
        ("image,slm1,power\na.png,m.png,-1\n", "above 0"),
    ],
)
def test_pairs_with_mistakes_are_refused_by_their_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(UserError, match=said):
        read_pairs(tmp_path / "p.csv")
