"""How well captures tell hypotheses apart, and how long they take."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.experiment.capture_choice import (
    BenchTime,
    Response,
    expected_delta_chi2,
    expected_information,
    pairwise_delta_chi2,
)

NOTHING = np.zeros((0, 1))


def test_a_straight_line_is_told_from_a_parabola_in_the_middle() -> None:
    """The T-optimal design of these two on −1 … 1 is a half at 0 and a quarter at each end (Atkinson & Fedorov 1975).

    With n captures at the ends, half at each, y = x² is fitted best by y = 1, with var(x) = (1 + x²)/n. So the next one
    separates by (x² − 1)²/(1 + var), most at 0.
    """
    taken = 10
    x = np.linspace(-1, 1, 41)
    deltas = []
    for at in x:
        rival = Response(np.array([1.0]), np.array([[1.0], [at]]) / np.sqrt(taken))
        deltas.append(expected_delta_chi2(Response(np.array([at**2]), NOTHING), rival))
    assert deltas == pytest.approx((x**2 - 1) ** 2 / (1 + (1 + x**2) / taken), rel=1e-12)
    assert x[int(np.argmax(deltas))] == 0.0


def test_it_is_what_a_refit_of_the_rival_leaves() -> None:
    rng = np.random.default_rng(1)
    truth = Response(rng.standard_normal(30), np.zeros((0, 30)))
    rival = Response(rng.standard_normal(30), rng.standard_normal((4, 30)))
    # minimise |d − Bᵀz|² + |z|², with z in standard deviations of what the captures so far say
    rows = np.vstack([rival.spreads.T, np.eye(4)])
    right = np.concatenate([truth.picture - rival.picture, np.zeros(4)])
    left = right - rows @ np.linalg.lstsq(rows, right, rcond=None)[0]
    assert expected_delta_chi2(truth, rival) == pytest.approx(left @ left, rel=1e-10)


def test_what_is_unknown_of_the_truth_adds_its_mean_square() -> None:
    rng = np.random.default_rng(2)
    truth = Response(rng.standard_normal(20), rng.standard_normal((2, 20)))
    rival = Response(np.zeros(20), rng.standard_normal((3, 20)))
    m = np.linalg.inv(np.eye(20) + rival.spreads.T @ rival.spreads)
    expected = truth.picture @ m @ truth.picture + np.trace(truth.spreads @ m @ truth.spreads.T)
    assert expected_delta_chi2(truth, rival) == pytest.approx(expected, rel=1e-10)


def test_a_gain_separates_nothing() -> None:
    picture = np.linspace(1, 2, 12)
    responses = [Response(f * picture, f * picture[None]).without(picture) for f in (1.0, 1.7)]
    assert pairwise_delta_chi2(responses) == pytest.approx(np.zeros((2, 2)), abs=1e-24)


def test_both_rivals_may_be_fitted_again() -> None:
    """What one hypothesis can imitate isn't separated, whichever of the two is true."""
    first = Response(np.array([1.0, 0.0]), np.array([[1e6, 0.0]]))
    second = Response(np.zeros(2), np.zeros((0, 2)))
    deltas = pairwise_delta_chi2([first, second])
    assert np.array_equal(deltas, deltas.T) and deltas[0, 1] < 1e-6


def test_information_is_never_negative_nor_more_than_there_is_to_know() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        count = int(rng.integers(1, 7))
        p = rng.dirichlet(np.full(count, 0.3))
        deltas = rng.exponential(10.0 ** rng.uniform(-6, 4), (count, count))
        deltas = np.minimum(deltas, deltas.T) * (1 - np.eye(count))
        # each of the sums rounds by a few 2⁻⁵²
        entropy = -float(p[p > 0] @ np.log(p[p > 0]))
        assert 0.0 <= expected_information(p, deltas) <= max(entropy, 0.0) + 1e-14


def test_information_of_two_hypotheses() -> None:
    p, delta = np.array([0.5, 0.5]), 7.0
    deltas = np.array([[0.0, delta], [delta, 0.0]])
    assert expected_information(p, deltas) == pytest.approx(np.log(2) - np.log1p(np.exp(-delta / 8)), rel=1e-12)
    assert expected_information(p, 0 * deltas) == 0.0
    assert expected_information(p, 1e6 * deltas) == pytest.approx(np.log(2), rel=1e-12)


def test_it_learns_the_stage_and_the_readout() -> None:
    time = BenchTime(settle_s=0.1)
    for exposure_s in (0.01, 0.02, 0.05):
        time.note(0.0, exposure_s, 0.1 + exposure_s + 0.03)
    time.note(4e-3, 0.01, 2.0 + 0.1 + 0.01 + 0.03)
    assert time.readout_s == pytest.approx(0.03, rel=1e-9)
    assert time.speed == pytest.approx(2e-3, rel=1e-9)
    assert time.expect(-1e-3, 0.2) == pytest.approx(0.5 + 0.1 + 0.2 + 0.03, rel=1e-9)


def test_one_exposure_that_had_to_be_searched_misleads_nobody() -> None:
    time = BenchTime(settle_s=0.1)
    for seconds in (0.15, 0.15, 0.9):
        time.note(0.0, 0.02, seconds)
    assert time.expect(0.0, 0.02) == pytest.approx(0.15, rel=1e-9)
