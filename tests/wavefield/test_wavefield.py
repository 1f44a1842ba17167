"""A field on a plane is checked when it is made."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.holograms.fields.wavefield import Wavefield, shifted_colours
from holoview.util.errors import UserError

VALUES = np.ones((1, 2, 3, 4), dtype=np.complex64)


def test_a_field_says_what_it_is() -> None:
    field = Wavefield(VALUES, (8e-6, 8e-6), np.array([640e-9, 532e-9]))
    assert field.shape == (3, 4)
    assert field.frames == 1
    assert field.describe() == "4 × 3 samples at 8 um, 2 wavelengths (640, 532 nm)"


@pytest.mark.parametrize(
    ("values", "pitch_m", "wavelengths_m", "where"),
    [
        (VALUES[0], (8e-6, 8e-6), [640e-9, 532e-9], "field"),
        (VALUES * np.nan, (8e-6, 8e-6), [640e-9, 532e-9], "field"),
        (VALUES.astype(complex) * 1e300, (8e-6, 8e-6), [640e-9, 532e-9], "field"),
        (VALUES, (8e-6, 0.0), [640e-9, 532e-9], "pitch"),
        (VALUES, (8e-6, 8e-6), [640e-9], "wavelengths"),
        (VALUES, (8e-6, 8e-6), [640e-9, np.inf], "wavelengths"),
    ],
)
def test_an_impossible_field_is_refused(values, pitch_m, wavelengths_m, where: str) -> None:
    with pytest.raises(UserError) as error:
        Wavefield(values, pitch_m, np.array(wavelengths_m))
    assert error.value.where == where


def test_each_colour_moves_by_its_shift_and_what_comes_from_outside_is_dark() -> None:
    """By whole samples exactly; a smooth spot, 1e-7 of its height at the rim, also by parts of samples."""
    y, x = np.meshgrid(*(np.arange(n) - n // 2 for n in (40, 48)), indexing="ij")

    def spot(row: float, column: float) -> np.ndarray:
        return np.exp(-((y - row) ** 2 + (x - column) ** 2) / 18) * np.exp(0.3j * (x - column))

    values = np.stack([spot(0, 0), spot(0, 0)])[None].astype(np.complex64)
    moved = shifted_colours(values, [(16e-6, -24e-6), (2e-6, 1e-6)], (8e-6, 8e-6))
    np.testing.assert_allclose(moved[0, 0], np.where((y >= -18) & (x < 21), spot(2, -3), 0), atol=1e-6)
    assert (moved[0, 0, :2] == 0).all() and (moved[0, 0, :, -3:] == 0).all()
    np.testing.assert_allclose(moved[0, 1, 1:, 1:], spot(0.25, 0.125)[1:, 1:], atol=1e-6)
    with pytest.raises(UserError, match="colour shifts: 1"):
        shifted_colours(values, [(0, 0)], (8e-6, 8e-6))
    with pytest.raises(UserError, match="colour shifts: 125 × 0"):
        shifted_colours(values, [(1e-3, 0), (0, 0)], (8e-6, 8e-6))
