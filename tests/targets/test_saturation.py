"""Chroma scaled in CIE LCHuv keeps luminance and hue, and stops where no light is purer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.colour import D65_WHITE, SRGB_TO_XYZ, XYZ_TO_SRGB, import_colour_science, observer_weights
from holoview.targets.picture import scale_saturation
from holoview.util.errors import UserError

FLOAT32 = 2e-6  # of the largest channel: a few roundings to float32, 6e-8 each, through matrices of gain up to 3.2 · 10
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
    assert (np.abs(grey - luminance[:, None]) / luminance[:, None]).max() < FLOAT32


@pytest.mark.parametrize("factor", FACTORS)
def test_luminance_is_kept(factor: float) -> None:
    before = np.concatenate([colours(), -colours(50), [[-0.5, 0.2, 3.0], [0.0, -1.0, 0.1], [1e-20, 0, 0]]])
    after = scale_saturation(before, factor)
    change = np.abs(after.astype(np.float64) @ SRGB_TO_XYZ[1] - before @ SRGB_TO_XYZ[1])
    assert (change / np.maximum(np.abs(after).max(axis=1), 1e-30)).max() < FLOAT32


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
    assert (np.abs(twice - scale_saturation(before, 0.25)) / before.max(axis=1, keepdims=True)).max() < FLOAT32


def test_chroma_stops_at_the_purest_light_of_its_hue() -> None:
    after = scale_saturation(colours(), 1000.0)
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
