"""Colour: published tables and matrices, the sRGB curve, gamut mapping, and laser amplitudes that make white."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from assets import make_observers
from holoview.light import colour
from holoview.light.observers import WORDS
from holoview.util.errors import UserError

EIGHT = np.linspace(460e-9, 650e-9, 8)
THREE = np.array([460e-9, 532e-9, 638e-9])


# --- tables and observers -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("nm", "lms"),
    [
        # CVRL, Stockman & Sharpe (2000) 2° linear energy, linss2_10e_1.csv: six figures.
        (390, (4.15003e-04, 3.68349e-04, 9.54729e-03)),
        (400, (2.40836e-03, 2.26991e-03, 5.66498e-02)),
        (440, (4.02563e-02, 6.47782e-02, 9.91020e-01)),
        (500, (2.88959e-01, 4.27764e-01, 1.22839e-01)),
        (550, (9.40198e-01, 9.77193e-01, 1.95896e-03)),
        (600, (8.33982e-01, 3.34429e-01, 1.83459e-05)),
        (650, (1.65141e-01, 1.54480e-02, 0.0)),
    ],
)
def test_cone_fundamentals_match_the_published_table(nm: int, lms: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(colour.cone_fundamentals(nm * 1e-9)[0], lms, rtol=6e-6)


def test_cone_fundamentals_are_linear_between_whole_nanometres() -> None:
    ends = colour.cone_fundamentals([531e-9, 532e-9])
    np.testing.assert_allclose(colour.cone_fundamentals(531.25e-9)[0], 0.75 * ends[0] + 0.25 * ends[1], rtol=1e-9)


def test_the_ends_of_the_table_are_included_and_beyond_is_refused() -> None:
    assert np.isfinite(colour.cone_fundamentals([390e-9, 830e-9])).all()
    assert np.isfinite(colour.observer_weight_derivatives("eye", [390e-9, 830e-9])).all()
    for beyond in (389.9e-9, 830.1e-9, 532.0, np.nan):
        with pytest.raises(UserError, match=r"390…830 nm"):
            colour.cone_fundamentals(beyond)


def test_an_observers_slopes_are_the_slope_between_entries_and_the_mean_of_both_at_one() -> None:
    xyz = colour.observer_weights("eye", [531e-9, 532e-9, 533e-9])
    left, right = np.diff(xyz, axis=0) / 1e-9
    slopes = colour.observer_weight_derivatives("eye", [531.5e-9, 532e-9])
    # Differences over 2e-3 nm of values near 1 keep about 1e-12 of 1/nm, and 1e-9 of the coordinate's rounding.
    np.testing.assert_allclose(slopes[0], left, rtol=1e-8, atol=1e-3)
    np.testing.assert_allclose(slopes[1], (left + right) / 2, rtol=1e-8, atol=1e-3)


def test_the_luminance_of_the_cone_observer_peaks_near_555_nm() -> None:
    nm = np.arange(390, 831)
    luminance = colour.observer_weights("eye", nm * 1e-9)[:, 1]
    assert abs(nm[luminance.argmax()] - 555) <= 2  # it lies at 556 nm; 555 nm is 0.05 % below
    assert luminance.max() == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(
    ("nm", "xyz"),
    [(450, (0.3362, 0.0380, 1.77211)), (555, (0.5120501, 1.0, 0.00575)), (600, (1.0622, 0.631, 0.0008))],
)
def test_the_1931_observer_matches_the_published_table(nm: int, xyz: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(colour.observer_weights("cie1931", nm * 1e-9)[0], xyz, rtol=1e-6)


def test_an_eye_and_the_1931_observer_agree_roughly_but_not_exactly() -> None:
    eye, cie = (colour.observer_weights(kind, EIGHT) for kind in ("eye", "cie1931"))
    difference = np.abs(eye - cie).max()
    assert 0.01 < difference < 0.3


def test_a_mono_camera_sees_every_wavelength_as_white() -> None:
    np.testing.assert_array_equal(colour.observer_weights("mono", EIGHT), np.tile(colour.D65_WHITE, (8, 1)))


def test_an_unknown_observer_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UserError, match="did you mean eye"):
        colour.observer_weights("eyes", EIGHT)


@pytest.mark.parametrize("name", list(colour.TABLES))
def test_the_tables_are_those_of_colour_science(name: str) -> None:
    kept = (make_observers.FOLDER / f"{name}.csv").read_text(encoding="utf-8")
    assert kept == make_observers.table(*colour.TABLES[name])


@pytest.mark.long
def test_observers_import_nothing_slow_and_colour_science_changes_nothing_of_the_process() -> None:
    program = (
        "import sys, warnings, numpy as np; from holoview import colour as c; c.observer_weights('eye', 532e-9); "
        "assert 'colour' not in sys.modules; before = (np.get_printoptions(), list(warnings.filters)); "
        "c.import_colour_science(); assert (np.get_printoptions(), list(warnings.filters)) == before"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)


# --- sRGB -----------------------------------------------------------------------------------------------------------


def test_the_srgb_matrix_rounds_to_the_published_one() -> None:
    published = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]  # IEC 61966-2-1
    np.testing.assert_allclose(colour.SRGB_TO_XYZ, published, atol=5.1e-5)


def test_white_and_the_primaries_are_where_the_standard_puts_them() -> None:
    np.testing.assert_allclose(colour.D65_WHITE, [0.9505, 1.0, 1.0891], atol=5e-5)  # IEC 61966-2-1, four decimals
    np.testing.assert_allclose(colour.xyz_to_linear_srgb(colour.D65_WHITE), [1, 1, 1], atol=1e-14)
    chromaticities = colour.SRGB_TO_XYZ[:2] / colour.SRGB_TO_XYZ.sum(axis=0)
    np.testing.assert_allclose(chromaticities.T, [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]], atol=1e-14)


def test_the_srgb_curve_has_its_published_values_and_its_inverse() -> None:
    assert colour.srgb_encode(0.18) == pytest.approx(0.461356, abs=1e-6)  # 18 % grey: 117.6 of 255
    assert colour.srgb_decode(0.5) == pytest.approx(0.214041, abs=1e-6)
    x = np.linspace(-1.5, 1.5, 3001)
    np.testing.assert_allclose(colour.srgb_decode(colour.srgb_encode(x)), x, atol=1e-7)  # the two pieces meet to 1e-8


def test_the_srgb_curve_is_odd_finite_and_rising() -> None:
    x = np.linspace(-2, 2, 4001)
    y = colour.srgb_encode(x)
    np.testing.assert_array_equal(colour.srgb_encode(-x), -y)
    assert (np.diff(y) > 0).all()
    assert colour.srgb_encode(0.0) == 0.0 and colour.srgb_encode(1.0) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("how", colour.GAMUT_MAPS)
def test_a_gamut_map_lands_inside_and_leaves_inside_alone(how: str) -> None:
    rng = np.random.default_rng(0)
    inside, wild = rng.uniform(0, 1, (50, 40, 3)), rng.normal(0.5, 2, (50, 40, 3))
    np.testing.assert_allclose(colour.gamut_map(inside, how), inside, atol=1e-15)
    mapped = colour.gamut_map(wild, how)
    assert mapped.min() >= 0.0 and mapped.max() <= 1.0


def test_desaturating_keeps_luminance_and_hue_and_clipping_does_not() -> None:
    rng = np.random.default_rng(1)
    wild = rng.normal(0.5, 1, (500, 3))
    luminance = wild @ colour.SRGB_TO_XYZ[1]
    wild, luminance = wild[(luminance > 0) & (luminance < 1)], luminance[(luminance > 0) & (luminance < 1)]
    mapped = colour.gamut_map(wild, "desaturate")
    np.testing.assert_allclose(mapped @ colour.SRGB_TO_XYZ[1], luminance, atol=1e-14)
    before, after = wild - luminance[:, None], mapped - luminance[:, None]
    np.testing.assert_allclose(np.cross(before, after), 0.0, atol=1e-12)
    assert np.abs(colour.gamut_map(wild) @ colour.SRGB_TO_XYZ[1] - luminance).max() > 0.1


def test_mapping_by_hue_keeps_the_hue_and_only_brightness_above_white_is_lost() -> None:
    wild = np.random.default_rng(2).normal(0.5, 1, (500, 3))
    luminance = wild @ colour.SRGB_TO_XYZ[1]
    wild, luminance = wild[luminance > 0.05], luminance[luminance > 0.05]
    mapped = colour.gamut_map(wild, "hue")
    # scaled back to its luminance, a colour lies on the line from the grey of this luminance to the colour before
    scale = luminance / (mapped @ colour.SRGB_TO_XYZ[1])
    before, after = wild - luminance[:, None], mapped * scale[:, None] - luminance[:, None]
    np.testing.assert_allclose(np.cross(before, after), 0.0, atol=1e-10)
    assert (scale > 1 - 1e-12).all()
    np.testing.assert_allclose(colour.gamut_map([3.0, 0.6, 0.3], "hue"), [1, 0.2, 0.1], rtol=1e-12)
    np.testing.assert_array_equal(colour.gamut_map([-1.0, -0.5, 0.2], "hue"), [0, 0, 0])


def test_desaturating_takes_excess_light_to_white_and_negative_light_to_black() -> None:
    np.testing.assert_array_equal(
        colour.gamut_map([[3.0, 2.0, -1.0], [-1.0, -0.5, 0.2]], "desaturate"), [[1] * 3, [0] * 3]
    )


def test_an_unknown_gamut_map_is_refused() -> None:
    with pytest.raises(UserError, match="did you mean clip"):
        colour.gamut_map(np.zeros(3), "clipp")


def test_eight_bit_colours_are_rounded_and_survive_a_round_trip() -> None:
    codes = np.tile(np.arange(256, dtype=np.uint8)[:, None], (1, 3))
    np.testing.assert_array_equal(colour.to_srgb8(colour.srgb_decode(codes / 255)), codes)
    assert colour.to_srgb8([-1.0, 0.5, 2.0]).tolist() == [0, 188, 255]


# --- white ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", WORDS)
@pytest.mark.parametrize("wavelengths", [EIGHT, THREE], ids=["8 lasers", "3 lasers"])
def test_all_lasers_together_make_d65_white(kind: str, wavelengths: np.ndarray) -> None:
    weights = colour.observer_weights(kind, wavelengths)
    amplitudes = colour.white_amplitudes(weights, np.ones((2, len(wavelengths))))
    assert (amplitudes > 0.01).all()
    np.testing.assert_array_equal(amplitudes[0], amplitudes[1])
    np.testing.assert_allclose(amplitudes.mean(axis=0) @ weights, colour.D65_WHITE, atol=1e-9)


def test_a_laser_on_in_fewer_frames_is_brighter_by_as_much() -> None:
    weights = colour.observer_weights("eye", THREE)
    shares = colour.white_amplitudes(weights, np.ones((1, 3)))[0]
    np.testing.assert_allclose(colour.white_amplitudes(weights, np.eye(3)), 3 * np.diag(shares), rtol=1e-9)
    sequence = np.array([[1, 1, 0], [1, 0, 1], [1, 1, 0]])
    np.testing.assert_allclose(colour.white_amplitudes(weights, sequence), sequence * shares * [1, 1.5, 3], rtol=1e-9)


def test_a_laser_that_is_never_on_takes_no_part() -> None:
    weights = colour.observer_weights("eye", EIGHT)
    sequence = np.ones((1, 8))
    sequence[0, 3] = 0
    amplitudes = colour.white_amplitudes(weights, sequence)
    assert amplitudes[0, 3] == 0.0
    np.testing.assert_allclose(amplitudes[0] @ weights, colour.D65_WHITE, atol=1e-9)


def test_mono_shares_are_equal() -> None:
    weights = colour.observer_weights("mono", EIGHT)
    np.testing.assert_allclose(colour.white_amplitudes(weights, np.ones((1, 8))), np.full((1, 8), 1 / 8), rtol=1e-12)


def test_any_wavelengths_that_can_make_white_do_and_the_others_reach_its_luminance() -> None:
    from scipy.optimize import nnls

    rng = np.random.default_rng(2)
    feasible = 0
    for _ in range(60):
        weights = colour.observer_weights("eye", rng.uniform(400e-9, 700e-9, rng.integers(1, 17)))
        mixture = colour.white_amplitudes(weights, np.ones((1, len(weights))))[0]
        assert (mixture > 0).all()
        if nnls(weights.T, colour.D65_WHITE)[1] < 1e-10:
            feasible += 1
            np.testing.assert_allclose(mixture @ weights, colour.D65_WHITE, atol=1e-9)
        else:
            assert mixture @ weights[:, 1] == pytest.approx(1.0, abs=1e-12)
    assert 10 < feasible < 60  # both branches were met


def test_two_lasers_that_cannot_make_white_come_as_near_as_they_can() -> None:
    weights = colour.observer_weights("eye", [532e-9, 638e-9])
    mixture = colour.white_amplitudes(weights, [[1, 1]])[0]
    red_shares = np.linspace(0, 1, 1001)
    candidates = np.stack([1 - red_shares, red_shares], axis=-1) / weights[:, 1] @ weights
    least = np.linalg.norm(candidates - colour.D65_WHITE, axis=-1).min()
    assert np.linalg.norm(mixture @ weights - colour.D65_WHITE) < 1.002 * least  # the pull to even shares costs 0.07 %


@pytest.mark.parametrize("sequence", [[1, 1, 1], [[1, 1]], [[1, 0.5, 1]], np.zeros((0, 3)), [[0, 0, 0]]])
def test_a_sequence_that_does_not_fit_is_refused(sequence: object) -> None:
    with pytest.raises(UserError, match="sequence"):
        colour.white_amplitudes(colour.observer_weights("eye", THREE), np.asarray(sequence))
