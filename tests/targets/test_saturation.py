"""Chroma scaled in CIE LCHuv, against colour-science and against what mustn't change."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.colour import D65_WHITE, SRGB_TO_XYZ, XYZ_TO_SRGB, colour_science
from holoview.errors import UserError
from holoview.targets.saturation import scaled_saturation

WHITE_XY = D65_WHITE[:2] / D65_WHITE.sum()


def _colours() -> np.ndarray:
    return np.random.default_rng(0).random((7, 11, 3)).astype(np.float32)


@pytest.mark.parametrize("factor", [0.3, 0.8, 1.4])
def test_chroma_is_scaled_as_colour_science_scales_it(factor: float) -> None:
    colour, rgb = colour_science(), _colours().astype(np.float64)
    lch = colour.models.Luv_to_LCHuv(colour.XYZ_to_Luv(rgb @ SRGB_TO_XYZ.T, WHITE_XY))
    lch[..., 1] *= factor
    expected = colour.Luv_to_XYZ(colour.models.LCHuv_to_Luv(lch), WHITE_XY) @ XYZ_TO_SRGB.T
    # The result is float32; a chromaticity far out of gamut divides by a small v′.
    np.testing.assert_allclose(scaled_saturation(_colours(), factor), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("factor", [0.0, 0.5, 2.0])
def test_luminance_stays(factor: float) -> None:
    before, after = (rgb @ SRGB_TO_XYZ[1] for rgb in (_colours(), scaled_saturation(_colours(), factor)))
    np.testing.assert_allclose(after, before, rtol=1e-5, atol=1e-6)


def test_nothing_is_grey_and_one_is_the_same() -> None:
    grey = scaled_saturation(_colours(), 0.0)
    np.testing.assert_allclose(grey, np.repeat(grey[..., :1], 3, axis=-1), atol=1e-6)
    np.testing.assert_array_equal(scaled_saturation(_colours(), 1.0), _colours())


def test_black_and_colours_outside_srgb_stay_finite() -> None:
    odd = np.array([[[0, 0, 0], [-0.1, 0.4, 0.2], [2, 0, 0], [0, 0, 1]]], dtype=np.float32)
    for factor in (0.0, 0.7, 3.0, 50.0):
        scaled = scaled_saturation(odd, factor)
        assert np.isfinite(scaled).all()
        assert (scaled[0, 0] == 0).all()


@pytest.mark.parametrize("factor", [-0.1, float("nan"), float("inf")])
def test_other_factors_are_refused(factor: float) -> None:
    with pytest.raises(UserError, match=r"saturation: .*; expected a factor of 0 or more"):
        scaled_saturation(_colours(), factor)
