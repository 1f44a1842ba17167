"""White and the colour space of a picture are those that its file means: 12 bits in 16, P3, Rec. 2020, gamma."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms

from holoview.holograms.files.colour_profile import icc_profile
from holoview.holograms.files.pictures import read_pattern, write_deep_png
from holoview.holograms.targets.focal_stack import Film, read_resized_pictures
from holoview.holograms.targets.picture import depth_notes, read_depth, read_picture
from holoview.light.colour import COLOUR_SPACES, XYZ_TO_SRGB, rgb_to_xyz, srgb_decode, srgb_encode
from holoview.util.errors import UserError

SHAPE = (24, 32)


def _levels(bits: int, seed: int = 0) -> NDArray[np.uint16]:
    levels = np.random.default_rng(seed).integers(0, 1 << bits, SHAPE).astype(np.uint16)
    levels[0, 0] = (1 << bits) - 1
    return levels


def _save(path: Path, samples: NDArray[np.uint16]) -> Path:
    if path.suffix == ".png":
        Image.fromarray(samples).save(path)
    else:
        tifffile.imwrite(path, samples)
    return path


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("bits", [10, 12, 14])
def test_white_of_fewer_bits_in_16_is_white(bits: int, suffix: str, tmp_path: Path) -> None:
    levels = _levels(bits)
    full = (1 << bits) - 1
    expected = srgb_decode(levels / full)
    shift = np.uint16(16 - bits)
    for stored in (levels, levels << shift, levels << shift | levels >> np.uint16(2 * bits - 16)):
        picture = read_picture(_save(tmp_path / f"a{suffix}", stored))
        # a level that was filled up to 16 bits is rounded to 2⁻¹⁶ of the signal, of which the curve's slope is 2.28
        np.testing.assert_allclose(picture.rgb[..., 0], expected, atol=2.28 * 2.0**-16)
    assert any(
        f"white is taken as {full}" in note for note in read_picture(_save(tmp_path / f"a{suffix}", levels)).notes
    )


def test_a_dark_picture_stays_dark_and_is_told(tmp_path: Path) -> None:
    levels = np.minimum(_levels(12), np.uint16(3000))
    file = _save(tmp_path / "a.png", levels)
    picture = read_picture(file)
    assert picture.rgb.max() == pytest.approx(srgb_decode(3000 / 65535))
    assert any("nearly black" in note and "--space srgb12" in note for note in picture.notes)
    stated = read_picture(file, space="srgb12")
    assert stated.rgb.max() == pytest.approx(srgb_decode(3000 / 4095)) and "nearly" not in str(stated.notes)
    full = read_picture(_save(tmp_path / "b.png", _levels(12)), space="srgb16")
    assert full.rgb.max() == pytest.approx(srgb_decode(4095 / 65535))


def test_a_tiff_states_its_white(tmp_path: Path) -> None:
    tags: Any = [(281, 3, 1, 4095, True)]  # MaxSampleValue
    tifffile.imwrite(tmp_path / "a.tif", np.full(SHAPE, 2000, np.uint16), extratags=tags)
    picture = read_picture(tmp_path / "a.tif")
    assert picture.rgb.max() == pytest.approx(srgb_decode(2000 / 4095))
    assert "white is 4095, as the file says (MaxSampleValue)" in picture.notes


def _with_chunk(path: Path, name: bytes, content: bytes) -> Path:
    """The PNG file with another chunk after its header."""
    data = path.read_bytes()
    chunk = struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
    path.write_bytes(data[:33] + chunk + data[33:])
    return path


def test_a_png_states_its_significant_bits(tmp_path: Path) -> None:
    """sBIT 12 with levels of 12 bits; levels above are scaled to 16 bits, as the standard asks: their white stays."""
    plain = _with_chunk(_save(tmp_path / "a.png", np.full(SHAPE, 2000, np.uint16)), b"sBIT", b"\x0c")
    assert read_picture(plain).rgb.max() == pytest.approx(srgb_decode(2000 / 4095))
    scaled = _with_chunk(_save(tmp_path / "b.png", np.full(SHAPE, 32007, np.uint16)), b"sBIT", b"\x0c")
    assert read_picture(scaled).rgb.max() == pytest.approx(srgb_decode(32007 / 65535))


def test_pictures_of_a_stack_have_one_white(tmp_path: Path) -> None:
    files = [_save(tmp_path / f"{k}.png", levels) for k, levels in enumerate((_levels(12), _levels(12) // 2))]
    with pytest.raises(UserError, match=r"1.png: has the white 65535; expected 4095 as 0.png; .*--space srgb12"):
        read_resized_pictures(files, SHAPE)
    with pytest.raises(UserError, match="has the white 65535"):
        list(Film(tmp_path).pictures())
    stated = read_resized_pictures(files, SHAPE, "srgb12")
    assert stated[1].rgb.max() == pytest.approx(srgb_decode(2047 / 4095))


def test_a_depth_map_of_12_bits_is_recognised_or_told(tmp_path: Path) -> None:
    levels = _levels(12)
    assert np.array_equal(read_depth(_save(tmp_path / "a.png", levels)), np.float32(levels / 4095))
    assert any("white is taken as 4095" in note for note in depth_notes(tmp_path / "a.png"))
    assert any("nearly black" in note for note in depth_notes(_save(tmp_path / "b.png", levels // 2)))


def test_patterns_of_modulators_keep_the_scale_of_their_file(tmp_path: Path) -> None:
    levels = _levels(12)
    assert np.array_equal(read_pattern(_save(tmp_path / "a.png", levels), SHAPE), np.float32(levels / 65535))


# --- colour spaces ----------------------------------------------------------------------------------------------------


def _colours(seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).random((*SHAPE, 3))


@pytest.mark.parametrize("name", list(COLOUR_SPACES))
def test_what_is_written_in_a_colour_space_is_read_as_it(name: str, tmp_path: Path) -> None:
    rgb, space = _colours(), COLOUR_SPACES[name]
    write_deep_png(tmp_path / "a.png", space.encode(rgb @ np.linalg.inv(XYZ_TO_SRGB).T), space, {})
    picture = read_picture(tmp_path / "a.png")
    # half a level of 16 bits, times the steepest slope of a curve (2.5) and of a matrix (sum of a row: 2.3)
    np.testing.assert_allclose(picture.rgb, rgb, atol=0.5 / 65535 * 2.5 * 2.3 + 2e-6)
    assert bool(picture.notes) == (name != "srgb")


def _s15(*numbers: float) -> bytes:
    return struct.pack(f">{len(numbers)}i", *(round(x * 65536) for x in numbers))


def _profile(chromaticities: Any, curve: bytes) -> bytes:
    """A display profile (ICC.1:2022) of primaries with the white D65, adapted to D50 by Bradford's matrix."""
    to_d50 = np.array([[1.0478112, 0.0228866, -0.0501270], [0.0295424, 0.9904844, -0.0170491],
                       [-0.0092345, 0.0150436, 0.7521316]])  # fmt: skip
    columns = (to_d50 @ rgb_to_xyz(chromaticities)).T
    tags = {
        name: b"XYZ \0\0\0\0" + _s15(*column) for name, column in zip((b"rXYZ", b"gXYZ", b"bXYZ"), columns, strict=True)
    }
    tags |= dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve)
    tags[b"desc"] = b"desc\0\0\0\0" + struct.pack(">I", 5) + b"Wide\0"
    tags[b"wtpt"] = b"XYZ \0\0\0\0" + _s15(0.9642, 1.0, 0.8249)
    place, table, body = 132 + 12 * len(tags), b"", b""
    for name, content in tags.items():
        padded = content + b"\0" * (-len(content) % 4)
        table += name + struct.pack(">II", place + len(body), len(content))
        body += padded
    head = struct.pack(">I4sI4s4s4s", place + len(body), b"lcms", 0x04300000, b"mntr", b"RGB ", b"XYZ ")
    head += b"\0" * 12 + b"acsp" + b"\0" * 28 + _s15(0.9642, 1.0, 0.8249)
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + body


SRGB_CURVE = b"para\0\0\0\0\0\x03\0\0" + _s15(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
GAMMA = b"curv\0\0\0\0" + struct.pack(">IH", 1, round(1.8 * 256))
TABLE = b"curv\0\0\0\0" + struct.pack(">I1024H", 1024, *np.rint(np.linspace(0, 1, 1024) ** 2 * 65535).astype(int))


@pytest.mark.parametrize(("curve", "decode"), [
    (SRGB_CURVE, srgb_decode), (GAMMA, lambda s: s ** (461 / 256)), (TABLE, lambda s: s**2)
], ids=["formula", "exponent", "table"])  # fmt: skip
@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
def test_an_icc_profile_of_a_display_is_applied(suffix: str, curve: bytes, decode: Any, tmp_path: Path) -> None:
    p3 = COLOUR_SPACES["p3"]
    codes = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8).repeat(16, 0).repeat(16, 1)
    options = {"quality": 100, "subsampling": 0} if suffix == ".jpg" else {}
    Image.fromarray(codes).save(tmp_path / f"a{suffix}", icc_profile=_profile(p3.chromaticities, curve), **options)
    picture = read_picture(tmp_path / f"a{suffix}")
    expected = decode(codes / 255.0) @ (XYZ_TO_SRGB @ np.linalg.inv(p3.from_xyz)).T
    # D50 is stated to 5e-5, times rows of XYZ to sRGB of size 6, in both directions; codes of a JPEG are one level off,
    # at a slope of 2.5 and rows up to 1.5
    np.testing.assert_allclose(picture.rgb, expected, atol=0.02 if suffix == ".jpg" else 1e-3)
    assert any("converted from its colour space, Wide" in note for note in picture.notes)


def _tabled(table: NDArray[np.float64]) -> bytes:
    """A profile of a lattice (n, n, n, 3) of XYZ under D50, up to 1.99997, with straight curves (ICC.1:2022, mft2)."""
    nodes = len(table)
    straight = struct.pack(">2H", 0, 65535) * 3
    values = np.rint(np.clip(table / (1 + 32767 / 32768), 0, 1) * 65535).astype(">u2").tobytes()
    content = b"mft2\0\0\0\0" + bytes([3, 3, nodes, 0]) + _s15(1, 0, 0, 0, 1, 0, 0, 0, 1)
    content += struct.pack(">HH", 2, 2) + straight + values + straight
    tags = {b"A2B0": content, b"desc": b"desc\0\0\0\0" + struct.pack(">I", 6) + b"Table\0\0\0"}
    tags[b"wtpt"] = b"XYZ \0\0\0\0" + _s15(0.9642, 1.0, 0.8249)
    place, index, body = 132 + 12 * len(tags), b"", b""
    for name, tag in tags.items():
        index += name + struct.pack(">II", place + len(body), len(tag))
        body += tag + b"\0" * (-len(tag) % 4)
    head = struct.pack(">I4sI4s4s4s", place + len(body), b"lcms", 0x02400000, b"scnr", b"RGB ", b"XYZ ")
    head += b"\0" * 12 + b"acsp" + b"\0" * 28 + _s15(0.9642, 1.0, 0.8249)
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + index + body


def _squared_p3() -> bytes:
    """Of 33 nodes each way: squares of the signal in the primaries of Display P3."""
    axis = np.linspace(0, 1, 33) ** 2
    rgb = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    to_d50 = np.array([[1.0478112, 0.0228866, -0.0501270], [0.0295424, 0.9904844, -0.0170491],
                       [-0.0092345, 0.0150436, 0.7521316]])  # fmt: skip
    return _tabled(rgb @ (to_d50 @ rgb_to_xyz(COLOUR_SPACES["p3"].chromaticities)).T)


ADOBE = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))


@pytest.mark.parametrize(
    "profile",
    [
        _profile(COLOUR_SPACES["p3"].chromaticities, SRGB_CURVE),
        _profile(ADOBE, b"curv\0\0\0\0" + struct.pack(">IH", 1, 563)),
        _squared_p3(),
    ],
    ids=["Display P3", "Adobe RGB", "tables"],
)
def test_a_picture_with_a_profile_has_the_numbers_of_littlecms(profile: bytes, tmp_path: Path) -> None:
    # muted colours, which sRGB holds: littleCMS clips others
    codes = np.rint(255 * (0.35 + 0.35 * _colours())).astype(np.uint8)
    codes[0, 0] = 255
    Image.fromarray(codes).save(tmp_path / "a.png", icc_profile=profile)
    source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
    srgb = ImageCms.createProfile("sRGB")
    transform = ImageCms.buildTransform(source, srgb, "RGB", "RGB", ImageCms.Intent.RELATIVE_COLORIMETRIC)
    theirs = np.asarray(ImageCms.applyTransform(Image.fromarray(codes), transform))
    ours = 255 * srgb_encode(read_picture(tmp_path / "a.png").rgb)
    inside = ((theirs > 0) & (theirs < 255)).all(axis=-1)
    inside[0, 0] = True
    assert inside.mean() > 0.9
    # half a level of theirs; of tables also half a level of the wide space, times 1.66 (rows) and 1.4 (curves), and
    # what a square differs from a chord between nodes 15 levels apart
    tolerance = 0.8 if b"rXYZ" in profile else 3.0
    assert np.abs(ours - theirs)[inside].max() < tolerance


def test_a_red_beyond_srgb_stays_what_it_is() -> None:
    # the red of Display P3 in sRGB, by its published primaries: 1.2249, −0.0421, −0.0196 in linear light
    profile = icc_profile(_squared_p3())
    assert profile is not None
    red = profile.linear_srgb(np.array([[[1.0, 0.0, 0.0]]]))[0, 0]
    np.testing.assert_allclose(red, [1.2249, -0.0421, -0.0196], atol=0.01)


def test_a_profile_of_srgb_changes_nothing(tmp_path: Path) -> None:
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    codes = (_colours() * 255).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.png", icc_profile=profile)
    picture = read_picture(tmp_path / "a.png")
    assert np.array_equal(picture.rgb, srgb_decode(codes / 255.0).astype(np.float32)) and not picture.notes


@pytest.mark.parametrize(
    "profile", [b"x", b"\0" * 200, _profile(COLOUR_SPACES["p3"].chromaticities, b"mft2"), _squared_p3()[:5000]]
)
def test_a_profile_that_is_no_display_s_is_told(profile: bytes, tmp_path: Path) -> None:
    Image.fromarray((_colours() * 255).astype(np.uint8)).save(tmp_path / "a.png", icc_profile=profile)
    assert any("colour profile ignored" in note for note in read_picture(tmp_path / "a.png").notes)


def test_a_png_of_linear_light_is_linear(tmp_path: Path) -> None:
    """gAMA 1 says that the samples are light; 0.45455 with sRGB's primaries is sRGB."""
    codes = (_colours() * 255).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.png")
    linear = read_picture(_with_chunk(tmp_path / "a.png", b"gAMA", struct.pack(">I", 100_000)))
    np.testing.assert_allclose(linear.rgb, codes / 255.0, atol=1e-6)
    Image.fromarray(codes).save(tmp_path / "b.png")
    usual = read_picture(_with_chunk(tmp_path / "b.png", b"gAMA", struct.pack(">I", 45_455)))
    assert np.array_equal(usual.rgb, srgb_decode(codes / 255.0).astype(np.float32)) and not usual.notes


def test_of_an_animation_the_first_picture_is_the_target(tmp_path: Path) -> None:
    pictures = [Image.fromarray((_colours(seed) * 255).astype(np.uint8)) for seed in range(3)]
    pictures[0].save(tmp_path / "a.png", save_all=True, append_images=pictures[1:])
    picture = read_picture(tmp_path / "a.png")
    assert np.array_equal(picture.rgb, srgb_decode(np.asarray(pictures[0]) / 255.0).astype(np.float32))
    assert "an animation of 3 pictures, the first is used" in picture.notes


def test_a_transfer_that_is_not_known_is_told(tmp_path: Path) -> None:
    Image.fromarray((srgb_encode(_colours()) * 255).astype(np.uint8)).save(tmp_path / "a.png")
    picture = read_picture(_with_chunk(tmp_path / "a.png", b"cICP", bytes((9, 16, 0, 1))))
    assert any("H.273 code points 9, 16" in note for note in picture.notes)
