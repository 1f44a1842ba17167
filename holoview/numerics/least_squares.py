"""Levenberg–Marquardt with forward differences, inside bounds; and golden section for what has no slope.

Marquardt, J. SIAM 11, 431 (1963); More's scaling by the diagonal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
ResidualVector = NDArray[np.float32]
ResidualFunction = Callable[[Vector], ResidualVector]

_GOLDEN = (5**0.5 - 1) / 2
_FIRST_DAMPING, _MOST_TRIES = 1e-3, 5
_BISECTIONS = 6


@dataclass(frozen=True)
class SearchDomain:
    """Where to look: lower ≤ x ≤ upper; `step` of the forward differences, of |x| too beyond 1 where `grows`."""

    lower: Vector
    upper: Vector
    step: Vector
    relative_step: NDArray[np.bool_] | None = None

    def step_at(self, x: Vector, axis: int) -> float:
        """The step of one axis, away from the nearer bound."""
        step = float(self.step[axis])
        if self.relative_step is not None and self.relative_step[axis]:
            step *= max(1.0, abs(float(x[axis])))
        return step if x[axis] + step <= self.upper[axis] else -step

    def with_longer_steps(self, factor: float) -> SearchDomain:
        """The same with steps longer by a factor."""
        return replace(self, step=factor * self.step)

    def clip(self, x: Vector) -> Vector:
        """The nearest point inside."""
        return np.clip(x, self.lower, self.upper)


@dataclass(frozen=True)
class Minimum:
    """Where a search ended: x, cost = Σ residual², residuals there, how many were computed."""

    x: Vector
    cost: float
    residual: ResidualVector
    evaluations: int


def jacobian(
    function: ResidualFunction, x: Vector, residual: ResidualVector, bounds: SearchDomain
) -> NDArray[np.float32]:
    """Slopes (parameter, residual) by one-sided differences, away from the nearer bound."""
    columns = np.empty((len(x), residual.size), dtype=np.float32)
    for i in range(len(x)):
        signed = bounds.step_at(x, i)
        moved = x.copy()
        moved[i] += signed
        columns[i] = (function(moved) - residual).ravel() / np.float32(signed)
    return columns


def levenberg_marquardt(
    function: ResidualFunction, start: Vector, bounds: SearchDomain, *, iterations: int = 6, tolerance: float = 2e-3
) -> Minimum:
    """Least squares from `start`; ends when an iteration gains less than `tolerance` of the cost."""
    x = bounds.clip(np.asarray(start, dtype=np.float64))
    residual = function(x)
    cost, evaluations, damping = sum_of_squares(residual), 1, _FIRST_DAMPING
    for _ in range(iterations):
        slopes = jacobian(function, x, residual, bounds)
        evaluations += len(x)
        normal = (slopes @ slopes.T).astype(np.float64)
        gradient = (slopes @ residual.ravel()).astype(np.float64)
        for _ in range(_MOST_TRIES):
            trial = bounds.clip(x + _step(normal, gradient, damping, x, bounds))
            if not np.any(trial != x):
                return Minimum(x, cost, residual, evaluations)
            moved = function(trial)
            evaluations += 1
            if (lower := sum_of_squares(moved)) < cost:
                break
            damping *= 10.0
        else:
            break
        gained = (cost - lower) / max(cost, 1e-300)
        x, residual, cost, damping = trial, moved, lower, damping * 0.2
        if gained < tolerance:
            break
    return Minimum(x, cost, residual, evaluations)


def golden_section(
    function: ResidualFunction,
    start: Vector,
    bounds: SearchDomain,
    axis: int,
    half_width: float,
    *,
    evaluations: int = 14,
) -> Minimum:
    """The least cost along one axis within `width` of the start, for parameters whose residuals jump."""
    low, high = max(bounds.lower[axis], start[axis] - half_width), min(bounds.upper[axis], start[axis] + half_width)
    at = _axis_evaluator(function, start, axis)
    best = at(float(start[axis]))
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = at(left), at(right)
    for _ in range(evaluations - 3):
        best = min(best, at_left, at_right, key=lambda m: m.cost)
        if at_left.cost < at_right.cost:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = at(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = at(right)
    best = min(best, at_left, at_right, key=lambda m: m.cost)
    return Minimum(best.x, best.cost, best.residual, evaluations)


def axis_scan(function: ResidualFunction, start: Vector, bounds: SearchDomain, axis: int, offsets: Vector) -> Minimum:
    """The least cost at points at these distances from the start along one axis, inside the bounds."""
    at = _axis_evaluator(function, start, axis)
    values = np.clip(start[axis] + offsets, bounds.lower[axis], bounds.upper[axis])
    return min((at(float(value)) for value in values), key=lambda m: m.cost)


def profile_half_width(
    function: ResidualFunction, at: Minimum, axis: int, bounds: SearchDomain, delta_cost: float
) -> float:
    """How far an axis may move either way before the cost has risen by `rise`: half a confidence interval."""
    widest = 0.0
    for sign in (-1.0, 1.0):
        low, high = 0.0, 0.25 * bounds.step[axis]

        def risen(distance: float, sign: float = sign) -> bool:
            x = at.x.copy()
            x[axis] += sign * distance
            return not sum_of_squares(function(bounds.clip(x))) < at.cost + delta_cost

        while not risen(high) and high < 8 * bounds.step[axis]:
            low, high = high, 2 * high
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if risen(middle) else (middle, high)
        widest = max(widest, high)
    return widest


def _step(normal: NDArray[np.float64], gradient: Vector, damping: float, x: Vector, bounds: SearchDomain) -> Vector:
    """The damped step; parameters that are held back by a bound stay, the others are solved for without them."""
    free = ~(((x <= bounds.lower) & (gradient > 0)) | ((x >= bounds.upper) & (gradient < 0)))
    scale = np.diag(normal)
    free &= scale > 0
    step = np.zeros_like(x)
    if free.any():
        kept = np.ix_(free, free)
        damped = normal[kept] + damping * np.diag(scale[free]) + 1e-12 * scale[free].max() * np.eye(free.sum())
        step[free] = -np.linalg.solve(damped, gradient[free])
    return step


def _axis_evaluator(function: ResidualFunction, start: Vector, axis: int) -> Callable[[float], Minimum]:
    """What a value of one axis gives, the others as at the start."""

    def at(value: float) -> Minimum:
        x = np.array(start, dtype=np.float64)
        x[axis] = value
        residual = function(x)
        return Minimum(x, sum_of_squares(residual), residual, 1)

    return at


def sum_of_squares(residual: ResidualVector) -> float:
    """Σ residual²."""
    flat = residual.ravel()
    return (
        float(np.einsum("i,i->", flat, flat, dtype=np.float64))
        if flat.size < 65536
        else float(_blocked_sum_of_squares(flat))
    )


def _blocked_sum_of_squares(flat: ResidualVector) -> float:
    """Σ x² in float64 over float32 partial sums: BLAS is fast, and its rounding would hide small gains in long sums."""
    whole = flat.size // 4096 * 4096
    blocks = flat[:whole].reshape(-1, 4096)
    return float(np.einsum("ij,ij->i", blocks, blocks).sum(dtype=np.float64) + np.square(flat[whole:]).sum())
