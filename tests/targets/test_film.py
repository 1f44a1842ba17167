"""The pictures of a film: video files and folders, their order, number and light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from holoview.holograms.files.pictures import open_encoder
from holoview.holograms.targets.focal_stack import Film, is_video
from holoview.light.colour import srgb_decode
from holoview.util.errors import UserError

LEVELS = (40, 120, 200)


def _greys(size: int = 32) -> list[np.ndarray]:
    return [np.full((size, size, 3), level, dtype=np.uint8) for level in LEVELS]


def test_the_pictures_of_a_folder_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number, pixels in zip((2, 10, 9), _greys(4), strict=True):
        Image.fromarray(pixels).save(tmp_path / f"frame {number}.png")
    film = Film(tmp_path)
    found = [float(picture.rgb[0, 0, 0]) for picture in film.pictures()]
    assert film.count == 3
    assert found == pytest.approx([float(srgb_decode(np.array(LEVELS[i] / 255))) for i in (0, 2, 1)], rel=1e-6)


def test_a_video_holds_the_light_that_was_put_into_it(tmp_path: Path) -> None:
    pytest.importorskip("av")
    path = tmp_path / "film.mp4"
    open_encoder(path, len(LEVELS), 0.3)(_greys(), {})
    film = Film(path)
    pictures = list(film.pictures())
    assert film.count == len(pictures) == 3
    for picture, level in zip(pictures, LEVELS, strict=True):
        assert picture.rgb.shape == (32, 32, 3)
        # grey, in steps of 1/219 of the range that video has, and coded with loss: two steps
        signal = np.median(picture.rgb)
        assert srgb_decode(np.array((level - 3) / 255)) < signal < srgb_decode(np.array((level + 3) / 255))


def test_names_of_videos_are_known_by_their_suffix() -> None:
    assert is_video(Path("a.MP4")) and is_video(Path("b.webm"))
    assert not is_video(Path("a.png")) and not is_video(Path("mp4"))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("film.mp4", b"not a film", "can't be read"),
        ("film.mp4", b"", "can't be read"),
        ("film.txt", b"text", "isn't a film"),
        ("film.mp4", None, "no such file"),
    ],
)
def test_what_is_no_film_is_refused(name: str, content: bytes | None, message: str, tmp_path: Path) -> None:
    pytest.importorskip("av")
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=message):
        Film(tmp_path / name)


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="has no pictures"):
        Film(tmp_path)
