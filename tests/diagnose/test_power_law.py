"""The gains tell a law of the laser's power from jitter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from holoview.bench.diagnose.power_law import centre_per_wavelength, changes_only_power, fit_power_law, gain_spread
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import pictures

LAW = listed_effects()["laser_power"]
COUNT = 32
POWER = np.random.default_rng(0).choice([0.3, 0.5, 0.7, 1.0], COUNT)
SCALE = np.resize([2.0, 0.7], COUNT)  # of the wavelengths
JITTER = 0.004


def _gain(exponent: float, seed: int) -> np.ndarray:
    """The law's own power beyond the one that was set, with jitter of the exposures."""
    return SCALE * POWER**exponent * np.exp(JITTER * np.random.default_rng(seed).standard_normal(COUNT))


def _as_by_chance(found: float, truth: float, degrees_of_freedom: int) -> bool:
    """Whether a standard deviation estimated with so many degrees of freedom lies where all but two in 10⁷ do."""
    low, high = chi2.ppf((1e-7, 1 - 1e-7), degrees_of_freedom) / degrees_of_freedom
    return bool(low < (found / truth) ** 2 < high)


@pytest.mark.parametrize("exponent", [0.15, -0.1])
def test_a_power_law_is_read_off_the_gains(exponent: float) -> None:
    """Its σ follows from the regression of log gain on centred log power."""
    captures = pictures(COUNT, power=POWER)
    found = fit_power_law(LAW, captures, _gain(exponent, 1))
    assert found is not None
    interval = found.intervals["laser_power", "exponent"]
    expected = JITTER / np.linalg.norm(centre_per_wavelength(captures, np.log(POWER)))
    assert _as_by_chance(interval.sigma, expected, COUNT - 3)  # less two wavelengths' means and the exponent
    assert abs(interval.value - exponent) < 5 * expected
    assert _as_by_chance(found.spread_after, JITTER * np.sqrt((COUNT - 3) / COUNT), COUNT - 3)
    assert found.spread_before > 5 * found.spread_after


@pytest.mark.long
@pytest.mark.parametrize("count", [6, COUNT])
def test_intervals_hold_the_truth_as_often_as_they_say(count: int) -> None:
    """Of 400 draws of a 95 % interval 380 ± 4.4; five of these are exceeded once in 3 million. Six captures leave 3
    degrees of freedom: with 1.96 in place of Student's 3.18 it would be 342."""
    captures = pictures(count, power=np.resize([0.3, 0.5, 0.7, 1.0, 0.4, 0.8], count))
    inside = 0
    for seed in range(400):
        jitter = np.exp(JITTER * np.random.default_rng((seed, count)).standard_normal(count))
        law = fit_power_law(LAW, captures, SCALE[:count] * captures.power**0.3 * jitter)
        assert law is not None
        interval = law.intervals["laser_power", "exponent"]
        inside += abs(interval.value - 0.3) <= interval.half_width
    assert abs(inside - 380) <= 5 * 4.4


@pytest.mark.parametrize("seed", range(3))
def test_jitter_alone_is_no_law(seed: int) -> None:
    captures = pictures(COUNT, power=POWER)
    assert fit_power_law(LAW, captures, _gain(0.0, seed)) is None
    assert _as_by_chance(gain_spread(captures, _gain(0.0, seed)), JITTER * np.sqrt((COUNT - 2) / COUNT), COUNT - 2)


def test_only_the_law_of_power_leaves_pictures_as_they_are() -> None:
    assert [name for name, one in listed_effects().items() if changes_only_power(one)] == ["laser_power"]
