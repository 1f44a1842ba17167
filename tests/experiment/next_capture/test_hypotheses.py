"""Evidence by Laplace's approximation, which is exact for linear models."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from holoview.bench.experiment.hypotheses import (
    PRIOR_WIDTH,
    covariance_root,
    linear_gain,
    log_evidence,
    log_prior,
    probabilities,
)

RNG = np.random.default_rng(4)
J, Y = RNG.standard_normal((3, 25)), RNG.standard_normal(25) * 2
NORMAL = J @ J.T
FIT = np.linalg.solve(NORMAL + np.eye(3) / PRIOR_WIDTH**2, J @ Y)


def test_evidence_is_that_of_a_linear_model() -> None:
    """y = Jᵀx + noise, x ~ N(0, w²): y ~ N(0, I + w² JᵀJ), of which the constant ½ N ln 2π is left out."""
    exact = multivariate_normal(np.zeros(25), np.eye(25) + PRIOR_WIDTH**2 * J.T @ J).logpdf(Y)
    found = log_evidence(float(np.square(Y - J.T @ FIT).sum()), NORMAL, FIT, 1.0)
    assert found - 0.5 * 25 * np.log(2 * np.pi) == pytest.approx(exact, rel=1e-10)


def test_covariance_and_gain_are_those_of_a_linear_model() -> None:
    root = covariance_root(NORMAL, 2.0)
    assert root @ root.T == pytest.approx(np.linalg.inv(NORMAL / 2 + np.eye(3) / PRIOR_WIDTH**2), rel=1e-10)
    left = np.square(Y - J.T @ FIT).sum() + np.square(FIT).sum() / PRIOR_WIDTH**2
    assert linear_gain(NORMAL, J @ Y, 1.0) == pytest.approx(np.square(Y).sum() - left, rel=1e-10)


def test_one_cause_more_has_to_earn_its_odds() -> None:
    assert log_prior(0, 30) == 0.0
    assert 30 * np.exp(log_prior(1, 30)) == pytest.approx(0.1)
    assert probabilities([-1e4, -1e4 + np.log(3)]) == pytest.approx([0.25, 0.75], rel=1e-9)
