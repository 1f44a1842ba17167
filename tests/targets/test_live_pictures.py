"""Pictures that change: a film in turn, the newest picture of a folder, and a camera by FFmpeg's own test pattern."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from holoview.holograms.targets import live_pictures
from holoview.holograms.targets.live_pictures import CameraPictures, open_live_pictures
from holoview.util.errors import UserError
from tests.patience import wait_until


def _save(path: Path, level: int, when_s: float) -> None:
    Image.fromarray(np.full((6, 8, 3), level, np.uint8)).save(path)
    os.utime(path, (when_s, when_s))


def test_a_film_begins_again_after_its_last_picture(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    path, levels = tmp_path / "film.mp4", [40, 120, 220]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width = stream.height = 32
        for level in levels:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.full((32, 32, 3), level, np.uint8))))
        container.mux(stream.encode())
    pictures = open_live_pictures(str(path))
    means = [float(pictures.next().rgb.mean()) for _ in range(7)]
    pictures.close()
    assert means[0] < means[1] < means[2] and means[3:6] == means[:3] and means[6] == means[0]


def test_a_folder_shows_what_was_written_last(tmp_path: Path) -> None:
    pictures = open_live_pictures(str(tmp_path))
    with pytest.raises(UserError, match="has no pictures"):
        pictures.next()
    _save(tmp_path / "b.png", 50, 1000.0)
    first = pictures.next()
    assert pictures.next() is first
    _save(tmp_path / "a.png", 200, 2000.0)
    second = pictures.next()
    assert second is not first and second.source.endswith("a.png")
    (tmp_path / "c.png").write_bytes(b"half written")
    os.utime(tmp_path / "c.png", (3000.0, 3000.0))
    assert pictures.next() is second
    _save(tmp_path / "c.png", 100, 3000.5)
    assert pictures.next().source.endswith("c.png")
    _save(tmp_path / "c.png", 30, 4000.0)  # written again
    assert float(pictures.next().rgb.max()) < 0.02


def test_a_folder_with_nothing_that_can_be_read_says_why(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no picture")
    with pytest.raises(UserError, match=r"notes\.txt"):
        open_live_pictures(str(tmp_path)).next()


def test_a_camera_gives_its_newest_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    av = pytest.importorskip("av")
    if "lavfi" not in av.formats_available:
        pytest.skip("this PyAV has no test pattern")
    monkeypatch.setattr(live_pictures, "_LINUX", ("lavfi", "testsrc=size=64x48:rate=25"))
    monkeypatch.setattr(live_pictures, "_INPUTS", {})
    camera = open_live_pictures("camera")
    assert isinstance(camera, CameraPictures)
    first = camera.next()
    assert first.rgb.shape == (48, 64, 3) and first.source == "camera testsrc=size=64x48:rate=25"
    wait_until(lambda: not np.array_equal(camera.next().rgb, first.rgb))
    camera.close()


@pytest.mark.parametrize("source", ["camera:no such device", "missing.mp4", "missing folder"])
def test_a_source_that_cannot_be_opened_is_refused(source: str) -> None:
    pytest.importorskip("av")
    with pytest.raises(UserError):
        open_live_pictures(source)
