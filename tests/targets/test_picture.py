"""A user's picture becomes linear light: every format, bit depth and channel layout."""

from __future__ import annotations

import math
import struct
import zlib
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms

import holoview as hv
from holoview.holograms.targets.picture import (
    UnreadPicture,
    read_picture,
    resize_to_cover,
    scale_saturation,
    srgb_from_primaries,
)
from holoview.light.colour import (
    D65_WHITE,
    SRGB_TO_XYZ,
    XYZ_TO_SRGB,
    import_colour_science,
    observer_weights,
    rgb_to_xyz,
    srgb_decode,
)
from holoview.util.errors import UserError

CODES = np.array([[[0, 10, 188], [255, 128, 64]], [[1, 2, 3], [90, 200, 250]], [[17, 17, 17], [254, 1, 99]]], np.uint8)
ASSUMED = "states no colour space: taken as sRGB"
FLOAT32_EPSILON = 1e-7  # light is kept in float32, whose spacing below 1 is 6e-8


def exr(path: Path, channels: dict[str, NDArray[Any]], **header: Any) -> Path:
    """Write an OpenEXR file."""
    full = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(full, channels) as file:
        file.write(str(path))
    return path


def test_a_picture_may_be_read_when_its_light_is_first_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    picture = UnreadPicture(path)
    with pytest.raises(UserError, match=r"picture\.png"):
        _ = picture.rgb
    Image.fromarray(CODES).save(path)
    assert np.array_equal(picture.rgb, read_picture(path).rgb) and picture.source == str(path)
    path.unlink()
    assert picture.rgb is picture.rgb


def test_8_bit_rgb_png_is_decoded_with_the_srgb_curve(tmp_path: Path) -> None:
    Image.fromarray(CODES).save(tmp_path / "a.png")
    picture = read_picture(tmp_path / "a.png")
    assert picture.rgb.dtype == np.float32
    assert picture.rgb == pytest.approx(srgb_decode(CODES / 255), abs=FLOAT32_EPSILON)
    assert picture.notes == (ASSUMED,) and picture.source == str(tmp_path / "a.png")


def test_a_stated_space_is_no_assumption(tmp_path: Path) -> None:
    """By a profile, by the chunk sRGB of a PNG, by the EXIF of a camera; of grey and of XYZ nothing is assumed."""
    picture, exif = Image.fromarray(CODES), Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = 1
    picture.save(tmp_path / "a.png", icc_profile=ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    picture.save(tmp_path / "b.jpg", exif=exif)
    picture.save(tmp_path / "c.png")
    data, chunk = (tmp_path / "c.png").read_bytes(), b"sRGB\0"
    packed = struct.pack(">I", 1) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (tmp_path / "c.png").write_bytes(data[:33] + packed + data[33:])
    for name in ("a.png", "b.jpg", "c.png"):
        assert read_picture(tmp_path / name).notes == (), name
    tifffile.imwrite(tmp_path / "d.tif", np.full((2, 2, 3), 0.3, np.float32), photometric="rgb")
    assert read_picture(tmp_path / "d.tif").notes == ("states no colour space: taken as linear sRGB",)
    assert not any("taken as" in note for note in read_picture(tmp_path / "d.tif", space="xyz").notes)


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
    assert picture.notes == ("alpha composited over black", ASSUMED)


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
    assert picture.notes == ("turned upright as the camera's orientation flag says", ASSUMED)


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
    assert picture.notes == ("2 pictures, page 1 is used", ASSUMED)


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


D65 = (0.3127, 0.3290)
SRGB = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), D65)
REC2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65)
DCI_P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.314, 0.351))
ACES = ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.0770), (0.32168, 0.33767))
XYZ = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (1 / 3, 1 / 3))
FLOAT32 = 1e-6  # chromaticities and light are stored as float32


def float_exr(path: Path, channels: dict[str, NDArray[Any]], primaries: Any = None) -> Path:
    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if primaries is not None:
        header["chromaticities"] = tuple(number for pair in primaries for number in pair)
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))
    return path


def light(seed: int = 0) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random((4, 5, 3), dtype=np.float32)


@pytest.mark.parametrize("name", ["a.exr", "a.tif"])
def test_xyz_becomes_unbounded_linear_srgb(tmp_path: Path, name: str) -> None:
    rgb = light() * 3 - 1  # in and out of the gamut, dark and HDR
    xyz = (rgb @ SRGB_TO_XYZ.T).astype(np.float32)
    path = tmp_path / name
    float_exr(path, {"RGB": xyz}) if name.endswith("exr") else tifffile.imwrite(path, xyz, photometric="rgb")
    picture = read_picture(path, space="xyz")
    assert picture.rgb == pytest.approx(rgb, abs=10 * FLOAT32)
    assert picture.notes[0] == "CIE XYZ converted to linear sRGB"
    assert "colours outside sRGB" in picture.notes[-1]


def test_the_white_of_xyz_is_d65_at_y_of_one(tmp_path: Path) -> None:
    float_exr(tmp_path / "white.exr", {"RGB": np.tile(D65_WHITE.astype(np.float32), (2, 2, 1))})
    assert read_picture(tmp_path / "white.exr", space="xyz").rgb == pytest.approx(np.ones((2, 2, 3)), abs=FLOAT32)


def test_integers_and_grey_are_no_xyz(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2)).save(tmp_path / "a.png")
    tifffile.imwrite(tmp_path / "b.tif", np.zeros((2, 2, 3), np.uint16), photometric="rgb")
    float_exr(tmp_path / "c.exr", {"Y": np.zeros((2, 2), np.float32)})
    for name, found in (("a.png", "holds integers"), ("b.tif", "holds integers"), ("c.exr", "has one channel")):
        with pytest.raises(UserError, match=f"{name}: {found}.*; expected three float channels of CIE XYZ; save it as"):
            read_picture(tmp_path / name, space="xyz")


def test_another_space_is_refused(tmp_path: Path) -> None:
    float_exr(tmp_path / "a.exr", {"RGB": light()})
    with pytest.raises(UserError, match='space: "lab"; expected srgb or xyz'):
        read_picture(tmp_path / "a.exr", space="lab")


@pytest.mark.parametrize(
    ("name", "primaries"),
    [("ITU-R BT.2020", REC2020), ("DCI-P3", DCI_P3), ("ACES2065-1", ACES)],
)
def test_stated_primaries_are_converted_as_colour_science_does(tmp_path: Path, name: str, primaries: Any) -> None:
    science = import_colour_science()
    picture = read_picture(float_exr(tmp_path / "a.exr", {"RGB": light()}, primaries))
    spaces = science.RGB_COLOURSPACES[name], science.RGB_COLOURSPACES["sRGB"]
    matrix = science.matrix_RGB_to_RGB(*spaces, chromatic_adaptation_transform="Bradford")
    expected = light() @ matrix.T
    assert np.abs(picture.rgb - expected).max() < 5e-4  # its sRGB and BT.2020 matrices are the standards' rounded ones
    assert picture.notes[0] == "converted from the file's own primaries"


@pytest.mark.parametrize("primaries", [SRGB, REC2020, DCI_P3, ACES])
def test_the_white_of_any_primaries_is_the_display_white(primaries: Any) -> None:
    assert srgb_from_primaries("file", primaries) @ np.ones(3) == pytest.approx(np.ones(3), abs=1e-12)


def test_the_rec_2020_primaries_have_their_own_chromaticities() -> None:
    columns = (SRGB_TO_XYZ @ srgb_from_primaries("file", REC2020)).T
    assert columns[:, :2] / columns.sum(axis=1, keepdims=True) == pytest.approx(np.array(REC2020[:3]), abs=1e-12)


def test_srgb_primaries_change_nothing(tmp_path: Path) -> None:
    picture = read_picture(float_exr(tmp_path / "a.exr", {"RGB": light()}, SRGB))
    assert picture.rgb == pytest.approx(light(), abs=FLOAT32)


def test_a_header_may_say_that_the_file_holds_xyz(tmp_path: Path) -> None:
    picture = read_picture(float_exr(tmp_path / "a.exr", {"RGB": light()}, XYZ))
    assert picture.rgb == pytest.approx(light() @ XYZ_TO_SRGB.T, abs=FLOAT32)
    assert picture.notes[0] == "CIE XYZ, as its header says, converted to linear sRGB"


def test_the_asked_space_wins_over_the_header_and_says_so(tmp_path: Path) -> None:
    picture = read_picture(float_exr(tmp_path / "a.exr", {"RGB": light()}, REC2020), space="xyz")
    assert picture.rgb == pytest.approx(light() @ XYZ_TO_SRGB.T, abs=FLOAT32)
    assert picture.notes[0].endswith("the chromaticities in its header are ignored")


def test_grey_has_no_primaries(tmp_path: Path) -> None:
    grey = np.full((2, 3), 0.5, np.float32)
    assert (read_picture(float_exr(tmp_path / "a.exr", {"Y": grey}, REC2020)).rgb == 0.5).all()


@pytest.mark.parametrize(
    "primaries",
    [
        ((0.3, 0.3), (0.4, 0.4), (0.5, 0.5), D65),
        ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3, 0.0)),
        ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3, float("nan"))),
    ],
)
def test_primaries_that_span_nothing_are_refused(tmp_path: Path, primaries: Any) -> None:
    float_exr(tmp_path / "a.exr", {"RGB": light()}, primaries)
    with pytest.raises(
        UserError, match=r"a\.exr: its header states the chromaticities \(.*; expected red, green, blue"
    ):
        read_picture(tmp_path / "a.exr")


SINGLE_PRECISION = (
    2e-6  # of the largest channel: a few roundings to float32, 6e-8 each, through matrices of gain up to 3.2 · 10
)
FACTORS = (0.0, 0.3, 0.9, 1.0, 1.1, 1.5, 3.0, 1000.0)


def colours(count: int = 4000) -> NDArray[np.float32]:
    """Random colours inside sRGB, dark and HDR ones among them."""
    random = np.random.default_rng(0)
    return (random.random((count, 3)) * 10 ** random.uniform(-4, 1, (count, 1))).astype(np.float32)


def luv(rgb: NDArray[np.floating]) -> NDArray[np.float64]:
    white = import_colour_science().XYZ_to_xy(D65_WHITE)
    return np.asarray(import_colour_science().XYZ_to_Luv(rgb.astype(np.float64) @ SRGB_TO_XYZ.T, white))


def chromaticity(rgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """(…, 2): u′, v′."""
    xyz = rgb.astype(np.float64) @ SRGB_TO_XYZ.T
    return xyz[..., :2] * (4, 9) / (xyz @ (1, 15, 3))[..., None]


@pytest.mark.parametrize("factor", [0.0, 0.25, 0.8, 1.0, 1.2])
def test_it_agrees_with_colour_science(factor: float) -> None:
    science = import_colour_science()
    white = science.XYZ_to_xy(D65_WHITE)
    picture = (0.2 + 0.8 * colours() / colours().max(axis=1, keepdims=True)).astype(
        np.float32
    )  # inside the locus × 1.2
    lch = science.Luv_to_LCHuv(luv(picture)) * (1, factor, 1)
    expected = science.Luv_to_XYZ(science.LCHuv_to_Luv(lch), white) @ XYZ_TO_SRGB.T
    found = scale_saturation(picture, factor)
    assert found.dtype == np.float32 and found.shape == picture.shape
    assert np.abs(found - expected).max() < 1e-5  # colour-science's L* ↔ Y has constants rounded to 1e-6


def test_a_factor_of_one_is_the_identity() -> None:
    wide = np.array([[-0.5, 0.2, 3.0], [0, 0, 0], [1, -2, 0]], dtype=np.float32)
    assert (scale_saturation(wide, 1.0) == wide).all()


def test_a_factor_near_one_is_nearly_the_identity() -> None:
    before = colours()
    change = np.abs(scale_saturation(before, 1 + 1e-6) - before).max(axis=1)
    assert (change / before.max(axis=1)).max() < 3e-5


def test_a_factor_of_zero_is_the_grey_of_the_same_luminance() -> None:
    before = colours()
    grey = scale_saturation(before, 0.0)
    luminance = before @ SRGB_TO_XYZ[1]
    assert (np.abs(grey - luminance[:, None]) / luminance[:, None]).max() < SINGLE_PRECISION


@pytest.mark.parametrize("factor", FACTORS)
def test_luminance_is_kept(factor: float) -> None:
    before = np.concatenate([colours(), -colours(50), [[-0.5, 0.2, 3.0], [0.0, -1.0, 0.1], [1e-20, 0, 0]]])
    after = scale_saturation(before, factor)
    change = np.abs(after.astype(np.float64) @ SRGB_TO_XYZ[1] - before @ SRGB_TO_XYZ[1])
    assert (change / np.maximum(np.abs(after).max(axis=1), 1e-30)).max() < SINGLE_PRECISION


@pytest.mark.parametrize("factor", [0.3, 1.1, 1.5, 1000.0])
def test_hue_is_kept_even_where_chroma_stops(factor: float) -> None:
    before = colours()
    after = scale_saturation(before, factor)
    hue = [np.arctan2(*np.moveaxis(luv(rgb)[:, [2, 1]], -1, 0)) for rgb in (before, after)]
    chroma = np.hypot(*np.moveaxis(luv(before)[:, 1:], -1, 0))
    turn = np.abs(np.angle(np.exp(1j * (hue[1] - hue[0]))))
    assert (turn * chroma).max() < 1e-2  # in units of u*, v*, of which 1 is just visible


def test_half_the_chroma_twice_is_a_quarter() -> None:
    before = colours()
    twice = scale_saturation(scale_saturation(before, 0.5), 0.5)
    assert (np.abs(twice - scale_saturation(before, 0.25)) / before.max(axis=1, keepdims=True)).max() < SINGLE_PRECISION


def test_chroma_stops_at_the_purest_light_of_its_hue() -> None:
    after = scale_saturation(colours(), 1e9)  # the greyest of single precision differ from grey by 1e-8
    assert np.isfinite(after).all()
    xyz = after.astype(np.float64) @ SRGB_TO_XYZ.T
    assert (xyz.min(axis=1) / xyz.max(axis=1)).min() > -1e-6, "no impossible light"
    locus = chromaticity(observer_weights("cie1931", np.arange(390, 701) * 1e-9) @ XYZ_TO_SRGB.T)
    assert to_polygon(chromaticity(after), locus).max() < 3e-4  # r·Δθ²/8, Δθ ≤ 0.1 rad between the locus' 1 nm steps


def to_polygon(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each point (n, 2) from the closed polygon's edges."""
    sides = np.roll(corners, -1, axis=0) - corners
    offsets = points[:, None] - corners
    along = np.clip((offsets * sides).sum(axis=-1) / (sides**2).sum(axis=-1), 0, 1)
    return np.asarray(np.linalg.norm(offsets - along[..., None] * sides, axis=-1).min(axis=1))


def test_the_blue_primary_stays_finite_where_luv_alone_would_not() -> None:
    blue = np.array([0, 0, 1], dtype=np.float32)
    factors = np.linspace(1.0, 3.0, 41)
    largest = [float(scale_saturation(blue, factor).max()) for factor in factors]
    assert (np.diff(largest) >= 0).all() and largest[-1] == largest[20] < 100


def test_what_is_purer_than_any_light_is_left_as_it_is() -> None:
    imaginary = (np.array([[0.0, 1.0, 0.0], [1.0, 0.3, -0.2], [0.2, 0.001, 1.0]]) @ XYZ_TO_SRGB.T).astype(np.float32)
    assert scale_saturation(imaginary, 5.0) == pytest.approx(imaginary, rel=1e-5, abs=1e-5)


def test_black_negative_and_imaginary_light_makes_no_nan() -> None:
    xyz = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, -1, 1], [-15, 1, 0], [0, 1, -5], [-1, -1, -1], [-1, 0, 1]])
    before = (xyz @ XYZ_TO_SRGB.T).astype(np.float32)
    for factor in FACTORS:
        after = scale_saturation(before, factor)
        assert np.isfinite(after).all() and (after[0] == 0).all()
        assert np.abs(after).max() <= np.abs(before).max() * 1.01
    assert scale_saturation(before, 0.0) == pytest.approx(
        np.repeat(before @ SRGB_TO_XYZ[1], 3).reshape(-1, 3), abs=1e-5
    )


def test_negative_light_scales_as_its_positive() -> None:
    before = colours(100)
    for factor in (0.4, 1.3):
        assert (scale_saturation(-before, factor) == -scale_saturation(before, factor)).all()


def test_neutrals_stay_neutral() -> None:
    grey = np.repeat(np.linspace(0, 4, 50, dtype=np.float32), 3).reshape(-1, 3)
    for factor in FACTORS:
        assert scale_saturation(grey, factor) == pytest.approx(grey, abs=1e-5)


@pytest.mark.parametrize("factor", [-0.1, math.nan, math.inf, -math.inf])
def test_factors_that_make_no_sense_are_refused(factor: float) -> None:
    with pytest.raises(
        UserError, match=r"saturation: .*; expected a factor of 0 or more; 0 is grey, 1 changes nothing"
    ):
        scale_saturation(colours(1), factor)


REC2020_PRIMARIES = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), (0.3127, 0.3290))


def test_xyz_comes_back_as_the_colour_that_it_was(tmp_path: Path) -> None:
    xyz = np.random.default_rng(0).random((4, 5, 3)).astype(np.float32)
    tifffile.imwrite(tmp_path / "xyz.tif", xyz, photometric="rgb")
    picture = read_picture(tmp_path / "xyz.tif", space="xyz")
    np.testing.assert_allclose(picture.rgb @ SRGB_TO_XYZ.T, xyz, atol=1e-6)
    assert picture.rgb.min() < 0, "random XYZ leaves sRGB"
    assert any("XYZ" in note for note in picture.notes)


def test_display_white_is_white(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "w.tif", np.full((2, 2, 3), D65_WHITE, dtype=np.float32), photometric="rgb")
    np.testing.assert_allclose(read_picture(tmp_path / "w.tif", space="xyz").rgb, 1, atol=1e-6)


def test_a_display_signal_is_no_xyz(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4)).save(tmp_path / "p.png")
    with pytest.raises(UserError, match=r"p\.png: holds integers.*expected three float channels of CIE XYZ"):
        read_picture(tmp_path / "p.png", space="xyz")
    tifffile.imwrite(tmp_path / "g.tif", np.ones((3, 3), dtype=np.float32))
    with pytest.raises(UserError, match="has one channel"):
        read_picture(tmp_path / "g.tif", space="xyz")
    with pytest.raises(UserError, match='space: "lab"; expected srgb or xyz'):
        read_picture(tmp_path / "g.tif", space="lab")


def test_primaries_that_a_file_states_are_obeyed(tmp_path: Path) -> None:
    rgb = np.random.default_rng(1).random((4, 5, 3)).astype(np.float32)
    header = {"type": OpenEXR.scanlineimage, "chromaticities": tuple(np.ravel(REC2020_PRIMARIES))}
    channels = {c: np.ascontiguousarray(rgb[..., j]) for j, c in enumerate("RGB")}
    OpenEXR.File(header, channels).write(str(tmp_path / "wide.exr"))
    picture = read_picture(tmp_path / "wide.exr")
    np.testing.assert_allclose(picture.rgb @ SRGB_TO_XYZ.T, rgb @ rgb_to_xyz(REC2020_PRIMARIES).T, atol=1e-5)
    assert "converted from the file's own primaries" in picture.notes


def test_colours_outside_srgb_reach_the_target(tmp_path: Path) -> None:
    green = np.broadcast_to(np.array([-0.2, 0.9, -0.05], dtype=np.float32), (24, 32, 3))
    tifffile.imwrite(tmp_path / "green.tif", green, photometric="rgb")
    near = {"shape": [12, 16], "planes": ["0.1 mm"]}
    target = hv.target_for(hv.load("holochrome-8").edit(near), tmp_path / "green.tif")
    np.testing.assert_allclose(target.stack[0], green, atol=1e-5)


def test_planes_between_are_made_like_the_others(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    tifffile.imwrite(tmp_path / "p.tif", rng.random((24, 32, 3)).astype(np.float32), photometric="rgb")
    system = hv.load("holochrome-8").edit({"shape": [12, 16], "planes": ["1 mm", "1.2 mm"]})
    alone = hv.target_for(system, tmp_path / "p.tif")
    more = hv.target_for(system, tmp_path / "p.tif", planes=np.array([1e-3, 1.1e-3, 1.2e-3]))
    np.testing.assert_array_equal(more.stack[[0, 2]], alone.stack)
    assert more.planes_m == (1e-3, 1.1e-3, 1.2e-3)
