"""The frequencies that stops pass: rows and columns of integers say the same as each frequency decided by itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from holoview.light.model.bench_parts import Relay
from holoview.light.model.passband import Band, band_of_rows, column_support, stop_rows, stop_weights
from holoview.light.model.stops import SquareStop
from holoview.light.numerics.sampling import frequency_indices
from holoview.util.errors import UserError

PITCH_M, λ = 8e-6, 532e-9


def _mask(rows: NDArray[np.int32], columns: int) -> NDArray[np.bool_]:
    kx = frequency_indices(columns)
    return (abs(kx) >= rows[:, :1]) & (kx >= rows[:, 1:2]) & (kx <= rows[:, 2:])


_sines = st.floats(0.003, 0.06)
_relays = st.builds(
    Relay,
    iris_na=st.one_of(st.none(), _sines.map(lambda na: na + 0.0)),
    square=st.one_of(st.none(), _sines, st.sampled_from(["first order", "first order at 600 nm"])),
).flatmap(
    lambda relay: st.builds(
        Relay,
        iris_na=st.just(relay.iris_na),
        square=st.just(relay.square),
        centre_na=st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)) if relay.has_aperture else st.just((0, 0)),
        dc_block_na=st.one_of(st.none(), st.floats(1e-4, 0.0029)),
    )
)
_sizes = st.tuples(st.integers(2, 40), st.integers(2, 40))


@settings(deadline=None)
@given(
    relay=_relays, pixels=_sizes, upsample=st.integers(1, 3), limits=st.tuples(st.integers(0, 60), st.integers(0, 60))
)
def test_columns_pass_the_frequencies_that_rows_pass(
    relay: Relay, pixels: tuple[int, int], upsample: int, limits: tuple[int, int]
) -> None:
    padded = (pixels[0] * upsample, pixels[1] * upsample)
    rows = stop_rows(padded, upsample, PITCH_M, relay, λ, limits)
    columns = column_support(rows, padded[1])
    np.testing.assert_array_equal(_mask(columns, padded[0]).T, _mask(rows, padded[1]))


@settings(deadline=None)
@given(relay=_relays, pixels=_sizes, upsample=st.integers(1, 3))
def test_the_band_is_the_smallest_rectangle_around_what_passes(
    relay: Relay, pixels: tuple[int, int], upsample: int
) -> None:
    padded = (pixels[0] * upsample, pixels[1] * upsample)
    relay = Relay(iris_na=relay.iris_na, square=relay.square, centre_na=relay.centre_na)  # a DC block can hide an edge
    rows = stop_rows(padded, upsample, PITCH_M, relay, λ)
    ky, kx = np.nonzero(_mask(rows, padded[1]))
    if len(ky) == 0:
        assert band_of_rows([rows]).shape == (0, 0)
        return
    ky, kx = frequency_indices(padded[0])[ky], frequency_indices(padded[1])[kx]
    expected = Band((int(ky.min()), int(kx.min())), (int(ky.max()), int(kx.max())))
    assert band_of_rows([rows]) == expected


@settings(deadline=None)
@given(
    iris_na=st.floats(0.01, 0.03),
    centre=st.tuples(st.floats(-0.002, 0.002), st.floats(-0.002, 0.002)),
    padded=st.tuples(st.integers(40, 90), st.integers(40, 90)),
)
def test_weighted_cells_have_the_area_of_an_iris(
    iris_na: float, centre: tuple[float, float], padded: tuple[int, int]
) -> None:
    """An arc of chord c on a radius R differs from its chord by c³/(12·R) in area. With cells of diagonal d the arcs'
    sum is at most 2πR·d²/(12·R), d²/(6·R²) of the disc."""
    weights = stop_weights(padded, 1, PITCH_M, Relay(iris_na=iris_na, centre_na=centre), λ)
    assert weights is not None
    steps = [λ / (n * PITCH_M) for n in padded]
    area = weights.sum() * steps[0] * steps[1]
    allowed = (steps[0] ** 2 + steps[1] ** 2) / (6 * iris_na**2)
    assert area == pytest.approx(np.pi * iris_na**2, rel=allowed)


@settings(deadline=None)
@given(relay=_relays, pixels=_sizes, upsample=st.integers(1, 3))
def test_rows_hold_all_cells_of_which_a_part_passes(relay: Relay, pixels: tuple[int, int], upsample: int) -> None:
    padded = (pixels[0] * upsample, pixels[1] * upsample)
    weights = stop_weights(padded, upsample, PITCH_M, relay, λ)
    if weights is None:
        assert not relay.has_aperture and relay.dc_block_na is None
        return
    sharp, widened = (
        _mask(stop_rows(padded, upsample, PITCH_M, relay, λ, is_weighted=is_weighted), padded[1])
        for is_weighted in (False, True)
    )
    assert widened[weights > 1e-9].all() and widened[sharp].all()
    assert (weights >= 0).all() and (weights <= 1).all()
    assert (weights[sharp & (weights < 1)] > 0).all()


@pytest.mark.parametrize("pixels", [(30, 48), (45, 50), (31, 7)], ids=str)
@pytest.mark.parametrize("upsample", [1, 2, 3, 5])
@pytest.mark.parametrize("wavelength_m", [460e-9, 532e-9, 650e-9, 1550e-9])
def test_the_first_order_has_fewer_frequencies_than_the_modulator_has_pixels(
    pixels: tuple[int, int], upsample: int, wavelength_m: float
) -> None:
    """|u| < 1/(2·pitch) is |k| < P/(2u): n − 1 frequencies of n padded pixels where n is even, n where it is odd."""
    padded = (pixels[0] * upsample, pixels[1] * upsample)
    rows = stop_rows(padded, upsample, PITCH_M, Relay(square="first order"), wavelength_m)
    band = band_of_rows([rows])
    assert band.shape == tuple(n - (n % 2 == 0) for n in pixels)
    assert band.lowest == tuple(-h for h in band.highest)
    assert _mask(rows, padded[1]).sum() == band.shape[0] * band.shape[1]


def test_a_real_aperture_passes_more_orders_of_shorter_waves() -> None:
    relay, padded = Relay(square="first order at 600 nm"), (64, 64)
    widths = [band_of_rows([stop_rows(padded, 2, PITCH_M, relay, w)]).shape[0] for w in (450e-9, 600e-9, 640e-9)]
    assert widths == [2 * 21 + 1, 2 * 15 + 1, 2 * 14 + 1]  # |k| < 16·600/λ: 21.3, 16, 15
    ideal = Relay(square="first order")
    assert len({band_of_rows([stop_rows(padded, 2, PITCH_M, ideal, w)]).shape for w in (450e-9, 640e-9)}) == 1


@pytest.mark.parametrize("upsample", [2, 3, 4, 7])
def test_a_frequency_on_an_edge_is_blocked_whatever_the_rounding(upsample: int) -> None:
    """Of 120 pixels it is the 55th at 600 nm, where 60·550/600 comes out as 55.00000000000001."""
    relay, padded = Relay(square="first order at 550 nm"), (120 * upsample, 120 * upsample)
    band = band_of_rows([stop_rows(padded, upsample, PITCH_M, relay, 600e-9)])
    assert band == Band((-54, -54), (54, 54))


def test_a_displaced_stop_is_the_centred_one_at_other_frequencies() -> None:
    step = λ / (64 * PITCH_M / 2)  # direction sine between frequencies of 64 samples
    for shape in ({"iris_na": 9.5 * step}, {"square": 9.5 * step}):
        centred = _mask(stop_rows((64, 64), 2, PITCH_M, Relay(**shape), λ), 64)
        moved = _mask(stop_rows((64, 64), 2, PITCH_M, Relay(**shape, centre_na=(3 * step, -7 * step)), λ), 64)
        np.testing.assert_array_equal(moved, np.roll(centred, (3, -7), axis=(0, 1)))


@settings(deadline=None)
@given(relay=_relays, pixels=_sizes, upsample=st.integers(1, 3))
def test_the_steepest_sine_bounds_what_passes(relay: Relay, pixels: tuple[int, int], upsample: int) -> None:
    padded = (pixels[0] * upsample, pixels[1] * upsample)
    ky, kx = np.nonzero(_mask(stop_rows(padded, upsample, PITCH_M, relay, λ), padded[1]))
    sines = [λ * upsample / (n * PITCH_M) * frequency_indices(n)[k] for n, k in zip(padded, (ky, kx), strict=True)]
    assert np.hypot(*sines).max(initial=0.0) <= relay.steepest_sine(λ, PITCH_M) * (1 + 1e-12)  # rounding of the sines


def test_the_farthest_corner_of_a_displaced_square_is_the_steepest_direction() -> None:
    relay = Relay(square=0.02, centre_na=(-0.01, 0.02))
    assert relay.steepest_sine(λ, PITCH_M) == pytest.approx(np.hypot(0.03, 0.04))
    assert Relay(square=0.02, iris_na=0.025, centre_na=(-0.01, 0.02)).steepest_sine(λ, PITCH_M) == pytest.approx(
        0.025 + np.hypot(0.01, 0.02)
    )


@pytest.mark.parametrize(
    ("keys", "fragments"),
    [
        ({"square": "second order"}, ("square", "second order", "first order at 550 nm")),
        ({"square": "first order at 5"}, ("square", "no unit")),
        ({"square": 2.0}, ("square", "out of range", "first order")),
        ({"square": True}, ("square", "not a number")),
        ({"square": SquareStop(half_side_na=-0.1)}, ("square.half_side_na", "out of range")),
        ({"square": SquareStop(scale=0.0)}, ("square.scale", "out of range")),
        ({"square": SquareStop(wavelength_m=5.0)}, ("square.wavelength", "out of range")),
        ({"square": SquareStop(half_side_na=0.1, scale=2.0)}, ("square", "half_side_na alone")),
        ({"centre_na": [0.0, 0.01]}, ("centre_na", "without an iris or a square stop")),
        ({"square": 0.02, "centre_na": [0.1]}, ("centre_na", "[y, x]")),
        ({"aberration_m": {"Z4": 1e-8}}, ("aberration", "without an iris or a square stop")),
    ],
    ids=str,
)
def test_impossible_stops_are_refused(keys: dict[str, object], fragments: tuple[str, ...]) -> None:
    with pytest.raises(UserError) as caught:
        Relay(**keys)  # type: ignore[arg-type]
    for fragment in fragments:
        assert fragment in str(caught.value)
