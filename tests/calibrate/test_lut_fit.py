"""Look-up tables from sweeps of the grey level: analytic ones, a real one, and files that aren't any."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from holoview.bench.calibrate.lut_fit import UNSEEN_SLOPE, fit_labelled, fit_lut
from holoview.bench.calibrate.lut_table import (
    compare_vendor,
    format_lut,
    levels_of_phases,
    lut_table,
    read_vendor_table,
    vendor_table,
    verify_turn,
)
from holoview.bench.calibrate.sweep import (
    Order,
    Sweep,
    format_readings,
    parse_sweep,
    parse_sweeps,
    read_sweep,
    read_sweeps,
)
from holoview.util.errors import UserError
from tests.explored import one_of_each

REAL = Path(__file__).resolve().parents[1] / "data" / "lcos_820nm_first_order_power.csv"
LEVELS = np.arange(128.0)


def _sweep(stroke_pi: float, gamma: float, seed: int, noise: float = 0.01, contrast: float = 0.0) -> Sweep:
    """P = b + a·(1 + c·φ/stroke)·sin²(φ/2) with φ = stroke·x^γ and white noise of that share of a."""
    x = LEVELS / LEVELS[-1]
    power = 20 + 2000 * (1 + contrast * x**gamma) * np.sin(stroke_pi * np.pi * x**gamma / 2) ** 2
    return Sweep(LEVELS, power + np.random.default_rng(seed).normal(0, 2000 * noise, len(x)))


STROKES = pytest.mark.parametrize(("stroke_pi", "gamma"), [(1.5, 0.8), (2.6, 1.4), (3.4, 1.0)])


@STROKES
def test_a_known_stroke_is_inside_its_interval(stroke_pi: float, gamma: float) -> None:
    lut = fit_lut(_sweep(stroke_pi, gamma, seed=3))
    low, high = (bound / np.pi for bound in lut.stroke_interval)
    # four half intervals: beyond 7.8 sigma chance is nil; a wrong branch is off by π
    assert lut.stroke / np.pi == pytest.approx(stroke_pi, abs=4 * (high - low) / 2)
    assert lut.residual < 0.015  # the noise is 0.01 of full power; of 128 readings it scatters by 6 %


@STROKES
def test_with_little_noise_the_table_follows_the_truth(stroke_pi: float, gamma: float) -> None:
    lut = fit_lut(_sweep(stroke_pi, gamma, seed=3, noise=1e-4))
    low, high = (bound / np.pi for bound in lut.stroke_interval)
    truth = (LEVELS / LEVELS[-1]) ** gamma
    # Where the phase is an extremum of the power it has no slope: noise^½ = 0.01 rad of 5. Curves through 16 knots
    # leave 0.007 near the steep beginning of x^0.8; the interval includes those through 12 and 24.
    assert np.abs(lut.stroke_fractions - truth).max() < 0.02
    assert high - low < 0.1


@pytest.mark.long
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    inside = 0
    for seed in range(8):
        low, high = fit_lut(_sweep(2.3, 1.2, seed, noise=0.02)).stroke_interval
        inside += low <= 2.3 * np.pi <= high
    assert inside >= 3  # 95 % each: fewer than three of eight has a chance of 4e-7


@pytest.mark.long
def test_contrast_that_changes_is_found_only_where_it_does() -> None:
    """Schwarz's criterion takes a slope by chance in 3 % of sweeps (χ² with one degree of freedom above ln 128); of 60
    sweeps without one it is 0.0083 (r.m.s.), of which this allows six."""
    unchanged, changing = fit_lut(_sweep(3.4, 1.1, seed=5)), fit_lut(_sweep(3.4, 1.1, seed=5, contrast=0.5))
    assert abs(unchanged.fits[0].slope * unchanged.stroke) < 0.05
    assert changing.fits[0].slope * changing.stroke == pytest.approx(0.5, abs=0.1)
    assert changing.stroke / np.pi == pytest.approx(3.4, abs=0.05)


def test_levels_rise_strictly_as_a_modulator_states_them() -> None:
    fractions = fit_lut(_sweep(2.6, 1.4, seed=1)).stroke_fractions
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    assert (np.diff(fractions) > 0).all()


@pytest.mark.long
def test_a_real_modulator_at_820_nm() -> None:
    lut = fit_lut(read_sweep(REAL))
    assert lut.linear_2pi == pytest.approx(0.33, abs=0.01)
    assert lut.linear_free == pytest.approx(0.22, abs=0.01)
    assert lut.residual < 0.03  # what a monotone table was known to leave
    # read off the curve: maxima at levels 168 and 238, a null at 208, and 0.43 of full power after the second maximum
    assert 3.4 < lut.stroke / np.pi < 3.7
    null = 160 + int(lut.fits[0].sweep.power[160:230].argmin())
    assert np.interp(null, lut.fits[0].sweep.levels, lut.phase) == pytest.approx(2 * np.pi, abs=0.15)


BAD = {
    "no such file": None,
    "two columns": "0,1,2,3\n" * 20,
    "isn't a finite number": "".join(f"{k},{'nan' if k == 7 else k}\n" for k in range(20)),
    "line 3": "0,1\n1,2\n2,many\n",
    "rows": "0,1\n1,2\n",
    "occurs twice": "".join(f"{k // 2},{k}\n" for k in range(40)),
    "rises from almost none": "".join(f"{k},100\n" for k in range(40)),
    "without a maximum": "".join(f"{k},{1000 * np.sin(k / 40) ** 2}\n" for k in range(40)),
    "can't be read": b"\xff\xfe\x00\x01",
    "a FITS file": b"SIMPLE  =                    T / conforms to FITS standard" + b" " * 2822 + b"\xe2\x00",
}


@pytest.mark.parametrize("said", BAD)
def test_bad_sweeps_are_refused_in_clear_words(said: str, tmp_path: Path) -> None:
    file, content = tmp_path / "sweep.csv", BAD[said]
    if content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError, match=said) as caught:
        fit_lut(read_sweep(file))
    assert said == "without a maximum" or str(file) in str(caught.value)


def test_headings_separators_and_order_of_rows_are_free(tmp_path: Path) -> None:
    file = tmp_path / "sweep.csv"
    file.write_text("level; power\n" + "".join(f"{k}; {(k - 20) ** 2}\n" for k in range(39, -1, -1)))
    sweep = read_sweep(file)
    assert sweep.levels.tolist() == list(range(40))
    assert sweep.power[0] == 400


# --- other spots and other files --------------------------------------------------------------------------------------

STARTS: dict[Order, float] = {"1": 0.0, "0": np.pi, "interferometer": 1.2}
NOISE = 0.005  # of the full power


def _table(
    order: Order, stroke_pi: float, seed: int, pedestal: float = 0.3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """256 levels, powers and phases of a modulator with a slow beginning: φ = stroke·(x + x²)/2."""
    levels = np.arange(256.0)
    x = levels / 255
    phase = stroke_pi * np.pi * (x + x**2) / 2
    power = pedestal + np.sin((phase - STARTS[order]) / 2) ** 2 + np.random.default_rng(seed).normal(0, NOISE, 256)
    return levels, power, phase


def _text(levels: np.ndarray, power: np.ndarray) -> str:
    return "".join(f"{level:g},{value:.6f}\n" for level, value in zip(levels, power, strict=True))


@pytest.mark.parametrize(("order", "counts_down"), one_of_each(product(STARTS, [False, True])))
def test_the_spot_is_recognised_and_its_phase_is_found(order: Order, *, counts_down: bool) -> None:
    levels, power, phase = _table(order, 2.7, seed=11)
    lut = fit_lut(parse_sweep(_text(255 - levels, power) if counts_down else _text(levels, power)))
    assert lut.order == order
    assert lut.explains
    # Noise of 0.005 is 0.14 rad at the turning points of sin² for one reading (√(2·noise)·√2); smoothness over the
    # knots' distance of eight levels and more leaves a third.
    found = lut.phase[::-1] if counts_down else lut.phase
    assert np.sqrt(np.mean((found - phase) ** 2)) < 0.1
    low, high = lut.stroke_interval
    assert low - 0.05 < 2.7 * np.pi < high + 0.05
    assert any("count down" in line for line in format_lut(lut)) == counts_down


@pytest.mark.parametrize("pedestal", [0.0, 2.0, 40.0])
def test_a_pedestal_of_any_size_is_stray_light(pedestal: float) -> None:
    levels, power, _ = _table("1", 2.7, seed=12, pedestal=pedestal)
    lut = fit_lut(parse_sweep(_text(levels, power)))
    assert lut.fits[0].stray == pytest.approx(pedestal, abs=5 * NOISE)
    assert lut.stroke / np.pi == pytest.approx(2.7, abs=0.05)


def test_few_levels_on_a_pedestal_above_half_of_the_greatest_power() -> None:
    x = np.linspace(0, 1, 17)
    lut = fit_lut(parse_sweep(_text(x, 0.35 + 0.26 * np.sin(np.pi * x) ** 2)))
    assert lut.stroke / np.pi == pytest.approx(2.0, abs=0.01)


def test_a_sweep_that_was_cut_off_ends_there() -> None:
    levels, power, phase = _table("0", 2.7, seed=13)
    power[180:] = 0.0
    lut = fit_lut(parse_sweep(_text(levels, power)))
    assert lut.levels[-1] == 179
    assert lut.stroke == pytest.approx(phase[179], abs=0.15)
    assert any("levels 180 to 255 all read 0" in line for line in format_lut(lut))
    table = lut_table(lut, "sweep.csv")
    assert len(table["phase_pi"]) == 256
    assert table["phase_pi"][178] is not None
    assert table["phase_pi"][200] is None


@pytest.mark.long
def test_periods_share_a_table_and_each_has_its_own_full_power() -> None:
    """Fringing between bars raises the full power of fine gratings with the phase."""
    levels, _, phase = _table("1", 3.5, seed=0)
    slopes, draws = (0.2, 0.05), np.random.default_rng(14)
    powers = [(1 + c * phase) * np.sin(phase / 2) ** 2 + draws.normal(0, NOISE, 256) for c in slopes]
    lut = fit_lut([parse_sweep(_text(levels, power)) for power in powers])
    assert [fit.slope for fit in lut.fits] == pytest.approx(slopes, abs=0.01)
    assert lut.stroke / np.pi == pytest.approx(3.5, abs=0.02)


@pytest.mark.long
@pytest.mark.parametrize(("path", "is_said"), [(0.95, False), (1.05, True)])
def test_wavelengths_share_a_table_and_one_dispersion(path: float, *, is_said: bool) -> None:
    """At 633 nm the phase is that at 532 nm times 532/633 and the ratio of the optical paths; a liquid crystal's is
    below 1."""
    levels, _, phase = _table("1", 3.0, seed=0)
    draws, factor = np.random.default_rng(15), path * 532 / 633
    powers = [np.sin(f * phase / 2) ** 2 + draws.normal(0, NOISE, 256) for f in (1.0, factor)]
    lut = fit_lut([parse_sweep(_text(levels, power)) for power in powers], "1", [0, 1])
    assert lut.fits[1].factor == pytest.approx(factor, abs=0.01)
    lines = format_lut(lut, [532e-9, 633e-9])
    assert any("check which file" in line for line in lines) == is_said


@pytest.mark.long
def test_readings_that_no_phase_explains_give_no_table() -> None:
    """Damped beats: neither turning point nor contrast repeats."""
    x = np.arange(256.0)
    lut = fit_lut(parse_sweep(_text(x, np.exp(-x / 60) * np.sin(x / 9) + 0.4 * np.sin(x / 31)), "beats"), "1")
    assert not lut.explains
    good = replace(lut.fits[0], sweep=replace(lut.fits[0].sweep, name="good"), residual=0.0)
    with pytest.raises(UserError, match=r"^beats: no monotone phase explains the readings: ") as caught:
        replace(lut, fits=(good, lut.fits[0], good)).check()
    left, most = (float(re.findall(r"[\d.]+", text)[0]) for text in (caught.value.found, caught.value.expected))
    assert left > most  # what is said to be left is more than what is said to be allowed
    replace(lut, fits=(good,)).check()


@pytest.mark.long
def test_nor_does_a_phase_that_turns_back() -> None:
    """By 0.6 rad over a fifth of the levels: a table that never falls leaves the more of it the steeper sin² is."""
    x = np.arange(256.0) / 255
    phase = 2.7 * np.pi * x - 0.9 * np.sin(5 * np.pi * np.clip(x - 0.4, 0.0, 0.2)) ** 2 * np.pi
    lut = fit_lut(parse_sweep(_text(255 * x, np.sin(phase / 2) ** 2)))
    assert not lut.explains


@pytest.mark.long
def test_an_unseen_change_of_the_full_power_is_said_with_its_effect() -> None:
    levels, power, _ = _table("1", 1.6, seed=16)
    lut = fit_lut(parse_sweep(_text(levels, power)))
    # On the falling flank the last reading is a smaller share of a full power that grew by (1 + c·stroke)/(1 + c·π).
    share = np.sin(0.8 * np.pi) ** 2 * (1 + UNSEEN_SLOPE * np.pi) / (1 + UNSEEN_SLOPE * 1.6 * np.pi)
    further = 2 * (np.pi - np.arcsin(np.sqrt(share))) - 1.6 * np.pi  # 0.055 rad
    assert lut.unseen_shift == pytest.approx(further, abs=0.02)  # noise of 0.005 where sin² has a slope of 0.48: 0.01
    levels, power, _ = _table("1", 3.6, seed=16)
    assert fit_lut(parse_sweep(_text(levels, power))).unseen_shift is None


@pytest.mark.long
def test_a_vendors_table_is_read_written_and_compared(tmp_path: Path) -> None:
    levels, power, _ = _table("1", 2.7, seed=17)
    lut = fit_lut(parse_sweep(_text(levels, power)))
    file = tmp_path / "mine.lut"
    file.write_text(vendor_table(lut))
    table = read_vendor_table(file)
    assert (len(table.drives), table.bits) == (256, 12)
    ours = compare_vendor(lut, table)
    assert ours.rms < 2 * np.pi * 2.7 / 4096 + 0.01  # rounding to 12 bits, and the phase between levels
    file.write_text("".join(f"{k} {4095 - 8 * k}\n" for k in range(256)))  # counts down in the drive
    assert compare_vendor(lut, read_vendor_table(file)).rms > 0.2  # a table in proportion to the level is no turn
    low = fit_lut(parse_sweep(_text(*_table("1", 1.6, seed=18)[:2])))
    assert lut_table(low, "")["turn_level"] is None
    assert 0 < lut_table(lut, "")["turn_level"] < 255
    with pytest.raises(UserError, match="holds a whole turn"):
        vendor_table(low)


def test_a_table_whose_bits_its_drives_do_not_tell_is_refused(tmp_path: Path) -> None:
    """A turn of a stroke of 9 π needs 2/9 of the drives: those of 12 bits end near 910, which 10 bits hold too."""
    lut = fit_lut(parse_sweep("".join(f"{k} {np.sin(4.5 * np.pi * k / 255) ** 2:.6f}\n" for k in range(256))))
    file = tmp_path / "mine.lut"
    file.write_text(vendor_table(lut))
    with pytest.raises(UserError, match="--drive-bits 12"):
        compare_vendor(lut, read_vendor_table(file))
    # Rounding to whole levels of 12 bits, and the fitted curve between its knots, as above.
    assert compare_vendor(lut, read_vendor_table(file, 12)).rms < 2 * np.pi * 9 / 4096 + 0.01
    with pytest.raises(UserError, match="at 8 bits"):
        read_vendor_table(file, 8)


BAD_TABLES = {
    "no such file": None,
    "rows; expected a table": "0 1\n1 2\n",
    "levels from 0": "".join(f"{k + 3} {k}\n" for k in range(256)),
    "drives from -5": "".join(f"{k} {k - 5}\n" for k in range(256)),
    "isn't a finite number": "".join(f"{k} nan\n" for k in range(256)),
}


@pytest.mark.parametrize("said", BAD_TABLES)
def test_bad_vendor_tables_are_refused_in_clear_words(said: str, tmp_path: Path) -> None:
    file, content = tmp_path / "vendor.lut", BAD_TABLES[said]
    if content is not None:
        file.write_text(content)
    with pytest.raises(UserError, match=said):
        read_vendor_table(file)


def test_columns_of_other_programs_are_read() -> None:
    levels, power, _ = _table("1", 2.7, seed=19)
    semicolons = "".join(f"{a:.1f};{b:.5f}\n".replace(".", ",") for a, b in zip(levels, power, strict=True))
    assert parse_sweep(semicolons).power == pytest.approx(power, abs=1e-5)
    alone = parse_sweep("".join(f"{value:.5f}\n" for value in power))
    assert alone.levels.tolist() == levels.tolist()
    assert "one column" in alone.notes[0]
    weighted = parse_sweep("".join(f"{a:g} {b:.5f} 0.01\n" for a, b in zip(levels, power, strict=True)))
    assert weighted.deviation is not None


@pytest.mark.parametrize("separator", [" ", "\t", ";", "; "])
def test_decimal_commas_are_decimal_signs_whatever_else_separates_the_columns(separator: str) -> None:
    levels, power, _ = _table("1", 2.7, seed=20)
    rows = [f"{a:g}{separator}{b:.5f}" for a, b in zip(levels, power, strict=True)]
    points, commas = (parse_sweep("\n".join(rows).replace(".", sign)) for sign in (".", ","))
    assert commas.power.tolist() == points.power.tolist()
    assert commas.deviation is None


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("{k},0{k}", "commas may be decimal signs as well as separators"),  # a column of 3,05, or two of 3 and 05
        ("{k};1,234", '"1,234" may be 1.234 or 1234'),
        ("{k} 1,5 0.1", "both commas and spaces stand between digits"),
    ],
)
def test_commas_that_may_mean_either_are_refused(row: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "sweep.csv"
    file.write_text("".join(row.format(k=k) + "\n" for k in range(10, 50)))
    with pytest.raises(UserError, match=said) as caught:
        read_sweep(file)
    assert str(caught.value).startswith(str(file))


@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize("as_rows", [False, True])
def test_an_array_of_numpy_is_read_as_its_text_would_be(columns: int, as_rows: bool, tmp_path: Path) -> None:
    levels, power = np.arange(16.0), np.sin(np.arange(16) / 5) ** 2
    table = np.column_stack([[power], [levels, power], [levels, power, np.full(16, 1e-3)]][columns - 1])
    text, array = tmp_path / "sweep.csv", tmp_path / "sweep.npy"
    np.savetxt(text, table)
    np.save(array, table.T if as_rows else table)
    of_text, of_array = read_sweep(text), read_sweeps(array)[0].sweep
    np.testing.assert_array_equal(of_array.levels, of_text.levels)
    np.testing.assert_array_equal(of_array.power, of_text.power)
    assert (of_array.deviation is None) == (of_text.deviation is None) and of_array.notes == of_text.notes


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.zeros((4, 4, 16)), r"shape \(4, 4, 16\)"),
        (np.zeros((16, 4)), r"shape \(16, 4\)"),
        (np.zeros(16, complex), "complex128"),
        (np.r_[np.arange(15.0), np.nan], "row 15: isn't finite"),
        (np.arange(5.0), "5 rows"),
        (np.array([None] * 16), "pickled"),
    ],
    ids=["cube", "four columns", "complex", "not finite", "few", "objects"],
)
def test_an_array_that_is_no_sweep_is_refused(values: np.ndarray, said: str, tmp_path: Path) -> None:
    file = tmp_path / "sweep.npy"
    np.save(file, values, allow_pickle=True)
    with pytest.raises(UserError, match=said) as caught:
        read_sweeps(file)
    assert str(caught.value).startswith(str(file))


# --- several sweeps in one table --------------------------------------------------------------------------------------


def _rows(
    period: int, order: str, powers: np.ndarray, wavelength_m: float = 532e-9
) -> list[tuple[float, float, str, float, float]]:
    return [(wavelength_m, period, order, level, power) for level, power in enumerate(powers)]


@pytest.mark.long
def test_one_table_holds_sweeps_of_periods_and_orders(tmp_path: Path) -> None:
    """The zero order holds light that isn't modulated, 0.2 of it late by 1 rad, which shifts its start phase."""
    _, _, phase = _table("1", 2.7, seed=0)
    draws = np.random.default_rng(21)
    zero = np.abs(0.2 * np.exp(1j) + (1 + np.exp(1j * phase)) / 2) ** 2 + draws.normal(0, NOISE, 256)
    first = [np.sin(phase / 2) ** 2 + draws.normal(0, NOISE, 256) for _ in range(2)]
    file = tmp_path / "sweeps.csv"
    file.write_text(format_readings([*_rows(16, "1", first[0]), *_rows(16, "0", zero), *_rows(8, "-1", first[1])]))
    sweeps = read_sweeps(file)
    assert [(s.wavelength_m, s.period_px, s.order) for s in sweeps] == [
        (532e-9, p, o) for p, o in ((16, "1"), (16, "0"), (8, "1"))
    ]
    fitted = fit_labelled(sweeps)
    assert len(fitted.lut.fits) == 3 and not fitted.notes and fitted.lut.explains
    assert np.sqrt(np.mean((fitted.lut.phase - phase) ** 2)) < 0.03  # the zero order shows what sin² hides at its turns
    # 0.2·cos(φ/2 − 1) beats with cos(φ/2): (0.5 + 0.2·e^i)·e^iφ, whose angle is 0.27 rad
    assert fitted.lut.fits[1].start == pytest.approx(np.pi + np.angle(0.5 + 0.2 * np.exp(1j)), abs=0.02)


@pytest.mark.long
def test_a_fine_grating_that_shares_no_table_with_a_coarse_one_is_left_out() -> None:
    """A third of its bars is edges, where the phase is three quarters."""
    _, _, phase = _table("1", 2.7, seed=0)
    edges = np.abs((1 - np.exp(1j * phase)) / 3 + (1 - np.exp(0.75j * phase)) / 6) ** 2
    rows = [*_rows(4, "1", edges), *_rows(32, "1", np.sin(phase / 2) ** 2)]
    fitted = fit_labelled(parse_sweeps(format_readings(rows)))
    assert [s.period_px for s in fitted.sweeps] == [32]
    assert "period 4, order 1" in fitted.notes[0] and "bars' edges" in fitted.notes[0]
    assert np.abs(fitted.lut.phase - phase).max() < 0.05


def test_a_sweep_below_a_turning_point_is_left_out_beside_others() -> None:
    _, _, phase = _table("1", 1.3, seed=0)
    rows = [*_rows(8, "1", np.sin(phase / 2) ** 2), *_rows(8, "1", np.sin(0.6 * phase / 2) ** 2, 800e-9)]
    fitted = fit_labelled(parse_sweeps(format_readings(rows)))
    assert len(fitted.sweeps) == 1 and "800 nm, period 8, order 1" in fitted.notes[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("level,period\n" + "1,8\n" * 20, "headings level and power"),
        ("level,power,wavelength\n" + "1,2,0.5\n" * 20, "names nm"),
        ("level,power,order\n" + "1,2,second\n" * 20, '"second"'),
        ("level,power,period\n" + "1,nan,8\n" * 20, "isn't a finite number"),
        ("level,power,period\n" + "1,2,8\n" * 20, "8: sweep: grey level 1 occurs twice"),
        ("level,power,period\n1,2,8\n", "8: sweep: 1 rows"),
    ],
)
def test_bad_tables_of_sweeps_are_refused(text: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        parse_sweeps(text)


@pytest.mark.long
def test_a_drifting_laser_is_told_from_fringing() -> None:
    """The full power falls by 10 % in proportion to the level, not to the phase, which comes early. Of fewer
    than three full powers either explains the heights."""
    levels = np.arange(256.0)
    phase = 6.6 * np.pi * (1 - np.exp(-levels / 85)) / (1 - np.exp(-3))
    power = (1 - 0.1 * levels / 255) * np.cos(phase / 2) ** 2 + np.random.default_rng(22).normal(0, NOISE, 256)
    lut = fit_lut(parse_sweep(_text(levels, power)))
    assert lut.fits[0].slope == 0 and lut.fits[0].drift == pytest.approx(-0.1, abs=0.03)
    assert lut.stroke / np.pi == pytest.approx(6.6, abs=0.02)
    assert any("did the laser drift?" in line for line in format_lut(lut))


@pytest.mark.long
def test_readings_of_a_saturated_detector_are_refused_and_rounded_ones_are_not() -> None:
    levels, power, _ = _table("1", 2.7, seed=23, pedestal=0.0)
    with pytest.raises(UserError, match=r"are all 0\.8, the greatest, with steep ends"):
        parse_sweep(_text(levels, np.minimum(power, 0.8)))
    for steps in (40, 255):
        smooth = np.round(steps * np.sin(2.7 * np.pi * levels / 510) ** 2)
        assert fit_lut(parse_sweep(_text(levels, smooth))).stroke / np.pi == pytest.approx(2.7, abs=0.05)


def test_powers_whose_squares_are_no_numbers_are_refused() -> None:
    levels, power, _ = _table("1", 2.7, seed=24)
    for scale in (1e-200, 1e200):
        with pytest.raises(UserError, match="another unit"):
            parse_sweep("".join(f"{a:g},{b * scale!r}\n" for a, b in zip(levels.tolist(), power.tolist(), strict=True)))


@pytest.mark.long
def test_a_table_is_verified_by_a_sweep_through_it() -> None:
    levels, power, phase = _table("1", 2.7, seed=25)
    lut = fit_lut(parse_sweep(_text(levels, power)))
    asked = np.linspace(0, 2 * np.pi, 64)
    shown = phase[levels_of_phases(lut, asked)]
    readings = np.sin(shown / 2) ** 2 + np.random.default_rng(26).normal(0, NOISE, 64)
    good = verify_turn(fit_lut(parse_sweep(_text(np.arange(64.0), readings))), 2 * np.pi)
    assert good.rms < 0.1  # as of the table itself, above
    bent = asked + 0.5 * np.sin(asked / 2)
    bad = verify_turn(fit_lut(parse_sweep(_text(np.arange(64.0), np.sin(bent / 2) ** 2))), 2 * np.pi)
    assert bad.rms == pytest.approx(0.5 / np.sqrt(2), rel=0.05) and bad.greatest == pytest.approx(0.5, rel=0.1)
    assert "from a straight line" in str(bad)


@pytest.mark.long
def test_the_level_of_a_turn_is_said_for_drives_from_0_to_1_too() -> None:
    levels, power, _ = _table("1", 2.7, seed=19)
    for unit, digits in ((1.0, 0), (255.0, 3)):
        lut = fit_lut(parse_sweep(_text(levels / unit, power)))
        turn = (np.sqrt(1 + 8 * 2 / 2.7) - 1) / 2 * 255 / unit  # 2.7 (x + x²)/2 = 2
        (said,) = [line for line in format_lut(lut) if line.startswith("2 π at level")]
        # a phase off by 0.1 rad (above) is 0.01 of the levels: 2.7 π (1/2 + x) = 11 rad from 0 to 1 there
        assert float(said.rpartition(" ")[2]) == pytest.approx(turn, abs=0.01 * 255 / unit + 0.5 * 10**-digits)
