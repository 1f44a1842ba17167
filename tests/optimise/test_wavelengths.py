"""Projection of wavelengths onto the allowed range and spacing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.wavelengths import project_wavelengths
from holoview.util.errors import UserError

LOW_NM, HIGH_NM, SPACING_NM = 440.0, 660.0, 4.0
SETTINGS = Settings(wavelength_range_m=(440e-9, 660e-9), wavelength_spacing_m=4e-9)
ROUNDING_NM = 1e-9  # of sums of a few hundred nanometres, 1e-13, with room

wanted = st.lists(st.floats(380.0, 720.0), min_size=1, max_size=8)
# Gaps beyond the spacing, as shares of the room that is left: any feasible set of eight or fewer.
shares = st.lists(st.floats(0.0, 1.0), min_size=9, max_size=9)


def _allowed_nm(values_nm: list[float]) -> np.ndarray:
    return project_wavelengths(np.array(values_nm) * 1e-9, SETTINGS) * 1e9


def _feasible_nm(values_nm: list[float], shares: list[float]) -> np.ndarray:
    """Any wavelengths that are in range, spaced, and ordered as `values_nm`."""
    count = len(values_nm)
    room = HIGH_NM - LOW_NM - (count - 1) * SPACING_NM
    gaps = room * np.array(shares[: count + 1]) / max(sum(shares[: count + 1]), 1.0)
    rising = LOW_NM + np.cumsum(gaps[:count]) + SPACING_NM * np.arange(count)
    out = np.empty(count)
    out[np.argsort(values_nm, kind="stable")] = rising
    return out


def test_wavelengths_that_are_allowed_stay_as_they_are() -> None:
    known = [638.0, 440.0, 532.0, 660.0, 536.0]
    np.testing.assert_allclose(_allowed_nm(known), known, rtol=1e-15)


def test_two_that_are_too_close_part_around_their_middle() -> None:
    np.testing.assert_allclose(_allowed_nm([531.0, 500.0, 530.0]), [532.5, 500.0, 528.5], rtol=1e-12)


def test_at_the_end_of_the_range_the_neighbours_make_room() -> None:
    np.testing.assert_allclose(_allowed_nm([700.0, 659.0, 500.0]), [660.0, 656.0, 500.0], rtol=1e-12)


@pytest.mark.long
@settings(derandomize=True, deadline=None)
@given(wanted)
def test_what_is_allowed_is_in_range_spaced_and_in_the_same_order(values: list[float]) -> None:
    found = _allowed_nm(values)
    assert found.min() >= LOW_NM - ROUNDING_NM and found.max() <= HIGH_NM + ROUNDING_NM
    order = np.argsort(values, kind="stable")
    assert (np.diff(found[order]) >= SPACING_NM - ROUNDING_NM).all()
    np.testing.assert_allclose(_allowed_nm(found.tolist()), found, rtol=0, atol=ROUNDING_NM)


@settings(derandomize=True, deadline=None)
@given(wanted, shares)
def test_nothing_that_is_allowed_is_nearer(values: list[float], shares: list[float]) -> None:
    found, other = _allowed_nm(values), _feasible_nm(values, shares)
    nearest, far = (float(np.linalg.norm(np.array(values) - point)) for point in (found, other))
    assert nearest <= far + ROUNDING_NM


@settings(derandomize=True, deadline=None)
@given(wanted, shares)
def test_it_is_a_projection_onto_a_convex_set(values: list[float], shares: list[float]) -> None:
    found = _allowed_nm(values)
    towards = _feasible_nm(values, shares) - found
    # ⟨x − p, y − p⟩ ≤ 0 for each allowed y: stronger than being no farther than y.
    assert float((np.array(values) - found) @ towards) <= 1e-6  # nm²; rounding of products of hundreds of nm


def test_a_range_without_room_is_refused() -> None:
    narrow = Settings(wavelength_range_m=(500e-9, 507e-9), wavelength_spacing_m=4e-9)
    known = project_wavelengths(np.array([501e-9, 503e-9]), narrow)
    assert np.diff(known) == pytest.approx(4e-9)
    with pytest.raises(UserError, match="500 to 507 nm for 3 lasers 4 nm apart; expected at least 8 nm"):
        project_wavelengths(np.array([501e-9, 503e-9, 505e-9]), narrow)


def test_a_range_that_is_just_wide_enough_holds_them_all() -> None:
    tight = Settings(wavelength_range_m=(500e-9, 508e-9), wavelength_spacing_m=4e-9)
    np.testing.assert_allclose(
        project_wavelengths(np.array([501e-9, 600e-9, 400e-9]), tight) * 1e9, [504, 508, 500], rtol=1e-12
    )
