"""Local fits reach analytic minima and those of scipy, stay inside their bounds, and measure how sharp a minimum is."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.light.numerics.minimise import (
    Minimum,
    ResidualPart,
    ResidualVector,
    SearchDomain,
    Vector,
    jacobian,
    levenberg_marquardt,
    minimise_along_axis,
    nelder_mead,
    normal_equations,
    profile_half_width,
    sum_of_squares,
)


def _bounds(count: int, reach: float = 10.0, step: float = 1e-3) -> SearchDomain:
    return SearchDomain(np.full(count, -reach), np.full(count, reach), np.full(count, step))


def _line(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return rng.standard_normal((200, 3)), rng.standard_normal(200)


def test_a_linear_problem_ends_where_the_normal_equations_do() -> None:
    a, b = _line(np.random.default_rng(0))
    found = levenberg_marquardt(
        lambda x: (a @ x - b).astype(np.float32), np.zeros(3), _bounds(3), iterations=12, tolerance=1e-9
    )
    exact = np.linalg.lstsq(a, b, rcond=None)[0]
    assert found.x == pytest.approx(exact, abs=1e-4)  # forward differences of float32 residuals
    assert found.cost == pytest.approx(float(np.square(a @ exact - b).sum()), rel=1e-6)


def test_derivatives_of_one_part_at_a_time_end_at_the_same_minimum() -> None:
    """Parts of unequal size; where all are taken, sums differ by the rounding of float32."""
    a, b = _line(np.random.default_rng(7))
    asked: list[int] = []

    def rows(where: slice) -> ResidualPart:
        def function(x: Vector) -> ResidualVector:
            asked.append(len(b[where]))
            return np.asarray((a[where] * x).sum(axis=1) - b[where], np.float32)

        return ResidualPart(where, function)

    parts = [rows(slice(0, 70)), rows(slice(70, 140)), rows(slice(140, 210))]
    whole = rows(slice(None))
    start, bounds = np.array([0.3, -0.2, 0.1]), _bounds(3)
    for found, expected in zip(
        normal_equations(parts, start, whole.function(start), bounds),
        normal_equations([whole], start, whole.function(start), bounds),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    asked.clear()
    found_all = levenberg_marquardt(whole.function, start, bounds, iterations=2, tolerance=0.0)
    asked_whole = sum(asked)
    asked.clear()
    found_parts = levenberg_marquardt(whole.function, start, bounds, iterations=2, tolerance=0.0, parts=parts)
    # Differences of float32 over 1e-3 are rounded by 5e-5, by others after the first step: of 200 rows x has 5e-6 (σ).
    assert found_parts.x == pytest.approx(found_all.x, abs=4e-5)
    assert found_parts.evaluations == found_all.evaluations and sum(asked) == asked_whole
    assert {70, 60} < set(asked)


def test_a_bound_holds_one_parameter_and_the_others_are_solved_without_it() -> None:
    a, b = _line(np.random.default_rng(1))
    exact = np.linalg.lstsq(a, b, rcond=None)[0]
    held = exact[0] + 0.5
    bounds = SearchDomain(np.array([held, -10.0, -10.0]), np.full(3, 10.0), np.full(3, 1e-3))
    found = levenberg_marquardt(
        lambda x: (a @ x - b).astype(np.float32), np.array([2.0, 0, 0]), bounds, iterations=20, tolerance=1e-9
    )
    rest = np.linalg.lstsq(a[:, 1:], b - a[:, 0] * held, rcond=None)[0]
    assert found.x == pytest.approx([held, *rest], abs=1e-4)


def test_rosenbrocks_valley_is_followed_to_its_end() -> None:
    """(1 − x)² + 100 (y − x²)², from the usual start; its minimum is 0 at (1, 1)."""
    found = levenberg_marquardt(
        lambda x: np.array([1 - x[0], 10 * (x[1] - x[0] ** 2)], np.float32),
        np.array([-1.2, 1.0]),
        _bounds(2),
        iterations=60,
        tolerance=0.0,
    )
    assert found.x == pytest.approx([1.0, 1.0], abs=2e-3)


def test_slopes_are_taken_away_from_a_bound() -> None:
    """Beyond the bound the function says something else, which must not be looked at."""

    def function(x: Vector) -> ResidualVector:
        return np.array([3 * x[0] if x[0] <= 1 else np.nan], np.float32)

    bounds = SearchDomain(np.zeros(1), np.ones(1), np.full(1, 0.25))
    slopes = jacobian(function, np.ones(1), function(np.ones(1)), bounds)
    assert slopes == pytest.approx(np.array([[3.0]]))


def test_a_minimum_is_found_along_an_axis_where_residuals_jump() -> None:
    """|x − 0.3| in steps of 1/16: constant between, so derivatives vanish. 14 evaluations narrow 2 to 2·0.618¹¹."""

    def function(x: Vector) -> ResidualVector:
        return np.array([np.floor(abs(x[0] - 0.3) * 16) / 16], np.float32)

    found = minimise_along_axis(function, np.zeros(1), _bounds(1), 0, 1.0)
    assert abs(found.x[0] - 0.3) < 1 / 16 + 2 * 0.618**11


@pytest.mark.parametrize("evaluations", [4, 10, 14])
def test_minimisation_along_an_axis_keeps_its_budget_its_bounds_and_the_other_parameters(evaluations: int) -> None:
    points: list[Vector] = []

    def function(x: Vector) -> ResidualVector:
        points.append(x)
        return np.array([np.sqrt(abs(x[1] - 0.7))], np.float32)

    bounds = SearchDomain(np.full(2, -0.4), np.full(2, 0.4), np.full(2, 1e-3))
    found = minimise_along_axis(function, np.array([0.1, 0.0]), bounds, 1, 1.0, evaluations=evaluations)
    assert len(points) == found.evaluations <= evaluations
    assert all(x[0] == 0.1 and -0.4 <= x[1] <= 0.4 for x in points)
    assert found.cost == pytest.approx(min(abs(x[1] - 0.7) for x in points), rel=1e-6)


def test_a_start_that_nothing_near_improves_is_the_minimum_along_its_axis() -> None:
    found = minimise_along_axis(lambda x: x.astype(np.float32), np.zeros(1), _bounds(1), 0, 1.0)
    assert found.x[0] == 0.0 and found.cost == 0.0


@pytest.mark.parametrize("rise", [1.0, 25.0])
def test_the_width_of_a_parabola_is_the_root_of_its_rise(rise: float) -> None:
    """cost = (x/σ)²: it has risen by r at σ·√r. Six bisections leave 1/64 of a step's doubling."""
    sigma = 0.05

    def function(x: Vector) -> ResidualVector:
        return np.array([x[0] / sigma], np.float32)

    at = Minimum(np.zeros(1), 0.0, function(np.zeros(1)), 1)
    bounds = SearchDomain(np.full(1, -5.0), np.full(1, 5.0), np.full(1, 0.2))
    width = profile_half_width(function, at, [np.ones(1)], bounds, rise, shortest=0.05, longest=1.6)
    assert width == pytest.approx(sigma * rise**0.5, rel=1 / 32)


def test_a_width_along_a_valley_ends_at_a_bound_and_is_never_less_than_a_known_one() -> None:
    """cost = (y − 2x)²/σ² + x⁴: along (1, 2) it has risen by 1 at 1. With both sides bounded, y ends at 0.2."""

    def function(x: Vector) -> ResidualVector:
        return np.array([(x[1] - 2 * x[0]) / 0.01, x[0] ** 2], np.float32)

    at = Minimum(np.zeros(2), 0.0, function(np.zeros(2)), 1)
    bounds = SearchDomain(np.array([-5.0, -0.2]), np.full(2, 5.0), np.full(2, 0.2))
    along, reach = [np.array([1.0, 2.0]), np.array([1.0, 0.0])], {"shortest": 0.03, "longest": 8.0}
    assert profile_half_width(function, at, along, bounds, 1.0, **reach) == pytest.approx(1.0, rel=1 / 32)
    assert profile_half_width(function, at, along[:1], bounds, 1.0, **reach) == pytest.approx(1.0, rel=1 / 32)
    upper = SearchDomain(bounds.lower, np.array([5.0, 0.2]), bounds.step)
    assert profile_half_width(function, at, along[:1], upper, 1.0, **reach) == pytest.approx(0.1)
    assert profile_half_width(function, at, along, upper, 1e-8, known=0.03, **reach) == 0.03


ANGLES = np.linspace(0, 2 * np.pi, 400, endpoint=False)
TRUE = np.array([2.0, -1.6, -1.9])
BOUNDS = SearchDomain(np.full(3, -20.0), np.full(3, 20.0), np.full(3, 0.4))
WITHIN = 0.02
"""Of a prior: a tenth of the last simplex's spread and more."""


def _circles(x: Vector) -> np.ndarray:
    """Two circles (radius, y, x): the area between their edges, whichever lies outside, costs."""
    d = x - TRUE
    away = np.abs(d[0] + d[1] * np.sin(ANGLES) + d[2] * np.cos(ANGLES))
    return np.sqrt(away + 0.01).astype(np.float32)


def _start(x: Vector) -> Minimum:
    residual = _circles(x)
    return Minimum(x, sum_of_squares(residual), residual, 1)


def test_the_edge_of_a_circle_is_found() -> None:
    found = nelder_mead(_circles, _start(np.zeros(3)), BOUNDS, np.ones(3, dtype=bool), 0.5, 200)
    assert found.x == pytest.approx(TRUE, abs=WITHIN)
    assert found.cost == sum_of_squares(found.residual) and found.evaluations <= 202


def test_least_squares_stop_before_it() -> None:
    """Why there is a simplex."""
    stuck = levenberg_marquardt(_circles, np.zeros(3), BOUNDS, iterations=20, tolerance=1e-6)
    assert stuck.cost > 1.5 * _start(TRUE).cost


def test_axes_that_are_held_stay_and_bounds_hold() -> None:
    narrow = SearchDomain(np.full(3, -1.0), np.full(3, 1.0), BOUNDS.step)
    found = nelder_mead(_circles, _start(np.zeros(3)), narrow, np.array([True, False, True]), 0.5, 100)
    assert found.x[1] == 0.0 and (np.abs(found.x) <= 1.0).all()


def test_what_nothing_improves_stays() -> None:
    best = _start(TRUE)
    assert nelder_mead(_circles, best, BOUNDS, np.ones(3, dtype=bool), 0.5, 50) is best
