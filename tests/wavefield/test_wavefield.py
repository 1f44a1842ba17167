"""A field on a plane is checked when it is made."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.util.errors import UserError
from holoview.wavefield.wavefield import Wavefield

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
        (VALUES, (8e-6, 0.0), [640e-9, 532e-9], "pitch"),
        (VALUES, (8e-6, 8e-6), [640e-9], "wavelengths"),
        (VALUES, (8e-6, 8e-6), [640e-9, np.inf], "wavelengths"),
    ],
)
def test_an_impossible_field_is_refused(values, pitch_m, wavelengths_m, where: str) -> None:
    with pytest.raises(UserError) as error:
        Wavefield(values, pitch_m, np.array(wavelengths_m))
    assert error.value.where == where
