"""One picture and its pattern become captures: the placement is found, what was assumed is said."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.captures.dataset import SHAPE_KEEPING, turned
from holoview.captures.picture_import import dark_noise, import_picture
from holoview.util.errors import UserError
from tests.captures.far_field import CAMERA_PITCH_M, PITCH_M, WAVELENGTH_M, FarField, photograph, spread_pattern
from tests.explored import explored

KNOWN = {"wavelength_m": WAVELENGTH_M, "pitch_m": PITCH_M, "camera_pitch_m": CAMERA_PITCH_M}


@pytest.mark.parametrize("orientation", explored(SHAPE_KEEPING, 2))
def test_orientation_focal_length_and_axis_are_found(orientation: str) -> None:
    bench = FarField(coma=-0.5, defocus=0.2)
    pattern = spread_pattern(3)
    upright = photograph(pattern, bench, seed=4)
    found = import_picture(np.ascontiguousarray(turned(upright, orientation)), pattern, focal_length_m=0.26, **KNOWN)
    captures = found.captures
    assert found.placements[0].orientation == orientation
    # Scales are tried in steps of 0.6 %, and envelopes are binned by two pixels or so; speckle then moves the axis.
    assert captures.focal_length_m == pytest.approx(bench.focal_length_m, rel=0.01)
    axis = [a - (n - 1) / 2 for a, n in zip(bench.axis, bench.shape, strict=True)]
    assert np.array(captures.axis_m) / CAMERA_PITCH_M == pytest.approx(axis, abs=3.0)
    assert "electrons a count" in " ".join(found.notes)
    assert "a full turn" in " ".join(found.notes)


def test_the_saturated_zero_order_is_left_out() -> None:
    pattern = spread_pattern(5)
    found = import_picture(
        photograph(pattern, FarField(coma=0, defocus=0), seed=6), pattern, focal_length_m=0.25, **KNOWN
    )
    row, column = (round(a) for a in FarField().axis)
    assert (found.captures.images[0, row - 1 : row + 2, column - 1 : column + 2] == 255).all()


def test_a_pattern_that_was_not_shown_is_refused() -> None:
    picture = photograph(spread_pattern(7), FarField(coma=0, defocus=0), seed=8)
    other = np.random.default_rng(9).integers(0, 256, (96, 128)).astype(np.uint8)
    with pytest.raises(UserError, match="speckle stands nowhere"):
        import_picture(picture, other, focal_length_m=0.25, **KNOWN)


@pytest.mark.parametrize(
    ("picture", "pattern", "said"),
    [
        (np.zeros((80, 80), np.uint8), spread_pattern(1), "at most 0 counts"),
        (np.full((80, 80), 99, np.uint8), np.full((32, 32), 7, np.uint8), "level 7 everywhere"),
        (np.full((20, 80), 99, np.uint8), spread_pattern(1), "at least 64 pixels"),
    ],
)
def test_pictures_that_cant_be_placed_are_refused(picture: np.ndarray, pattern: np.ndarray, said: str) -> None:
    with pytest.raises(UserError, match=said):
        import_picture(picture, pattern, **KNOWN)


def test_the_noise_of_dark_pixels_is_measured() -> None:
    """3 × 10⁴ pairs of the darkest tenth; choosing the darkest by their means leaves their differences as they are."""
    light = 20 + np.random.default_rng(2).normal(0, 3, (550, 550))
    assert dark_noise(np.round(light).astype(np.uint16)) == pytest.approx(3, rel=0.05)
