"""Chromaticity and gamut area."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.holograms.metrics.gamut import SRGB_AREA, chromaticity, gamut_area
from holoview.light.colour import D65_WHITE, SRGB_TO_XYZ, observer_weights
from holoview.util.errors import UserError


def test_white_and_black_have_their_chromaticity_and_none() -> None:
    xy = chromaticity(np.array([[D65_WHITE, 0.2 * D65_WHITE], [np.zeros(3), np.ones(3)]]))
    np.testing.assert_allclose(xy[0], [[0.3127, 0.3290]] * 2, atol=1e-14)
    assert np.isnan(xy[1, 0]).all()
    np.testing.assert_allclose(xy[1, 1], [1 / 3, 1 / 3])


def test_the_area_of_srgb_is_that_of_its_triangle() -> None:
    assert gamut_area(chromaticity(SRGB_TO_XYZ.T)) == pytest.approx(SRGB_AREA, abs=1e-12)


def test_the_area_is_that_of_the_hull_in_any_order_and_with_points_inside() -> None:
    square = np.array([[0, 0], [1, 1], [1, 0], [0, 1], [0.5, 0.5], [0.2, 0.9], [0.5, 0.0], [1, 1]])
    for order in range(5):
        assert gamut_area(np.random.default_rng(order).permutation(square)) == pytest.approx(1.0, abs=1e-14)


def test_lasers_span_more_than_srgb_and_more_lasers_never_less() -> None:
    three = observer_weights("cie1931", [460e-9, 532e-9, 638e-9])
    eight = observer_weights("cie1931", np.array([460, 480, 500, 520, 532, 560, 600, 638]) * 1e-9)
    assert SRGB_AREA < gamut_area(chromaticity(three)) < gamut_area(chromaticity(eight))


def test_a_line_or_a_point_has_no_area() -> None:
    assert gamut_area([[0.3, 0.3]]) == gamut_area([[0.1, 0.1], [0.2, 0.2]]) == 0.0
    assert gamut_area([[0.0, 0.0], [0.25, 0.25], [0.5, 0.5]]) == 0.0


def test_chromaticities_that_are_not_finite_are_refused() -> None:
    with pytest.raises(UserError, match="finite"):
        gamut_area(chromaticity(np.zeros((3, 3))))
