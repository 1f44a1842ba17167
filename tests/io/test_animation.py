"""Animated PNG, GIF and MP4: they hold the frames that were given, and are shown for as long as was said."""

from __future__ import annotations

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from PIL import Image

from holoview.io.pictures import MAX_FRAMES, open_encoder
from holoview.util.errors import UserError

FRAMES = list(np.random.default_rng(0).integers(0, 256, (5, 21, 30, 3), dtype=np.uint8))


def test_a_png_holds_each_frame_exactly_with_times_and_texts(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    open_encoder(path, 5, 2.0)(FRAMES, {"holoview.plane": "10 mm"})
    with Image.open(path) as image:
        assert image.n_frames == 5 and image.info["loop"] == 0
        assert image.text["holoview.plane"] == "10 mm"
        for number, frame in enumerate(FRAMES):
            image.seek(number)
            assert np.array_equal(np.asarray(image.convert("RGB")), frame)
            assert image.info["duration"] == pytest.approx(400.0)


def test_a_single_frame_is_a_plain_png(tmp_path: Path) -> None:
    open_encoder(tmp_path / "a.png", 1, 1.0)(FRAMES[:1], {})
    with Image.open(tmp_path / "a.png") as image:
        assert not image.is_animated and np.array_equal(np.asarray(image), FRAMES[0])


def test_a_gif_and_an_mp4_are_shown_as_long(tmp_path: Path) -> None:
    for suffix in (".gif", ".mp4"):
        open_encoder(tmp_path / f"a{suffix}", 5, 2.0)(FRAMES, {})
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 5 and image.info["duration"] == 400
    assert imageio.imread(tmp_path / "a.mp4", plugin="pyav").shape == (5, 20, 30, 3), "even sides"
    assert imageio.immeta(tmp_path / "a.mp4", plugin="pyav")["fps"] == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("name", "frames", "seconds", "complaint"),
    [("a.avi", 5, 1.0, "suffix"), ("a.png", 0, 1.0, "0 frames"), ("a.png", MAX_FRAMES + 1, 1.0, "frames"),
     ("a.png", 5, 0.0, "in 0 s"), ("a.png", 5, float("nan"), "in nan s")],
)  # fmt: skip
def test_what_cannot_be_written_is_refused_before_anything_is_computed(
    tmp_path: Path, name: str, frames: int, seconds: float, complaint: str
) -> None:
    with pytest.raises(UserError, match=complaint):
        open_encoder(tmp_path / name, frames, seconds)
