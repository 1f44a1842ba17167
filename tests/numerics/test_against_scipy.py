"""Levenberg–Marquardt and Nelder–Mead end where those of scipy do, within what float32 residuals allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from holoview.light.numerics.minimise import Minimum, SearchDomain, levenberg_marquardt, nelder_mead, sum_of_squares

Vector = NDArray[np.float64]
TIMES = np.linspace(0.0, 4.0, 60)
RELATIVE_COST = 1e-4
"""By which the cost may exceed scipy's: forward differences of float32 residuals have about four digits."""
ABSOLUTE_COST = 1e-9
"""The same where the minimum is zero; residuals begin at one or more."""


@dataclass(frozen=True)
class Problem:
    """Residuals in float64, where to begin, bounds, and how far a parameter may be from scipy's; None: not unique."""

    residuals: Callable[[Vector], Vector]
    start: Vector
    lower: Vector
    upper: Vector
    within: float | None = 2e-3

    @property
    def domain(self) -> SearchDomain:
        return SearchDomain(self.lower, self.upper, 1e-3 * np.maximum(1.0, np.abs(self.start)))

    def single(self, x: Vector) -> NDArray[np.float32]:
        return self.residuals(x).astype(np.float32)


def _rosenbrock(x: Vector) -> Vector:
    """Moré, Garbow & Hillstrom, ACM Trans. Math. Softw. 7, 17 (1981), problem 1."""
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def _extended_rosenbrock(x: Vector) -> Vector:
    """The same, problem 21, with six parameters."""
    return np.concatenate([10 * (x[1::2] - x[::2] ** 2), 1 - x[::2]])


def _powell(x: Vector) -> Vector:
    """The same, problem 13: the Jacobian is singular at the minimum, zero."""
    return np.array([x[0] + 10 * x[1], 5**0.5 * (x[2] - x[3]), (x[1] - 2 * x[2]) ** 2, 10**0.5 * (x[0] - x[3]) ** 2])


def _decay(x: Vector) -> Vector:
    """Two exponentials fitted to a noisy curve, whose minimum isn't zero."""
    noise = 0.02 * np.random.default_rng(5).standard_normal(len(TIMES))
    return (
        x[0] * np.exp(-x[1] * TIMES) + x[2] * np.exp(-x[3] * TIMES) - (2 * np.exp(-TIMES) + np.exp(-4 * TIMES)) + noise
    )


def _badly_scaled(x: Vector) -> Vector:
    """A straight line whose parameters differ by a factor of 10⁶ in their effect."""
    return np.concatenate([1e3 * (x[0] - 0.5) * np.ones(3), 1e-3 * (x[1] - 2.0) * np.arange(4)])


def _rank_deficient(x: Vector) -> Vector:
    """Only x₀ + x₁ matters, and x₂ doesn't matter at all."""
    return (x[0] + x[1] - 1.5) * np.linspace(1, 2, 5) + 0.3 * np.cos(np.arange(5))


def _problem(
    residuals: Callable[[Vector], Vector], start: list[float], reach: float = 10.0, **more: float | None
) -> Problem:
    return Problem(residuals, np.array(start), np.full(len(start), -reach), np.full(len(start), reach), **more)


PROBLEMS = {
    "rosenbrock": _problem(_rosenbrock, [-1.2, 1.0]),
    "extended rosenbrock": _problem(_extended_rosenbrock, [-1.2, 1.0] * 3),
    "rosenbrock with an active bound": Problem(
        _rosenbrock, np.array([-1.2, 1.0]), np.array([-1.5, -0.5]), np.array([0.6, 2.0])
    ),
    "rosenbrock in a corner of the bounds": Problem(
        _rosenbrock, np.array([0.5, 2.0]), np.array([-1.5, 1.5]), np.array([0.8, 3.0])
    ),
    "powell, singular": _problem(_powell, [3.0, -1.0, 0.0, 1.0], within=None),
    "exponentials with noise": _problem(_decay, [1.0, 0.5, 1.5, 3.0], within=2e-2),
    "badly scaled": _problem(_badly_scaled, [3.0, -5.0], within=5e-3),
    "rank-deficient": _problem(_rank_deficient, [4.0, -1.0, 0.3], within=None),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_levenberg_marquardt_ends_where_scipy_does(name: str) -> None:
    problem = PROBLEMS[name]
    theirs = least_squares(
        problem.residuals, problem.start, bounds=(problem.lower, problem.upper), xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    ours = levenberg_marquardt(problem.single, problem.start, problem.domain, iterations=100, tolerance=0.0)
    assert np.all((problem.lower <= ours.x) & (ours.x <= problem.upper))
    assert float(np.square(problem.residuals(ours.x)).sum()) <= 2 * theirs.cost * (1 + RELATIVE_COST) + ABSOLUTE_COST
    if problem.within is not None:
        assert ours.x == pytest.approx(theirs.x, abs=problem.within)


def test_a_parameter_without_effect_stays_where_it_was() -> None:
    problem = PROBLEMS["rank-deficient"]
    ours = levenberg_marquardt(problem.single, problem.start, problem.domain, iterations=100, tolerance=0.0)
    assert ours.x[2] == problem.start[2]


@pytest.mark.parametrize("name", ["rosenbrock", "extended rosenbrock", "exponentials with noise"])
def test_few_evaluations_are_enough(name: str) -> None:
    """No more than twice those of scipy's trust region, counting each column of a Jacobian."""
    problem = PROBLEMS[name]
    theirs = least_squares(problem.residuals, problem.start, bounds=(problem.lower, problem.upper))
    ours = levenberg_marquardt(problem.single, problem.start, problem.domain, iterations=100, tolerance=1e-8)
    assert ours.evaluations <= 2 * (theirs.nfev + len(problem.start) * theirs.njev)


@pytest.mark.parametrize("start", [[0.0, 0.0], [-1.2, 1.0], [2.0, -1.0]])
def test_nelder_mead_ends_where_scipy_does(start: list[float]) -> None:
    """A cost with creases, |x − 1| + 2·|y + 0.5| + 0.1; inside the bounds both are the same algorithm."""

    def residuals(x: Vector) -> NDArray[np.float32]:
        return np.sqrt(np.array([abs(x[0] - 1), 2 * abs(x[1] + 0.5), 0.1])).astype(np.float32)

    x = np.array(start)
    first = Minimum(x, sum_of_squares(residuals(x)), residuals(x), 1)
    domain = SearchDomain(np.full(2, -10.0), np.full(2, 10.0), np.full(2, 1e-3))
    ours = nelder_mead(residuals, first, domain, np.ones(2, dtype=bool), 0.5, 400)
    theirs = minimize(
        lambda v: float(np.abs([v[0] - 1, 2 * (v[1] + 0.5)]).sum() + 0.1),
        x,
        method="Nelder-Mead",
        options={"xatol": 1e-6},
    )
    assert theirs.x == pytest.approx([1.0, -0.5], abs=1e-4)
    assert ours.x == pytest.approx(theirs.x, abs=0.01)  # three times the size of the last simplex


def test_nelder_mead_keeps_its_budget() -> None:
    calls: list[Vector] = []

    def residuals(x: Vector) -> NDArray[np.float32]:
        calls.append(x)
        return _extended_rosenbrock(x).astype(np.float32)

    x = np.array([-1.2, 1.0] * 3)
    first = Minimum(x, sum_of_squares(residuals(x)), residuals(x), 1)
    domain = SearchDomain(np.full(6, -10.0), np.full(6, 10.0), np.full(6, 1e-3))
    calls.clear()
    found = nelder_mead(residuals, first, domain, np.ones(6, dtype=bool), 0.5, 60)
    assert found.cost < first.cost and len(calls) <= 61
