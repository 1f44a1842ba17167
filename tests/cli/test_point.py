"""`holoview point`, `hv.point_light` and `hv.sections` tell the light of the image, and parts that add up to it."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import holoview as hv
from tests.cli.conftest import Outcome

Run = Callable[..., Outcome]

SMALL = ("holochrome-8", "--set", "shape=[12, 16]", "--random", "3")
KNOWN = ("--pitch", "8um", "--wavelength", "532nm")


def _picture(name: str) -> NDArray[np.uint8]:
    with Image.open(name) as image:
        return np.asarray(image)


def test_the_light_of_a_point_is_that_of_the_image_and_its_parts_add_up(holoview: Run) -> None:
    done = holoview("point", *SMALL, "--at", "20,7", "--plane", "9mm", "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    system = hv.load("holochrome-8").with_(shape=[12, 16])
    view = hv.simulate(system, hv.random_drive(system, 3), planes=["9 mm"], backend="torch64")
    np.testing.assert_allclose(found["xyz"], view.xyz[0, 7, 20], rtol=1e-9)
    np.testing.assert_allclose([each["intensity"] for each in found["lasers"]], view.intensity[0, :, 7, 20], rtol=1e-9)
    assert sum(each["share"] for each in found["orders"]) == pytest.approx(1)
    assert (found["x"], found["y"], found["plane"]) == (20, 7, "9 mm") and found["files"] == []


def test_sections_are_the_rows_and_columns_of_images() -> None:
    system = hv.load("holochrome-8").with_(shape=[12, 16])
    hologram = hv.Hologram(hv.random_drive(system, 3), system)
    planes = ["9 mm", "10 mm", "11 mm"]
    found, view = (
        hv.sections(hologram, planes=planes, at=(7, 20)),
        hv.simulate(hologram, planes=planes, backend="torch"),
    )
    # both in float32: 2⁻²⁴ for each of some 60 operations, of a sum of 24 × 32 random terms
    np.testing.assert_allclose(found.xz, view.xyz[:, 7], atol=60 * 2**-24 * view.xyz.max())
    np.testing.assert_allclose(found.yz, view.xyz[:, :, 20], atol=60 * 2**-24 * view.xyz.max())
    with pytest.raises(hv.UserError, match="don't rise"):
        hv.sections(hologram, planes=planes[::-1])
    with pytest.raises(hv.UserError, match="row 7, column 32"):
        hv.point_light(hologram, at=(7, 32))


def test_pictures_show_where_a_field_converges(holoview: Run) -> None:
    """A lens of 1 cm above the sample (20, 45): its sections are brightest there, and its whole area lights it."""
    y, x = np.mgrid[:64, :64] * 8e-6
    lens = np.exp(-1j * np.pi * ((x - 45 * 8e-6) ** 2 + (y - 20 * 8e-6) ** 2) / (532e-9 * 0.01))
    np.save("lens.npy", lens)
    done = holoview("point", "lens.npy", *KNOWN, "--plane", "1cm", "--at", "45,20", "--range", "6,14mm", "-o", "p.png")
    assert done.code == 0, done.err
    assert "x 45, y 20 at 10 mm" in done.out and "p-areas-1.png" in done.out
    for name, across in (("x-z", 45), ("y-z", 20)):
        picture = _picture(f"p-{name}.png")[..., 1].astype(float)
        assert picture.shape == (64, 65)
        rows, columns = np.nonzero(picture == picture.max())
        # 6 to 14 mm in 65 planes: the depth of focus λ/NA² of 532 nm/(0.026)² is 0.8 mm, 6 planes
        assert abs(rows.mean() - across) <= 1 and abs(columns.mean() - 32) <= 6
    assert _picture("p-areas-1.png")[..., 1].mean() > 200  # darker where light would leave the grid
    assert _picture("p-directions.png").shape == (64, 64, 3)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(("--at", "32,7"), "row 7, column 32"), (("--at", "left"), "--at"), (("--range", "12,8mm"), "smaller first"),
     (("--window", "7"), "window"), (("--pitch", "8um"), "--pitch")],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_a_sentence(holoview: Run, arguments: tuple[str, ...], words: str) -> None:
    done = holoview("point", *SMALL, *arguments, "-o", "p.png")
    assert done.code == 2 and words in done.err and not done.out
