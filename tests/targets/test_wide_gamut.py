"""Targets outside sRGB: CIE XYZ files, and OpenEXR files that state their own primaries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

import holoview as hv
from holoview.colour import D65_WHITE, SRGB_TO_XYZ, rgb_to_xyz
from holoview.targets.picture import read_picture
from holoview.util.errors import UserError

REC2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), (0.3127, 0.3290))


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
    header = {"type": OpenEXR.scanlineimage, "chromaticities": tuple(np.ravel(REC2020))}
    channels = {c: np.ascontiguousarray(rgb[..., j]) for j, c in enumerate("RGB")}
    OpenEXR.File(header, channels).write(str(tmp_path / "wide.exr"))
    picture = read_picture(tmp_path / "wide.exr")
    np.testing.assert_allclose(picture.rgb @ SRGB_TO_XYZ.T, rgb @ rgb_to_xyz(REC2020).T, atol=1e-5)
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
