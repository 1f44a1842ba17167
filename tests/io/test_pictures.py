"""PNG files: patterns come back exactly, texts travel along, and no file is ever half there."""

from __future__ import annotations

import errno
import os
import stat
import sys
from pathlib import Path
from typing import Any, NoReturn

import imagecodecs
import imageio.v3 as imageio
import numpy as np
import pytest
from PIL import Image

from holoview import __version__
from holoview.holograms.files.pictures import (
    CELL_MAPS,
    MAX_FRAMES,
    memory_cells,
    open_encoder,
    path_with_suffix,
    read_pattern,
    write_png,
)
from holoview.util.errors import UserError
from tests.pattern_file import write_pattern

SHAPE = (6, 9)


def _levels(bits: int, seed: int = 0) -> np.ndarray:
    levels = np.random.default_rng(seed).integers(0, 2**bits, SHAPE)
    levels[0, :2] = 0, 2**bits - 1
    return levels


def _drive(bits: int) -> np.ndarray:
    return (_levels(bits) / (2**bits - 1)).astype(np.float32)


def _open(path: Path) -> tuple[np.ndarray, dict[Any, Any]]:
    with Image.open(path) as image:
        return np.asarray(image), image.info


@pytest.mark.parametrize("bits", [8, 16])
def test_a_pattern_comes_back_exactly(tmp_path: Path, bits: int) -> None:
    drive = _drive(bits)
    write_pattern(tmp_path / "a.png", drive, bits)
    found = read_pattern(tmp_path / "a.png", SHAPE)
    assert found.dtype == np.float32
    assert np.array_equal(found, drive)


@pytest.mark.parametrize(("bits", "dtype"), [(8, np.uint8), (16, np.uint16)])
def test_the_file_holds_0_to_max_for_0_to_the_stroke(tmp_path: Path, bits: int, dtype: type) -> None:
    write_pattern(tmp_path / "a.png", _drive(bits), bits)
    pixels, texts = _open(tmp_path / "a.png")
    assert pixels.dtype == dtype
    assert np.array_equal(pixels, _levels(bits))
    assert texts["holoview.pattern"] == "0…max is 0…stroke"


def test_a_drive_between_two_levels_goes_to_the_nearest(tmp_path: Path) -> None:
    drive = np.array([[0.4, 0.6, 254.4, 254.6, 255.0]], np.float32) / 255
    write_pattern(tmp_path / "a.png", drive)
    assert _open(tmp_path / "a.png")[0].tolist() == [[0, 1, 254, 255, 255]]


@pytest.mark.parametrize("kind", ["RGB", "RGBA", "LA", "P"])
def test_grey_stored_as_colour_is_read_as_grey(tmp_path: Path, kind: str) -> None:
    Image.fromarray(_levels(8).astype(np.uint8)).convert(kind).save(tmp_path / "a.png")
    assert np.array_equal(read_pattern(tmp_path / "a.png", SHAPE), _drive(8))


def test_16_bit_colour_keeps_its_16_bits(tmp_path: Path) -> None:
    grey = _levels(16).astype(np.uint16)
    (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(np.repeat(grey[..., None], 3, axis=-1)))
    assert np.array_equal(read_pattern(tmp_path / "a.png", SHAPE), _drive(16))


@pytest.mark.parametrize("bits", [1, 2, 4])
def test_few_bits_are_still_0_to_max(tmp_path: Path, bits: int) -> None:
    levels = np.resize(np.arange(2**bits), SHAPE)
    palette_free = Image.fromarray((levels * (255 // (2**bits - 1))).astype(np.uint8))
    palette_free.convert("1" if bits == 1 else "L").save(tmp_path / "a.png")
    wanted = (levels / (2**bits - 1)).astype(np.float32)
    assert np.allclose(read_pattern(tmp_path / "a.png", SHAPE), wanted, atol=1e-7)


def test_a_pattern_of_another_size_is_refused_with_both_sizes(tmp_path: Path) -> None:
    write_pattern(tmp_path / "a.png", _drive(8))
    with pytest.raises(UserError, match=r"a\.png: 9 x 6 pixels; expected 6 x 9 pixels"):
        read_pattern(tmp_path / "a.png", (9, 6))


@pytest.mark.parametrize("wrong", [-0.01, 1.01, np.nan])
def test_a_drive_outside_the_stroke_is_not_written(tmp_path: Path, wrong: float) -> None:
    drive = _drive(8)
    drive[2, 3] = wrong
    with pytest.raises(UserError, match="outside 0…1"):
        write_pattern(tmp_path / "a.png", drive)
    assert not list(tmp_path.iterdir())


def test_only_8_and_16_bits_are_written(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="bits: 12; expected 8 or 16"):
        write_pattern(tmp_path / "a.png", _drive(8), bits=12)


def test_texts_of_any_language_and_length_travel_along_with_the_version(tmp_path: Path) -> None:
    texts = {"holoview.preset": "Bank 3 – λ²", "holoview.plane": "10 mm", "holoview.system": "gap = 1\n" * 100}
    write_png(tmp_path / "a.png", np.zeros((2, 3, 3), np.uint8), texts)
    assert _open(tmp_path / "a.png")[1] == {"Software": f"holoview {__version__}"} | texts


def test_a_pattern_may_carry_more_texts(tmp_path: Path) -> None:
    write_pattern(tmp_path / "a.png", _drive(8), texts={"holoview.preset": "mine"})
    assert _open(tmp_path / "a.png")[1]["holoview.preset"] == "mine"


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions")
@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_the_file_has_the_permissions_that_the_umask_leaves(tmp_path: Path, mask: int) -> None:
    before = os.umask(mask)
    try:
        write_png(tmp_path / "a.png", np.zeros((2, 3, 3), np.uint8), {})
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.png").stat().st_mode) == 0o666 & ~mask


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "disk full"), KeyboardInterrupt()])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    path = tmp_path / "a.png"
    write_png(path, np.full((2, 3, 3), 7, np.uint8), {})
    before = path.read_bytes()

    def half(handle: int) -> NoReturn:
        os.truncate(handle, 20)
        raise error

    monkeypatch.setattr(os, "fsync", half)
    with pytest.raises(KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else UserError):
        write_png(path, np.zeros((2, 3, 3), np.uint8), {})
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_planes_are_numbered_by_their_distance() -> None:
    assert path_with_suffix(Path("a/b.c.png"), "10mm") == Path("a/b.c-10mm.png")


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


@pytest.mark.long
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
