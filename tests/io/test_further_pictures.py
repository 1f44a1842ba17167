"""WebP, AVIF, GIF and HEIC pictures as targets; animations as films; a clear sentence where there is no decoder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, features

from holoview.holograms.files.image_reader import animation_count, coded_bits, file_format, read_raster
from holoview.holograms.targets.focal_stack import Film
from holoview.holograms.targets.live_pictures import open_live_pictures
from holoview.holograms.targets.picture import read_picture
from holoview.light.colour import srgb_decode
from holoview.util.errors import UserError

LOSSLESS = {"webp": {"lossless": True}, "gif": {}, "png": {}}
NAMES = {"webp": "WebP", "gif": "GIF", "avif": "AVIF", "png": "PNG"}


def _codes(seed: int = 0) -> np.ndarray:
    """16 × 24 pixels in four colours, which a palette of GIF holds without losses."""
    palette = np.random.default_rng(seed).integers(0, 256, (4, 3), dtype=np.uint8)
    return palette[np.random.default_rng(seed + 1).integers(0, 4, (16, 24))]


@pytest.mark.parametrize("suffix", LOSSLESS)
def test_pictures_are_read_as_they_were_written(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"picture.{suffix}"
    codes = _codes()
    Image.fromarray(codes).save(path, **LOSSLESS[suffix])
    assert file_format(path) == NAMES[suffix]
    np.testing.assert_allclose(read_picture(path).rgb, srgb_decode(codes / 255.0), atol=1e-6)


@pytest.mark.skipif(not features.check("avif"), reason="this Pillow has no decoder of AVIF")
def test_avif_is_read(tmp_path: Path) -> None:
    """Compressed with losses: an even colour, within three levels of 255."""
    path = tmp_path / "picture.avif"
    codes = np.full((32, 48, 3), (200, 120, 40), np.uint8)
    Image.fromarray(codes).save(path, quality=100)
    assert file_format(path) == "AVIF"
    found, slope = read_picture(path).rgb, 2.4 / 255 * 1.06  # of the transfer function, at most
    assert np.abs(found - srgb_decode(codes / 255.0)).max() < 3 * slope


@pytest.mark.skipif(not features.check("avif"), reason="this Pillow has no decoder of AVIF")
def test_all_bits_of_avif_are_read_or_it_is_said(tmp_path: Path) -> None:
    """A ramp of 10 bits, written without losses, has steps of 1/1023; a decoder of 8 bits would round them to 1/255."""
    imagecodecs = pytest.importorskip("imagecodecs")
    path, codes = tmp_path / "ramp.avif", np.arange(400, 640, dtype=np.uint16).reshape(12, 20)
    colours = np.repeat(codes[..., None], 3, axis=-1)
    path.write_bytes(imagecodecs.avif_encode(colours, level=100, bitspersample=10, pixelformat="444"))
    raster = read_raster(path)
    assert raster.white == 1023 and not any("8 are read" in note for note in raster.notes)
    assert np.abs(raster.values - colours / 1023).max() < 1.1 / 1023
    clear = np.concatenate([colours, np.full((12, 20, 1), 500, np.uint16)], axis=-1)
    path.write_bytes(imagecodecs.avif_encode(clear, level=100, bitspersample=10, pixelformat="444"))
    assert any("10 bits a channel, of which 8 are read" in note for note in read_raster(path).notes)


@pytest.mark.parametrize(
    ("data", "bits"),
    [
        (b"....pixi\0\0\0\0\3\x0a\x0a\x0a....", 10),
        (b"....av1C\x81\x20\x60\0", 12),
        (b"....hvcC" + bytes(17) + b"\xfa" + bytes(4), 10),
        (b"....pixi", 8),
        (b"", 8),
    ],
)
def test_the_bits_that_a_file_states(data: bytes, bits: int) -> None:
    assert coded_bits(data) == bits


def test_the_name_doesnt_matter(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    Image.fromarray(_codes()).save(path, format="WEBP", lossless=True)
    assert file_format(path) == "WebP" and read_picture(path).rgb.shape == (16, 24, 3)


def _boxed(brand: bytes, *compatible: bytes) -> bytes:
    content = b"ftyp" + brand + b"\0\0\0\0" + b"".join(compatible)
    return (4 + len(content)).to_bytes(4, "big") + content + bytes(64)


def test_heic_without_a_decoder_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "IMG_0001.HEIC"
    path.write_bytes(_boxed(b"heic", b"mif1", b"heic"))
    assert file_format(path) == "HEIC"
    monkeypatch.setattr("holoview.holograms.files.image_reader.importlib.util.find_spec", lambda name: None)
    with pytest.raises(UserError, match=r"HEIC picture, of which no decoder is installed.*pillow-heif"):
        read_picture(path)


@pytest.mark.parametrize(("kind", "data"), [("AVIF", _boxed(b"mif1", b"avif")), ("WebP", b"RIFF\x10\0\0\0WEBPVP8 ")])
def test_other_formats_without_a_decoder_say_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, data: bytes
) -> None:
    path = tmp_path / "picture"
    path.write_bytes(data)
    with pytest.raises(UserError, match=f"the {kind} data is truncated or damaged"):
        read_picture(path)
    monkeypatch.setattr("holoview.holograms.files.image_reader.features.check", lambda name: False)
    with pytest.raises(UserError, match=rf"{kind}, of which no decoder is installed.*Pillow"):
        read_picture(path)


def test_films_in_the_same_boxes_are_no_pictures(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    path.write_bytes(_boxed(b"isom", b"mp42"))
    assert file_format(path) == ""


@pytest.mark.long
@pytest.mark.parametrize("suffix", ["gif", "webp", "png"])
def test_an_animation_is_a_film_or_its_first_picture(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"film.{suffix}"
    frames = [_codes(seed) for seed in (0, 5, 9)]
    first, *others = (Image.fromarray(codes) for codes in frames)
    first.save(path, save_all=True, append_images=others, duration=100, **LOSSLESS[suffix])
    picture = read_picture(path)
    np.testing.assert_allclose(picture.rgb, srgb_decode(frames[0] / 255.0), atol=1e-6)
    assert any("animation of 3 pictures, the first is used" in note for note in picture.notes)
    assert animation_count(path) == 3 == Film(path).count
    for found, codes in zip(Film(path).pictures(), frames, strict=True):
        np.testing.assert_allclose(found.rgb, srgb_decode(codes / 255.0), atol=1e-6)
    live = open_live_pictures(str(path))
    shown = [live.next().rgb for _ in range(4)]
    assert np.array_equal(shown[0], shown[3]) and not np.array_equal(shown[0], shown[1])
    live.close()


def test_a_still_picture_is_no_film(tmp_path: Path) -> None:
    path = tmp_path / "still.gif"
    Image.fromarray(_codes()).save(path)
    assert animation_count(path) == 1
    with pytest.raises(UserError, match="isn't a film"):
        Film(path)


def test_a_damaged_animation_is_told(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    first, second = (Image.fromarray(_codes(seed)) for seed in (0, 5))
    first.save(path, save_all=True, append_images=[second])
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(UserError, match=r"GIF data is truncated or damaged|isn't a film"):
        list(Film(path).pictures())
