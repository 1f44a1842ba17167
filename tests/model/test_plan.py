"""System → Plan: padded grids, stops as rows of a support, fixed-point phases, weights, slopes."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from holoview.light.colour import observer_weights
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.passband import band_limit
from holoview.light.model.plan import Plan, make_plan, walk_off
from holoview.light.model.system import System
from holoview.light.numerics.sampling import frequency_indices, is_fast_length
from holoview.util.errors import UserError


def _system(shape: tuple[int, int] = (6, 8), pitch_m: float = 8e-6, **changes: Any) -> System:
    modulator = Modulator(pitch_m=pitch_m, shape=shape, stroke_m=825e-9)
    base = System(
        wavelengths_m=[460e-9, 532e-9, 638e-9], amplitudes=[[1, 2, 3]], modulators=(modulator, modulator), gap_m=2e-3
    )
    return base.edit(changes)


# --- grid -----------------------------------------------------------------------------------------------------------


@given(
    st.integers(2, 60),
    st.integers(2, 60),
    st.integers(1, 9),
    st.sampled_from(["linear", "compact"]),
    st.integers(2, 4),
)
@settings(max_examples=60, deadline=None)
def test_the_field_lies_inside_a_good_grid_at_whole_pixels(
    rows: int, columns: int, upsample: int, how: str, padding: int
) -> None:
    grid = make_plan(_system((rows, columns), upsample=upsample, propagation=how, padding=padding)).grid
    assert grid.shape == (rows * upsample, columns * upsample)
    assert grid.pitch_m == 8e-6 / upsample
    for n, padded, offset in zip(grid.shape, grid.padded, grid.offset, strict=True):
        assert is_fast_length(padded)
        assert offset % upsample == 0
        assert offset >= 0 and offset + n <= padded
        if how == "linear":
            assert padded >= padding * n


def test_periodic_propagation_does_not_pad() -> None:
    grid = make_plan(_system(propagation="periodic")).grid
    assert grid.padded == grid.shape and grid.offset == (0, 0)


def test_compact_padding_covers_the_walk_off_of_the_steepest_ray_and_no_more_than_linear() -> None:
    system = _system((200, 300), propagation="compact", **{"relay1.iris_na": 0.01, "relay2.iris_na": 0.01})
    grid = make_plan(system, planes=[4e-3]).grid
    reach = 4e-3 * np.tan(np.arcsin(0.01)) / grid.pitch_m  # samples
    assert walk_off(system, 1, 4e-3) == pytest.approx(reach, rel=1e-12)
    for n, padded in zip(grid.shape, grid.padded, strict=True):
        assert n + reach <= padded < 2 * n


def test_frequencies_are_a_step_apart_on_the_padded_grid() -> None:
    grid = make_plan(_system()).grid
    for padded, step in zip(grid.padded, grid.frequency_step, strict=True):
        np.testing.assert_allclose(frequency_indices(padded) * step, np.fft.fftfreq(padded, grid.pitch_m), rtol=1e-14)


# --- stops ----------------------------------------------------------------------------------------------------------


def _support(plan: Plan, relay: int, wavelength: int) -> np.ndarray:
    rows = plan.transfer(relay, wavelength).support
    kx = frequency_indices(plan.grid.padded[1])
    return (abs(kx) >= rows[:, :1]) & (kx >= rows[:, 1:2]) & (kx <= rows[:, 2:])


def _masks(plan: Plan, relay: int, wavelength: int, distance_m: float) -> np.ndarray:
    """What passes, decided for each frequency by itself."""
    λ, stops = plan.system.wavelengths_m[wavelength], plan.relays[relay]
    uy, ux = (np.fft.fftfreq(p, plan.grid.pitch_m) for p in plan.grid.padded)
    sine2 = (λ * uy[:, None]) ** 2 + (λ * ux) ** 2
    passes = sine2 < 1
    from_centre = λ * uy[:, None] - stops.centre_na[0], λ * ux - stops.centre_na[1]
    if stops.iris_na is not None:
        passes &= from_centre[0] ** 2 + from_centre[1] ** 2 <= stops.iris_na**2
    if stops.square is not None:
        half = stops.square.half_side_sine(λ, plan.system.modulators[0].pitch_m)
        passes &= (np.abs(from_centre[0]) < half * (1 - 1e-12)) & (np.abs(from_centre[1]) < half * (1 - 1e-12))
    if stops.dc_block_na is not None:
        passes &= sine2 > stops.dc_block_na**2
    if plan.system.sampling.propagation != "periodic":
        limits = [
            1 / (λ * np.sqrt((2 * distance_m / (p * plan.grid.pitch_m)) ** 2 + 1)) for p in plan.grid.padded
        ]  # Matsushima & Shimobaba (2009), eq. 13
        passes &= (np.abs(uy)[:, None] <= limits[0]) & (np.abs(ux) <= limits[1])
    return passes


@pytest.mark.parametrize("shape", [(7, 9), (8, 12), (15, 6)], ids=str)
@pytest.mark.parametrize("propagation", ["linear", "periodic"])
@pytest.mark.parametrize(
    "stops",
    [
        {},
        {"relay2.iris_na": 0.0311},
        {"relay2.dc_block_na": 0.0123},
        {"relay2.iris_na": 0.0311, "relay2.dc_block_na": 0.0123},
        {"relay2.square": "first order"},
        {"relay2.square": "first order at 600 nm", "relay2.dc_block_na": 0.0123},
        {"relay2.square": 0.0271, "relay2.centre_na": [0.0043, -0.0117]},
        {"relay2.square": 0.0271, "relay2.iris_na": 0.0311, "relay2.centre_na": [-0.0021, 0.0153]},
        {"relay2.iris_na": 0.0311, "relay2.centre_na": [0.0021, 0.0153], "relay2.dc_block_na": 0.0123},
    ],
    ids=lambda stops: "+".join(stops) or "clear",
)
@pytest.mark.parametrize("distance_m", [0.0, 1.1e-3, 3e-3])
def test_the_rows_of_the_support_pass_just_what_the_stops_pass(
    shape: tuple[int, int], propagation: str, stops: dict[str, float], distance_m: float
) -> None:
    plan = make_plan(_system(shape, upsample=1, propagation=propagation, **stops), [distance_m])
    expected = _masks(plan, 1, 2, distance_m)
    np.testing.assert_array_equal(_support(plan, 1, 2), expected)
    assert expected.any()


@pytest.mark.parametrize("shape", [(9, 12), (12, 9)], ids=str)
def test_evanescent_waves_are_lost(shape: tuple[int, int]) -> None:
    plan = make_plan(_system(shape, pitch_m=0.3e-6, upsample=1, propagation="periodic"))
    support = _support(plan, 0, 2)
    np.testing.assert_array_equal(support, _masks(plan, 0, 2, 2e-3))
    assert not support.all()


def test_each_relay_has_its_own_stops() -> None:
    plan = make_plan(_system(propagation="periodic", **{"relay1.iris_na": 0.02, "relay2.iris_na": 0.04}))
    for relay in (0, 1):
        np.testing.assert_array_equal(_support(plan, relay, 1), _masks(plan, relay, 1, 1e-3))
    assert _support(plan, 0, 1).sum() < _support(plan, 1, 1).sum()


def test_the_band_limit_has_its_published_form_and_falls_with_distance() -> None:
    expected = 1 / (532e-9 * np.sqrt((2 * 10e-3 / (1024 * 4e-6)) ** 2 + 1))
    assert band_limit(1024, 4e-6, 532e-9, 10e-3) == pytest.approx(expected, rel=1e-14)
    assert band_limit(1024, 4e-6, 532e-9, 0.0) == 1 / 532e-9


# --- phases in fixed point ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("distance_m", [2e-3, 9.5e-3, 30e-3])
def test_wrapping_integers_give_the_paraxial_phase_of_every_frequency(distance_m: float) -> None:
    plan = make_plan(_system((384, 512)), [distance_m])
    transfer = plan.transfer(1, 0)
    k2 = np.arange(4097, dtype=np.uint64) ** 2
    for axis, words in enumerate(transfer.paraxial_words()):
        high, low = (int(word) for word in words)
        turn = Fraction(transfer.distance_m) * Fraction(transfer.wavelength_m) / 2
        turn /= (plan.grid.padded[axis] * Fraction(plan.grid.pitch_m)) ** 2
        exact = np.array([float(int(k) * turn % 1) for k in k2])
        fraction = (np.uint64(high << 16 | low) * k2 & np.uint64(2**48 - 1)) / 2**48
        error = np.abs((fraction - exact + 0.5) % 1 - 0.5)
        # 48 bits truncated, times 4096²: 2⁻²⁴ = 6e-8; rounding of the float64 inputs adds a few 1e-9.
        assert error.max() <= 1e-7
        assert low < 2**16


def test_no_distance_has_no_phase() -> None:
    plan = make_plan(_system(), [0.0])
    for transfer in (plan.transfer(1, 0), plan.stops(1, 0)):
        assert not transfer.paraxial_words().any()


# --- weights, slopes, planes ----------------------------------------------------------------------------------------


def test_frames_and_sources_are_averaged() -> None:
    system = _system(amplitudes=[[1, 2, 3], [4, 5, 0]], source={"directions": [[0, 0], [0, "5 mrad"], ["5 mrad", 0]]})
    plan = make_plan(system)
    np.testing.assert_allclose(plan.weights, np.array([[1, 2, 3], [4, 5, 0]]) / 6, rtol=1e-15)
    assert [plan.lit(i) for i in range(3)] == [[0, 1], [0, 1], [0]]


def test_colour_weights_are_the_observers() -> None:
    system = _system()
    np.testing.assert_array_equal(make_plan(system).colour_weights, observer_weights("eye", system.wavelengths_m))


def test_slopes_are_sines_of_direction_plus_tilt_in_samples_per_wavelength() -> None:
    tilts = [[0, 0], [1e-3, 0], [0, -2e-3]]
    system = _system(source={"directions": [[0.01, -0.02], [0.3, 0]], "tilts": tilts}, upsample=4)
    slopes = make_plan(system).slopes
    assert slopes.shape == (2, 3, 2)
    for i, direction in enumerate([[0.01, -0.02], [0.3, 0]]):
        for j, λ in enumerate([460e-9, 532e-9, 638e-9]):
            expected = np.sin(np.add(direction, tilts[j])) * 2e-6 / λ
            np.testing.assert_allclose(slopes[i, j], expected, rtol=1e-12, atol=1e-18)


def test_planes_are_the_systems_own_unless_others_are_asked_for() -> None:
    system = _system(planes=["9 mm", "11 mm"])
    assert make_plan(system).planes_m.tolist() == [9e-3, 11e-3]
    assert make_plan(system, ["3 mm", 0.004]).planes_m.tolist() == [3e-3, 4e-3]


@pytest.mark.parametrize(
    ("planes", "message"),
    [(["1 mm", "-1 mm"], r"planes\[1\]: -1 mm"), ([], "at least one"), ([float("nan")], r"planes\[0\]: nan")],
)
def test_a_plane_behind_the_modulator_and_no_plane_are_refused(planes: list[Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        make_plan(_system(), planes)


def test_a_transfer_is_derived_once() -> None:
    plan = make_plan(_system())
    assert plan.transfer(0, 1) is plan.transfer(0, 1)
    assert plan.transfer(0, 1).wavelength_m == 532e-9
