"""Grid conventions: good FFT sizes, centred positions, frequencies with zero first."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from holoview.light.numerics.sampling import frequency_indices, is_fast_length, next_fast_length, positions

SMOOTH = sorted(2**a * 3**b * 5**c for a in range(14) for b in range(9) for c in range(7))


def test_good_sizes_are_the_products_of_two_three_and_five() -> None:
    assert [n for n in range(-2, 1001) if is_fast_length(n)] == [n for n in SMOOTH if n <= 1000]


@given(st.integers(0, 8000), st.sampled_from([1, 2, 3, 4, 5, 6, 8, 15, 16]))
def test_a_good_size_is_the_smallest_that_fits(at_least: int, multiple_of: int) -> None:
    expected = next(n for n in SMOOTH if n >= at_least and n % multiple_of == 0)
    assert next_fast_length(at_least, multiple_of) == expected


def test_a_multiple_that_no_good_size_has_is_refused() -> None:
    with pytest.raises(ValueError, match="multiple_of = 7"):
        next_fast_length(10, 7)


@pytest.mark.parametrize("n", [1, 2, 7, 8])
def test_positions_are_a_pitch_apart_and_centred(n: int) -> None:
    x = positions(n, 4e-6)
    assert x.sum() == pytest.approx(0.0, abs=1e-18)
    np.testing.assert_allclose(np.diff(x), 4e-6, rtol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 7, 8, 15, 360])
def test_frequency_indices_are_those_of_numpys_fft_with_zero_first(n: int) -> None:
    k = frequency_indices(n)
    np.testing.assert_array_equal(k, np.fft.ifftshift(np.arange(n) - n // 2))
    wave = np.exp(2j * np.pi * np.arange(n) * k[-1] / n)
    assert np.abs(np.fft.fft(wave)).argmax() == n - 1
