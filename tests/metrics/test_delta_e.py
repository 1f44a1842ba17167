"""CIEDE2000 of images."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.holograms.metrics.fidelity import delta_e_linear_srgb, delta_e_map_xyz, delta_e_xyz
from holoview.light.colour import D65_WHITE, SRGB_TO_XYZ, import_colour_science
from holoview.util.errors import UserError


def _xyz_of_lab(lab: list[float]) -> np.ndarray:
    """CIE 15:2018, the inverse of CIELAB, relative to D65."""
    y = (lab[0] + 16) / 116
    f = np.array([y + lab[1] / 500, y, y - lab[2] / 200])
    return D65_WHITE * np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29))


@pytest.mark.parametrize(
    ("one", "other", "difference"),
    [
        # Sharma, Wu & Dalal (2005), table 1, pairs 1, 7, 17, 21, 34: four decimals.
        ([50.0000, 2.6772, -79.7751], [50.0000, 0.0000, -82.7485], 2.0425),
        ([50.0000, 0.0000, 0.0000], [50.0000, -1.0000, 2.0000], 2.3669),
        ([50.0000, 2.5000, 0.0000], [73.0000, 25.0000, -18.0000], 27.1492),
        ([50.0000, 2.5000, 0.0000], [50.0000, 3.1736, 0.5854], 1.0000),
        ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
    ],
)
def test_published_pairs(one: list[float], other: list[float], difference: float) -> None:
    assert delta_e_xyz(_xyz_of_lab(one), _xyz_of_lab(other)) == pytest.approx(difference, abs=1e-4)


def test_identical_images_differ_by_nothing_and_the_order_does_not_matter() -> None:
    one, other = np.random.default_rng(0).uniform(size=(2, 6, 7, 3))
    assert delta_e_linear_srgb(one, one) == 0.0
    assert delta_e_linear_srgb(one, other) == pytest.approx(delta_e_linear_srgb(other, one), rel=1e-12)


def test_black_to_white_is_one_hundred() -> None:
    white = np.ones((2, 2, 3))
    assert delta_e_linear_srgb(0 * white, white) == pytest.approx(100.0, abs=1e-6)


def test_linear_srgb_is_clipped_and_a_map_holds_each_pixel() -> None:
    one, other = np.random.default_rng(1).uniform(-0.5, 1.5, size=(2, 4, 5, 3))
    clipped = [np.clip(x, 0, 1) @ SRGB_TO_XYZ.T for x in (one, other)]
    pixels = delta_e_map_xyz(*clipped)
    assert pixels.shape == (4, 5)
    assert delta_e_linear_srgb(one, other) == pytest.approx(pixels.mean(), rel=1e-12)
    lab = [import_colour_science().XYZ_to_Lab(x[2, 3], [0.3127, 0.3290]) for x in clipped]
    assert pixels[2, 3] == pytest.approx(import_colour_science().delta_E(*lab, method="CIE 2000"), rel=1e-12)


def test_images_of_different_shapes_are_refused() -> None:
    with pytest.raises(UserError, match="expected"):
        delta_e_xyz(np.zeros((4, 4, 3)), np.zeros((4, 5, 3)))
    with pytest.raises(UserError, match="expected"):
        delta_e_xyz(np.zeros((4, 4)), np.zeros((4, 4)))
