"""A user's picture becomes linear light: every format, bit depth and channel layout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.colour import srgb_decode
from holoview.targets.picture import read_picture, resize_to_cover

CODES = np.array([[[0, 10, 188], [255, 128, 64]], [[1, 2, 3], [90, 200, 250]], [[17, 17, 17], [254, 1, 99]]], np.uint8)
FLOAT32_EPSILON = 1e-7  # light is kept in float32, whose spacing below 1 is 6e-8


def exr(path: Path, channels: dict[str, NDArray[Any]], **header: Any) -> Path:
    """Write an OpenEXR file."""
    full = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(full, channels) as file:
        file.write(str(path))
    return path


def test_8_bit_rgb_png_is_decoded_with_the_srgb_curve(tmp_path: Path) -> None:
    Image.fromarray(CODES).save(tmp_path / "a.png")
    picture = read_picture(tmp_path / "a.png")
    assert picture.rgb.dtype == np.float32
    assert picture.rgb == pytest.approx(srgb_decode(CODES / 255), abs=FLOAT32_EPSILON)
    assert picture.notes == () and picture.source == str(tmp_path / "a.png")


def test_code_188_is_half_the_light_of_white(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (188, 188, 188)).save(tmp_path / "grey.png")
    assert read_picture(tmp_path / "grey.png").rgb.mean() == pytest.approx(0.5029, abs=5e-5)  # IEC 61966-2-1


def test_16_bit_rgb_png_keeps_its_16_bits(tmp_path: Path) -> None:
    codes = (np.arange(3 * 5 * 3, dtype=np.uint16).reshape(3, 5, 3) + 30000).astype(np.uint16)
    (tmp_path / "deep.png").write_bytes(imagecodecs.png_encode(codes))
    rgb = read_picture(tmp_path / "deep.png").rgb
    assert len(np.unique(rgb)) == codes.size, "codes one apart stay apart"
    assert rgb == pytest.approx(srgb_decode(codes / 65535), abs=FLOAT32_EPSILON)


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_16_bit_png_with_grey_and_alpha_is_understood(tmp_path: Path, channels: int) -> None:
    codes = np.full((2, 3, channels), 40000, dtype=np.uint16)
    (tmp_path / "deep.png").write_bytes(imagecodecs.png_encode(codes[..., 0] if channels == 1 else codes))
    rgb = read_picture(tmp_path / "deep.png").rgb
    coverage = 1.0 if channels == 1 else 40000 / 65535
    assert rgb == pytest.approx(np.full((2, 3, 3), srgb_decode(40000 / 65535) * coverage), abs=FLOAT32_EPSILON)


@pytest.mark.parametrize("mode", ["1", "L", "I;16"])
def test_grey_is_copied_to_three_channels_and_noted(tmp_path: Path, mode: str) -> None:
    dtype = np.uint16 if mode == "I;16" else np.uint8
    white = np.iinfo(dtype).max
    grey = Image.fromarray(np.array([[0, white]], dtype=dtype))
    (grey.convert("1") if mode == "1" else grey).save(tmp_path / "grey.png")
    picture = read_picture(tmp_path / "grey.png")
    assert picture.rgb.tolist() == [[[0, 0, 0], [1, 1, 1]]]
    assert picture.notes == ("grey copied to red, green and blue",)


def test_a_palette_is_looked_up(tmp_path: Path) -> None:
    Image.fromarray(CODES).quantize(8).save(tmp_path / "palette.png")
    with Image.open(tmp_path / "palette.png") as saved:
        assert saved.mode == "P"
    assert read_picture(tmp_path / "palette.png").rgb == pytest.approx(srgb_decode(CODES / 255), abs=FLOAT32_EPSILON)


def test_a_transparent_palette_entry_becomes_black(tmp_path: Path) -> None:
    picture = Image.new("P", (2, 1))
    picture.putpalette([255, 0, 0, 0, 255, 0])
    picture.putpixel((1, 0), 1)
    picture.save(tmp_path / "palette.png", transparency=1)
    read = read_picture(tmp_path / "palette.png")
    assert read.rgb.tolist() == [[[1, 0, 0], [0, 0, 0]]]
    assert "alpha composited over black" in read.notes


def test_alpha_scales_linear_light_over_black_and_is_noted(tmp_path: Path) -> None:
    Image.new("RGBA", (2, 2), (255, 188, 0, 51)).save(tmp_path / "a.png")
    picture = read_picture(tmp_path / "a.png")
    assert picture.rgb[0, 0] == pytest.approx(srgb_decode(np.array([255, 188, 0]) / 255) * 0.2, abs=FLOAT32_EPSILON)
    assert picture.notes == ("alpha composited over black",)


def test_jpeg_is_read_within_its_own_losses(tmp_path: Path) -> None:
    Image.new("RGB", (16, 16), (200, 100, 50)).save(tmp_path / "a.jpg", quality=95)
    expected = srgb_decode(np.array([200, 100, 50]) / 255)
    assert read_picture(tmp_path / "a.jpg").rgb[8, 8] == pytest.approx(expected, abs=0.01)  # ±1 code of 8 bits


def test_a_camera_picture_is_turned_upright(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # the camera was turned a quarter
    Image.new("RGB", (32, 16), (9, 9, 9)).save(tmp_path / "a.jpg", exif=exif)
    picture = read_picture(tmp_path / "a.jpg")
    assert picture.rgb.shape == (32, 16, 3)
    assert picture.notes == ("turned upright as the camera's orientation flag says",)


def test_cmyk_jpeg_is_converted(tmp_path: Path) -> None:
    Image.new("CMYK", (16, 16), (0, 0, 0, 0)).save(tmp_path / "a.jpg")
    assert read_picture(tmp_path / "a.jpg").rgb == pytest.approx(np.ones((16, 16, 3)), abs=0.01)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
def test_integer_tiff_is_a_display_signal(tmp_path: Path, dtype: type[np.unsignedinteger]) -> None:
    codes = (CODES / 255 * np.iinfo(dtype).max).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", codes, photometric="rgb")
    expected = srgb_decode(codes / np.iinfo(dtype).max)
    assert read_picture(tmp_path / "a.tif").rgb == pytest.approx(expected, abs=FLOAT32_EPSILON)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_float_tiff_is_linear_light(tmp_path: Path, dtype: type[np.floating]) -> None:
    light = np.array([[[0.0, 0.25, 0.5], [1.0, 0.125, 0.75]]], dtype=dtype)
    tifffile.imwrite(tmp_path / "a.tif", light, photometric="rgb")
    assert (read_picture(tmp_path / "a.tif").rgb == light).all()


def test_planar_compressed_and_white_is_zero_tiffs_read_the_same(tmp_path: Path) -> None:
    planes = np.ascontiguousarray(np.moveaxis(CODES, -1, 0))
    tifffile.imwrite(tmp_path / "p.tif", planes, photometric="rgb", planarconfig="separate", compression="lzw")
    tifffile.imwrite(tmp_path / "w.tif", 255 - CODES[..., 0], photometric="miniswhite")
    assert read_picture(tmp_path / "p.tif").rgb == pytest.approx(srgb_decode(CODES / 255), abs=FLOAT32_EPSILON)
    grey = read_picture(tmp_path / "w.tif").rgb[..., 1]
    assert grey == pytest.approx(srgb_decode(CODES[..., 0] / 255), abs=FLOAT32_EPSILON)


def test_a_palette_tiff_is_looked_up(tmp_path: Path) -> None:
    colours = np.zeros((3, 256), dtype=np.uint16)
    colours[:, 7] = 65535, 0, 32896
    tifffile.imwrite(tmp_path / "a.tif", np.full((2, 2), 7, np.uint8), photometric="palette", colormap=colours)
    expected = srgb_decode(np.array([1, 0, 32896 / 65535]))
    assert read_picture(tmp_path / "a.tif").rgb[1, 1] == pytest.approx(expected, abs=FLOAT32_EPSILON)


def test_the_first_of_many_tiff_pages_is_used_and_noted(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.stack([CODES, CODES // 2]), photometric="rgb")
    picture = read_picture(tmp_path / "a.tif")
    assert picture.rgb == pytest.approx(srgb_decode(CODES / 255), abs=FLOAT32_EPSILON)
    assert picture.notes == ("2 pictures, page 1 is used",)


def test_premultiplied_tiff_alpha_is_not_applied_twice(tmp_path: Path) -> None:
    for name, kind, red in (("pre.tif", "assocalpha", 100), ("plain.tif", "unassalpha", 200)):
        codes = np.full((2, 2, 4), (red, 0, 0, 128), dtype=np.uint8)
        tifffile.imwrite(tmp_path / name, codes, photometric="rgb", extrasamples=[kind])
    pre, plain = (read_picture(tmp_path / name).rgb for name in ("pre.tif", "plain.tif"))
    assert pre == pytest.approx(plain, rel=0.01)  # 100 is 200·128/255 rounded to 8 bits


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_is_linear_and_keeps_highlights(tmp_path: Path, dtype: type[np.floating]) -> None:
    light = np.array([[[0.0, 0.5, 7.5], [0.25, -0.125, 1.0]]], dtype=dtype)
    picture = read_picture(exr(tmp_path / "a.exr", {"RGB": light}))
    assert (picture.rgb == light).all()
    assert picture.notes == (
        "values up to 7.5 kept: brighter than the display's white (1)",
        "values down to -0.125 kept: colours outside sRGB",
    )


def test_exr_alpha_is_already_in_the_colours(tmp_path: Path) -> None:
    light = np.full((2, 2, 4), 0.25, dtype=np.float32)
    picture = read_picture(exr(tmp_path / "a.exr", {"RGBA": light}))
    assert (picture.rgb == 0.25).all()
    assert picture.notes == ("alpha composited over black",)


@pytest.mark.parametrize("display", [((0, 0), (7, 5)), ((2, 2), (3, 2)), ((-3, 0), (2, 9)), ((20, 0), (22, 4))])
def test_exr_data_lie_where_the_header_says_in_its_picture(tmp_path: Path, display: Any) -> None:
    data = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
    windows = {"dataWindow": ((1, 1), (4, 3)), "displayWindow": display}
    picture = read_picture(exr(tmp_path / "a.exr", {"Y": data}, **windows))
    everywhere = np.zeros((40, 40), np.float32)
    everywhere[11:14, 11:15] = data
    (left, top), (right, bottom) = display
    assert (picture.rgb[..., 1] == everywhere[10 + top : 11 + bottom, 10 + left : 11 + right]).all()
    assert ("alpha composited over black" in picture.notes) == (display != ((2, 2), (3, 2)))


def test_an_exr_layer_may_be_the_picture(tmp_path: Path) -> None:
    light = np.random.default_rng(0).random((2, 3, 3), dtype=np.float32)
    channels = {f"View.Combined.{c}": light[..., k].copy() for k, c in enumerate("RGB")}
    depth = {"View.Depth.Z": np.ones((2, 3), np.float32)}
    assert (read_picture(exr(tmp_path / "a.exr", channels | depth)).rgb == light).all()


def test_single_channel_exr_is_grey(tmp_path: Path) -> None:
    picture = read_picture(exr(tmp_path / "a.exr", {"Y": np.full((2, 3), 0.5, dtype=np.float32)}))
    assert (picture.rgb == 0.5).all() and picture.rgb.shape == (2, 3, 3)


def test_the_format_is_told_by_the_content_and_not_by_the_name(tmp_path: Path) -> None:
    Image.fromarray(CODES).save(tmp_path / "a.png")
    (tmp_path / "a.png").rename(tmp_path / "a.jpg")
    assert read_picture(tmp_path / "a.jpg").rgb == pytest.approx(srgb_decode(CODES / 255), abs=FLOAT32_EPSILON)


def test_fit_leaves_the_right_shape_alone() -> None:
    light = np.random.default_rng(0).random((5, 7, 3), dtype=np.float32)
    assert (resize_to_cover(light, (5, 7)) == light).all()


def test_fit_crops_the_middle_without_touching_values() -> None:
    light = np.random.default_rng(0).random((6, 11, 3), dtype=np.float32)
    assert (resize_to_cover(light, (6, 5)) == light[:, 3:8]).all()


@pytest.mark.parametrize("shape", [(3, 4), (10, 30), (37, 8), (1, 1), (400, 300)])
def test_fit_keeps_an_even_picture_even_and_covers_the_shape(shape: tuple[int, int]) -> None:
    fitted = resize_to_cover(np.full((20, 30, 3), 0.3, dtype=np.float32), shape)
    assert fitted.shape == (*shape, 3) and fitted.dtype == np.float32
    assert np.abs(fitted - 0.3).max() < 1e-6


def test_fit_averages_fine_stripes_to_their_mean_light() -> None:
    stripes = np.repeat((np.arange(256) % 2)[None, :, None], 256, axis=0).astype(np.float32).repeat(3, axis=2)
    fitted = resize_to_cover(stripes, (32, 32))
    assert fitted[:, 1:-1] == pytest.approx(np.full((32, 30, 3), 0.5), abs=1e-3)
    assert fitted == pytest.approx(np.full((32, 32, 3), 0.5), abs=0.02)  # half the filter is missing at the borders


def test_fit_neither_rings_nor_leaves_the_range() -> None:
    edge = np.zeros((64, 64, 3), dtype=np.float32)
    edge[:, 32:] = 4
    for size in (20, 41, 150):
        fitted = resize_to_cover(edge, (size, size))
        assert fitted.min() >= 0 and fitted.max() <= 4


def test_fit_of_depth_invents_no_depth() -> None:
    depth = np.zeros((64, 64), dtype=np.float32)
    depth[:, 21:] = 1
    for size in (20, 41, 150):
        assert set(np.unique(resize_to_cover(depth, (size, size)))) == {0, 1}


def test_fit_keeps_light_and_depth_aligned() -> None:
    depth = np.tile(np.linspace(0, 1, 90, dtype=np.float32), (60, 1))
    light = np.repeat(depth[..., None], 3, axis=2)
    for shape in ((30, 45), (40, 40), (120, 200)):
        assert (
            np.abs(resize_to_cover(light, shape)[..., 0] - resize_to_cover(depth, shape)).max() < 1.01 / 89
        )  # within a source pixel


def test_fit_refuses_shapes_without_pixels() -> None:
    with pytest.raises(ValueError, match="size ≥ 1"):
        resize_to_cover(np.zeros((3, 3), dtype=np.float32), (0, 4))
