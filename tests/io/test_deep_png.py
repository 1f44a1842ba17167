"""Pictures of 16 bits say their colour space, and hold colours that leave sRGB."""

from __future__ import annotations

from pathlib import Path

import colour as colour_science
import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.holograms.files.image_reader import read_raster
from holoview.holograms.files.pictures import png_texts, write_deep_png
from holoview.light.colour import COLOUR_SPACES, D65_WHITE, XYZ_TO_SRGB

STANDARD = {"srgb": "sRGB", "p3": "Display P3", "rec2020": "ITU-R BT.2020"}


def test_a_file_of_16_bits_is_read_as_it_was_written(tmp_path: Path) -> None:
    signal = np.random.default_rng(0).random((5, 7, 3))
    file = tmp_path / "deep.png"
    write_deep_png(file, signal, COLOUR_SPACES["p3"], {"holoview.plane": "10 mm"})
    assert np.abs(read_raster(file).values - signal).max() <= 0.5 / 65535 + 1e-7
    assert png_texts(file)["holoview.plane"] == "10 mm"


@pytest.mark.parametrize(("name", "points"), [("srgb", (1, 13)), ("p3", (12, 13)), ("rec2020", (9, 14))])
def test_the_file_names_its_space(tmp_path: Path, name: str, points: tuple[int, int]) -> None:
    """Code points of ITU-T H.273: primaries 1 (BT.709), 12 (P3, D65), 9 (BT.2020); curves 13 (sRGB), 14 (BT.2020)."""
    file = tmp_path / "deep.png"
    write_deep_png(file, np.zeros((2, 2, 3)), COLOUR_SPACES[name], {})
    data = file.read_bytes()
    at = data.index(b"cICP")
    assert data[at - 4 : at] == (4).to_bytes(4, "big")
    assert tuple(data[at + 4 : at + 8]) == (*points, 0, 1)
    with Image.open(file) as image:
        primaries = np.array(image.info["chromaticity"][2:]).reshape(3, 2)
    assert primaries == pytest.approx(np.array(COLOUR_SPACES[name].chromaticities), abs=1e-5)


@pytest.mark.parametrize("name", list(COLOUR_SPACES))
def test_spaces_are_the_standards(name: str) -> None:
    """Primaries and curves of colour-science, whose matrices and constants of BT.2020 are rounded to three decimals."""
    space, standard = COLOUR_SPACES[name], colour_science.RGB_COLOURSPACES[STANDARD[name]]
    assert np.array(space.chromaticities) == pytest.approx(standard.primaries, abs=1e-12)
    linear = np.linspace(0, 1, 50)
    grey = space.encode(linear[:, None] * D65_WHITE)
    assert grey[:, 0] == pytest.approx(standard.cctf_encoding(linear), abs=3e-4)
    assert space.from_xyz == pytest.approx(standard.matrix_XYZ_to_RGB, abs=2e-3)


def test_a_laser_leaves_srgb_and_not_rec_2020() -> None:
    xyz = hv.load("holochrome-8").amplitudes[0, :1] * 0.1 * np.array([0.2, 0.8, 0.1])
    assert (xyz @ XYZ_TO_SRGB.T).min() < 0
    assert (xyz @ COLOUR_SPACES["rec2020"].from_xyz.T).min() > (xyz @ XYZ_TO_SRGB.T).min()
