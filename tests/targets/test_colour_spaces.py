"""A float file may hold linear sRGB, CIE XYZ, or light of the primaries that its header states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.colour import D65_WHITE, SRGB_TO_XYZ, XYZ_TO_SRGB, import_colour_science
from holoview.targets.picture import read_picture, srgb_from_primaries
from holoview.util.errors import UserError

D65 = (0.3127, 0.3290)
SRGB = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), D65)
REC2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65)
DCI_P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.314, 0.351))
ACES = ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.0770), (0.32168, 0.33767))
XYZ = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (1 / 3, 1 / 3))
FLOAT32 = 1e-6  # chromaticities and light are stored as float32


def exr(path: Path, channels: dict[str, NDArray[Any]], primaries: Any = None) -> Path:
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
    exr(path, {"RGB": xyz}) if name.endswith("exr") else tifffile.imwrite(path, xyz, photometric="rgb")
    picture = read_picture(path, space="xyz")
    assert picture.rgb == pytest.approx(rgb, abs=10 * FLOAT32)
    assert picture.notes[0] == "CIE XYZ converted to linear sRGB"
    assert "colours outside sRGB" in picture.notes[-1]


def test_the_white_of_xyz_is_d65_at_y_of_one(tmp_path: Path) -> None:
    exr(tmp_path / "white.exr", {"RGB": np.tile(D65_WHITE.astype(np.float32), (2, 2, 1))})
    assert read_picture(tmp_path / "white.exr", space="xyz").rgb == pytest.approx(np.ones((2, 2, 3)), abs=FLOAT32)


def test_integers_and_grey_are_no_xyz(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2)).save(tmp_path / "a.png")
    tifffile.imwrite(tmp_path / "b.tif", np.zeros((2, 2, 3), np.uint16), photometric="rgb")
    exr(tmp_path / "c.exr", {"Y": np.zeros((2, 2), np.float32)})
    for name, found in (("a.png", "holds integers"), ("b.tif", "holds integers"), ("c.exr", "has one channel")):
        with pytest.raises(UserError, match=f"{name}: {found}.*; expected three float channels of CIE XYZ; save it as"):
            read_picture(tmp_path / name, space="xyz")


def test_another_space_is_refused(tmp_path: Path) -> None:
    exr(tmp_path / "a.exr", {"RGB": light()})
    with pytest.raises(UserError, match='space: "lab"; expected srgb or xyz'):
        read_picture(tmp_path / "a.exr", space="lab")


@pytest.mark.parametrize(
    ("name", "primaries"),
    [("ITU-R BT.2020", REC2020), ("DCI-P3", DCI_P3), ("ACES2065-1", ACES)],
)
def test_stated_primaries_are_converted_as_colour_science_does(tmp_path: Path, name: str, primaries: Any) -> None:
    science = import_colour_science()
    picture = read_picture(exr(tmp_path / "a.exr", {"RGB": light()}, primaries))
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
    picture = read_picture(exr(tmp_path / "a.exr", {"RGB": light()}, SRGB))
    assert picture.rgb == pytest.approx(light(), abs=FLOAT32)


def test_a_header_may_say_that_the_file_holds_xyz(tmp_path: Path) -> None:
    picture = read_picture(exr(tmp_path / "a.exr", {"RGB": light()}, XYZ))
    assert picture.rgb == pytest.approx(light() @ XYZ_TO_SRGB.T, abs=FLOAT32)
    assert picture.notes[0] == "CIE XYZ, as its header says, converted to linear sRGB"


def test_the_asked_space_wins_over_the_header_and_says_so(tmp_path: Path) -> None:
    picture = read_picture(exr(tmp_path / "a.exr", {"RGB": light()}, REC2020), space="xyz")
    assert picture.rgb == pytest.approx(light() @ XYZ_TO_SRGB.T, abs=FLOAT32)
    assert picture.notes[0].endswith("the chromaticities in its header are ignored")


def test_grey_has_no_primaries(tmp_path: Path) -> None:
    grey = np.full((2, 3), 0.5, np.float32)
    assert (read_picture(exr(tmp_path / "a.exr", {"Y": grey}, REC2020)).rgb == 0.5).all()


@pytest.mark.parametrize(
    "primaries",
    [
        ((0.3, 0.3), (0.4, 0.4), (0.5, 0.5), D65),
        ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3, 0.0)),
        ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3, float("nan"))),
    ],
)
def test_primaries_that_span_nothing_are_refused(tmp_path: Path, primaries: Any) -> None:
    exr(tmp_path / "a.exr", {"RGB": light()}, primaries)
    with pytest.raises(
        UserError, match=r"a\.exr: its header states the chromaticities \(.*; expected red, green, blue"
    ):
        read_picture(tmp_path / "a.exr")
