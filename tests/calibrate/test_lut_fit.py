"""Look-up tables from diffraction-efficiency sweeps: analytic ones, a real one, and files that aren't any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.calibrate.lut_fit import EfficiencySweep, fit_lut, read_sweep
from holoview.util.errors import UserError

REAL = Path(__file__).resolve().parents[1] / "data" / "lcos_820nm_first_order_power.csv"
LEVELS = np.arange(128.0)


def _sweep(stroke_pi: float, gamma: float, seed: int, noise: float = 0.01, contrast: float = 0.0) -> EfficiencySweep:
    """P = b + a·(1 + c·x)·sin²(φ/2) with φ = stroke·x^γ and white noise of that share of a."""
    x = LEVELS / LEVELS[-1]
    power = 20 + 2000 * (1 + contrast * x) * np.sin(stroke_pi * np.pi * x**gamma / 2) ** 2
    return EfficiencySweep(LEVELS, power + np.random.default_rng(seed).normal(0, 2000 * noise, len(x)))


STROKES = pytest.mark.parametrize(("stroke_pi", "gamma"), [(1.5, 0.8), (2.6, 1.4), (3.4, 1.0)])


@STROKES
def test_a_known_stroke_is_inside_its_interval(stroke_pi: float, gamma: float) -> None:
    lut = fit_lut(_sweep(stroke_pi, gamma, seed=3))
    low, high = (bound / np.pi for bound in lut.stroke_interval)
    # four half intervals: beyond 7.8 sigma chance is nil; a wrong branch is off by π
    assert lut.fit.stroke / np.pi == pytest.approx(stroke_pi, abs=4 * (high - low) / 2)
    assert lut.fit.relative_rms < 0.015  # the noise is 0.01 of full power; of 128 readings it scatters by 6 %


@STROKES
def test_with_little_noise_the_table_follows_the_truth(stroke_pi: float, gamma: float) -> None:
    lut = fit_lut(_sweep(stroke_pi, gamma, seed=3, noise=1e-4))
    low, high = (bound / np.pi for bound in lut.stroke_interval)
    truth = (LEVELS / LEVELS[-1]) ** gamma
    # Where the phase is an extremum of the power it has no slope: noise^½ = 0.01 rad of 5. Curves through 16 knots
    # leave 0.007 near the steep beginning of x^0.8; the interval includes those through 12 and 24.
    assert np.abs(lut.stroke_fractions - truth).max() < 0.02
    assert high - low < 0.1


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    inside = 0
    for seed in range(8):
        low, high = fit_lut(_sweep(2.3, 1.2, seed, noise=0.02)).stroke_interval
        inside += low <= 2.3 * np.pi <= high
    assert inside >= 3  # 95 % each: fewer than three of eight has a chance of 4e-7


def test_contrast_that_changes_is_found_only_where_it_does() -> None:
    """Schwarz's criterion takes a slope by chance in 3 % of sweeps (χ² with one degree of freedom above ln 128); of 60
    sweeps without one it is 0.0083 (r.m.s.), of which this allows six."""
    assert abs(fit_lut(_sweep(3.4, 1.1, seed=5)).fit.contrast_slope) < 0.05
    changing = fit_lut(_sweep(3.4, 1.1, seed=5, contrast=0.5))
    assert changing.fit.contrast_slope == pytest.approx(0.5, abs=0.1)
    assert changing.fit.stroke / np.pi == pytest.approx(3.4, abs=0.05)


def test_levels_rise_strictly_as_a_modulator_states_them() -> None:
    fractions = fit_lut(_sweep(2.6, 1.4, seed=1)).stroke_fractions
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    assert (np.diff(fractions) > 0).all()


def test_a_real_modulator_at_820_nm() -> None:
    lut = fit_lut(read_sweep(REAL))
    assert lut.rms_linear_2pi == pytest.approx(0.33, abs=0.01)
    assert lut.rms_linear_free == pytest.approx(0.22, abs=0.01)
    assert lut.fit.relative_rms < 0.03  # what a monotone table was known to leave
    # read off the curve: maxima at levels 168 and 238, a null at 208, and 0.43 of full power after the second maximum
    assert 3.4 < lut.fit.stroke / np.pi < 3.7
    null = 160 + int(lut.sweep.power[160:230].argmin())
    assert np.interp(null, lut.sweep.levels, lut.fit.phase) == pytest.approx(2 * np.pi, abs=0.15)


BAD = {
    "no such file": None,
    "two columns": "0,1,2\n" * 20,
    "isn't a finite number": "".join(f"{k},{'nan' if k == 7 else k}\n" for k in range(20)),
    "line 3": "0,1\n1,2\n2,many\n",
    "rows": "0,1\n1,2\n",
    "occurs twice": "".join(f"{k // 2},{k}\n" for k in range(40)),
    "rises from almost none": "".join(f"{k},100\n" for k in range(40)),
    "without a maximum": "".join(f"{k},{1000 * np.sin(k / 40) ** 2}\n" for k in range(40)),
    "can't be read": b"\xff\xfe\x00\x01",
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
