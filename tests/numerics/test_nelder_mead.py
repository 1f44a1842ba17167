"""A cost with a crease, where least squares stop: the simplex finds its end."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.numerics.minimise import Minimum, SearchDomain, Vector, levenberg_marquardt, nelder_mead, sum_of_squares

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
