"""Every unreadable file ends in one line that names it, what was found and what to do."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

from holoview.holograms.targets.picture import read_depth, read_picture
from holoview.util.errors import UserError

NOISE = np.random.default_rng(1).integers(0, 256, (64, 64, 3), dtype=np.uint8)


def write_exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


WRITERS: dict[str, Callable[[Path], object]] = {
    "8-bit.png": lambda p: Image.fromarray(NOISE).save(p),
    "16-bit.png": lambda p: p.write_bytes(imagecodecs.png_encode(NOISE.astype(np.uint16) * 257)),
    "photo.jpg": lambda p: Image.fromarray(NOISE).save(p),
    "plain.tif": lambda p: tifffile.imwrite(p, NOISE, photometric="rgb"),
    "packed.tif": lambda p: tifffile.imwrite(p, NOISE, photometric="rgb", compression="deflate"),
    "light.exr": lambda p: write_exr(p, {"RGB": NOISE.astype(np.float32)}),
    "depth.npy": lambda p: np.save(p, NOISE[..., 0]),
}


def says(path: Path, *words: str, read: Callable[[Path], object] = read_picture) -> str:
    """The message of the UserError that reading `path` raises, which names the file and holds `words`."""
    with pytest.raises(UserError) as caught:
        read(path)
    message = str(caught.value)
    for word in (str(path), *words):
        assert word in message
    assert "\n" not in message
    return message


@pytest.mark.parametrize("read", [read_picture, read_depth])
def test_a_missing_file_is_named(tmp_path: Path, read: Callable[[Path], object]) -> None:
    says(tmp_path / "no.png", "no such file", read=read)


@pytest.mark.parametrize("read", [read_picture, read_depth])
def test_a_folder_is_refused(tmp_path: Path, read: Callable[[Path], object]) -> None:
    says(tmp_path, "is a folder", read=read)


@pytest.mark.parametrize("read", [read_picture, read_depth])
def test_an_empty_file_is_refused(tmp_path: Path, read: Callable[[Path], object]) -> None:
    (tmp_path / "a.png").touch()
    says(tmp_path / "a.png", "the file is empty", read=read)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may read everything")
def test_a_file_without_permission_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").touch(mode=0)
    says(tmp_path / "a.png", "can't be read")


@pytest.mark.parametrize("content", [b"hello, this is text\n", b"BM" + bytes(30), b"\0" * 100])
def test_what_is_no_known_picture_is_refused_whatever_its_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.png").write_bytes(content)
    says(tmp_path / "a.png", "is not a picture that can be read", "PNG, JPEG, TIFF or OpenEXR")


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("share", [0.002, 0.05, 0.5, 0.9])
def test_a_truncated_file_is_refused(tmp_path: Path, name: str, share: float) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    data = path.read_bytes()
    path.write_bytes(data[: max(12, int(len(data) * share))])
    says(
        path,
        "damaged" if name.endswith("npy") else "truncated",
        read=read_depth if name.endswith("npy") else read_picture,
    )


@pytest.mark.long
@pytest.mark.parametrize("name", [n for n in WRITERS if n not in ("plain.tif", "depth.npy")])
def test_damaged_bytes_end_in_a_message_or_a_picture_but_never_in_a_crash(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    original = path.read_bytes()
    random = np.random.default_rng(2)
    for _ in range(40):
        data = bytearray(original)
        for at in random.integers(8, len(data), 6):
            data[at] ^= int(random.integers(1, 256))
        path.write_bytes(data)
        try:
            picture = read_picture(path)
        except UserError as error:
            assert str(path) in str(error)
        else:
            assert picture.rgb.ndim == 3 and np.isfinite(picture.rgb).all()


def test_a_png_that_claims_billions_of_pixels_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    WRITERS["16-bit.png"](path)
    data = bytearray(path.read_bytes())
    data[16:24] = (100_000).to_bytes(4, "big") * 2
    path.write_bytes(data)
    says(path, "100000 × 100000 pixels", "scale it down")


def test_a_png_without_pixels_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    WRITERS["8-bit.png"](path)
    data = bytearray(path.read_bytes())
    data[16:20] = bytes(4)
    path.write_bytes(data)
    says(path, "has no pixels: 0 × 64")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_light_that_is_not_finite_is_refused(tmp_path: Path, bad: float) -> None:
    light = np.ones((4, 4, 3), dtype=np.float32)
    light[1, 2, 0] = bad
    tifffile.imwrite(tmp_path / "a.tif", light, photometric="rgb")
    write_exr(tmp_path / "a.exr", {"RGB": light})
    for name in ("a.tif", "a.exr"):
        says(tmp_path / name, "1 of 48 values are NaN or infinite")


def test_light_beyond_single_precision_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.full((2, 2, 3), 1e300), photometric="rgb")
    says(tmp_path / "a.tif", "12 of 12 values are NaN or infinite")


def test_exr_without_colours_is_refused(tmp_path: Path) -> None:
    plane = np.ones((4, 4), dtype=np.float32)
    write_exr(tmp_path / "a.exr", {"normal.x": plane, "normal.y": plane})
    says(tmp_path / "a.exr", "normal.x", "R, G, B or a single channel")


def test_signed_and_printing_ink_tiffs_are_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "s.tif", np.zeros((4, 4), dtype=np.int16))
    says(tmp_path / "s.tif", "int16")
    tifffile.imwrite(tmp_path / "c.tif", np.zeros((4, 4, 4), dtype=np.uint8), photometric="separated")
    says(tmp_path / "c.tif", "SEPARATED colours", "RGB")


def test_a_volume_tiff_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "v.tif", np.zeros((16, 16, 16), np.uint8), volumetric=True, tile=(16, 16, 16))
    says(tmp_path / "v.tif", "has the TIFF layout")


def test_an_array_is_no_picture_but_may_be_depth(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((2, 2)))
    says(tmp_path / "a.npy", "is a numpy array")
    assert (read_depth(tmp_path / "a.npy") == 0).all()
