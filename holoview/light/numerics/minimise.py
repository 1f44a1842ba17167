"""Least squares inside bounds (Levenberg–Marquardt), minimisation along one axis, and profile likelihood intervals.

Written for residuals of millions of float32 values that take long to compute: derivatives are forward differences,
normal equations are formed in float32, of some residuals at a time where memory is short, and solved in float64, and
every function has a budget of evaluations.
`scipy.optimize.least_squares` holds the whole Jacobian in float64 and has no such budget.

Levenberg, Q. Appl. Math. 2, 164 (1944); Marquardt, J. SIAM 11, 431 (1963), with damping in proportion to the diagonal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

Vector = NDArray[np.float64]
ResidualVector = NDArray[np.float32]
ResidualFunction = Callable[[Vector], ResidualVector]

_FIRST_DAMPING = 1e-3
_MAX_TRIES = 5  # trial steps in an iteration, each with ten times the damping of the one before
_BISECTIONS = 6
_AXIS_TOLERANCE = 1e-6  # share of the interval; far below what a budget of some ten evaluations can reach


@dataclass(frozen=True)
class SearchDomain:
    """Bounds of the parameters and the steps of their forward differences, each of shape (parameter,).

    lower, upper: inclusive bounds.
    step: of the forward difference; negative: of a backward difference.
    relative_step: for which parameters the step grows with |x| beyond |x| = 1; none when None.
    """

    lower: Vector
    upper: Vector
    step: Vector
    relative_step: NDArray[np.bool_] | None = None

    def step_at(self, x: Vector, axis: int) -> float:
        """The signed step along one axis; the other way where it would leave the bounds."""
        step = float(self.step[axis])
        if self.relative_step is not None and self.relative_step[axis]:
            step *= max(1.0, abs(float(x[axis])))
        return step if self.lower[axis] <= x[axis] + step <= self.upper[axis] else -step

    def with_steps(self, factor: float) -> SearchDomain:
        """The same bounds with steps so many times as long; backward where the factor is negative."""
        return replace(self, step=factor * self.step)

    def clip(self, x: Vector) -> Vector:
        """The nearest point inside the bounds."""
        return np.clip(x, self.lower, self.upper)


@dataclass(frozen=True)
class Minimum:
    """The result of a search: the parameters x, cost = Σ residual² and the residuals there, and the evaluations."""

    x: Vector
    cost: float
    residual: ResidualVector
    evaluations: int


def jacobian(
    function: ResidualFunction, x: Vector, residual: ResidualVector, bounds: SearchDomain
) -> NDArray[np.float32]:
    """Derivatives (parameter, residual) of the residuals at x by one-sided differences inside the bounds.

    residual: the function's value at x.
    """
    columns = np.empty((len(x), residual.size), dtype=np.float32)
    for i in range(len(x)):
        step = bounds.step_at(x, i)
        stepped = x.copy()
        stepped[i] += step
        columns[i] = (function(stepped) - residual).ravel() / np.float32(step)
    return columns


@dataclass(frozen=True)
class ResidualPart:
    """Some of a function's residuals, which can be computed alone. where: their place among all of them, flat."""

    where: slice
    function: ResidualFunction


def normal_equations(
    parts: Sequence[ResidualPart], x: Vector, residual: ResidualVector, bounds: SearchDomain
) -> tuple[NDArray[np.float64], Vector]:
    """JᵀJ (parameter, parameter) and Jᵀr (parameter,) at x, summed over parts that hold each residual once.

    residual: all of them at x. Memory is taken for the derivatives of one part at a time.
    """
    normal, gradient = np.zeros((len(x), len(x))), np.zeros(len(x))
    for part in parts:
        own = residual.ravel()[part.where]
        derivatives = jacobian(part.function, x, own, bounds)
        normal += derivatives @ derivatives.T
        gradient += derivatives @ own
    return normal, gradient


def levenberg_marquardt(
    function: ResidualFunction,
    start: Vector,
    bounds: SearchDomain,
    *,
    iterations: int = 6,
    tolerance: float = 2e-3,
    parts: Sequence[ResidualPart] = (),
) -> Minimum:
    """A local minimum of Σ residual² inside the bounds.

    function: parameters (parameter,) to residuals, float32 of any shape.
    start: where to begin; clipped to the bounds.
    iterations: at most so many, each with a Jacobian and up to five trial steps.
    tolerance: ends after an iteration that lowers the cost by a smaller share of it.
    parts: of the function, as in `normal_equations`; none: the function as a whole.

    A parameter at a bound that the gradient pushes outwards is held, and the step of the others is computed without it.
    """
    x = bounds.clip(np.asarray(start, dtype=np.float64))
    residual = function(x)
    cost, evaluations, damping = sum_of_squares(residual), 1, _FIRST_DAMPING
    for _ in range(iterations):
        normal, gradient = normal_equations(parts or [ResidualPart(slice(None), function)], x, residual, bounds)
        evaluations += len(x)
        for _ in range(_MAX_TRIES):
            trial = bounds.clip(x + _step(normal, gradient, damping, x, bounds))
            if not np.any(trial != x):
                return Minimum(x, cost, residual, evaluations)
            trial_residual = function(trial)
            evaluations += 1
            if (lower := sum_of_squares(trial_residual)) < cost:
                break
            damping *= 10.0
        else:
            break
        gain = (cost - lower) / max(cost, 1e-300)
        x, residual, cost, damping = trial, trial_residual, lower, damping * 0.2
        if gain < tolerance:
            break
    return Minimum(x, cost, residual, evaluations)


def minimise_along_axis(
    function: ResidualFunction,
    start: Vector,
    bounds: SearchDomain,
    axis: int,
    half_width: float,
    *,
    evaluations: int = 14,
) -> Minimum:
    """The least cost along one axis within `half_width` of the start, for residuals that jump as the parameter varies.

    Brent's method without derivatives (`scipy.optimize.minimize_scalar`, bounded), the start included. Computes at most
    `evaluations` residuals. Finds a local minimum where there are several.
    """
    evaluate = _axis_evaluator(function, start, axis)
    best = evaluate(float(start[axis]))
    count = 1

    def cost(value: float) -> float:
        nonlocal best, count
        tried = evaluate(float(value))
        best, count = min(best, tried, key=lambda m: m.cost), count + 1
        return tried.cost

    low, high = max(bounds.lower[axis], start[axis] - half_width), min(bounds.upper[axis], start[axis] + half_width)
    options = {"maxiter": evaluations - 1, "xatol": _AXIS_TOLERANCE * (high - low)}
    minimize_scalar(cost, bounds=(low, high), method="bounded", options=options)
    return replace(best, evaluations=count)


def axis_scan(function: ResidualFunction, start: Vector, bounds: SearchDomain, axis: int, offsets: Vector) -> Minimum:
    """The least cost at the given offsets from the start along one axis, clipped to the bounds."""
    evaluate = _axis_evaluator(function, start, axis)
    values = np.clip(start[axis] + offsets, bounds.lower[axis], bounds.upper[axis])
    return min((evaluate(float(value)) for value in values), key=lambda m: m.cost)


def profile_half_width(
    function: ResidualFunction,
    minimum: Minimum,
    directions: Sequence[Vector],
    bounds: SearchDomain,
    delta_cost: float,
    *,
    shortest: float,
    longest: float,
    known: float = 0.0,
) -> float:
    """How far a point may move from a minimum before the cost has risen by `delta_cost` along all of some directions.

    Half the width of a confidence interval from the profile of χ²; the larger of both ways, which end at the bounds.
    shortest, longest: multiples of the directions; searched by doubling and six bisections. known: a distance that is
    allowed anyway, from which the bisections begin.
    """
    widest = known
    for sign in (-1.0, 1.0):
        low, high = known, shortest
        end = min(longest, max(_distance_to_bounds(minimum.x, sign * along, bounds) for along in directions))

        def has_risen(distance: float, sign: float = sign) -> bool:
            points = (bounds.clip(minimum.x + sign * distance * along) for along in directions)
            return not any(sum_of_squares(function(x)) < minimum.cost + delta_cost for x in points)

        while high < end and not has_risen(high):
            low, high = high, 2 * high
        high = min(high, end)
        for _ in range(_BISECTIONS if high > low else 0):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if has_risen(middle) else (middle, high)
        widest = max(widest, high)
    return widest


def _distance_to_bounds(x: Vector, direction: Vector, bounds: SearchDomain) -> float:
    """The multiple of a direction at which the first parameter reaches a bound."""
    moving = direction != 0
    ends = np.where(direction > 0, bounds.upper, bounds.lower)[moving]
    return float(np.min((ends - x[moving]) / direction[moving], initial=np.inf))


def sum_of_squares(residual: ResidualVector) -> float:
    """Σ residual² in float64, of any shape."""
    flat = residual.ravel()
    return (
        float(np.einsum("i,i->", flat, flat, dtype=np.float64))
        if flat.size < 65536
        else float(_blocked_sum_of_squares(flat))
    )


def _blocked_sum_of_squares(flat: ResidualVector) -> float:
    """Σ x² in float64 over float32 sums of blocks: fast, and a sum in float32 alone would hide small gains."""
    whole = flat.size // 4096 * 4096
    blocks = flat[:whole].reshape(-1, 4096)
    return float(np.einsum("ij,ij->i", blocks, blocks).sum(dtype=np.float64) + np.square(flat[whole:]).sum())


def _step(normal: NDArray[np.float64], gradient: Vector, damping: float, x: Vector, bounds: SearchDomain) -> Vector:
    """The damped Gauss–Newton step; zero for parameters at a bound that the gradient pushes outwards."""
    free = ~(((x <= bounds.lower) & (gradient > 0)) | ((x >= bounds.upper) & (gradient < 0)))
    scale = np.diag(normal)
    free &= scale > 0
    step = np.zeros_like(x)
    if free.any():
        block = np.ix_(free, free)
        damped = normal[block] + damping * np.diag(scale[free]) + 1e-12 * scale[free].max() * np.eye(free.sum())
        step[free] = -np.linalg.solve(damped, gradient[free])
    return step


def _axis_evaluator(function: ResidualFunction, start: Vector, axis: int) -> Callable[[float], Minimum]:
    """The function of one parameter, the others as at the start."""

    def evaluate(value: float) -> Minimum:
        x = np.array(start, dtype=np.float64)
        x[axis] = value
        residual = function(x)
        return Minimum(x, sum_of_squares(residual), residual, 1)

    return evaluate


# The downhill simplex (Nelder & Mead, Computer Journal 7, 308 (1965)) for costs without a gradient at their minimum.
#
# The area between two hard edges is proportional to their distance, so that the cost has a crease where they meet.
# Least squares with derivatives end anywhere along such a crease.


_RELATIVE_COST_TOLERANCE = 1e-3  # of the cost at the start
_PARAMETER_TOLERANCE = 3e-3  # of a prior, the unit in which a fit's parameters are given


def nelder_mead(
    function: ResidualFunction,
    start: Minimum,
    bounds: SearchDomain,
    free_axes: NDArray[np.bool_],
    edge_length: float,
    evaluations: int,
) -> Minimum:
    """A minimum of Σ residual² over some of the parameters, by scipy's Nelder–Mead.

    function: parameters (parameter,) to residuals.
    start: parameters, cost and residuals to begin with.
    bounds: points outside are evaluated at the nearest point inside.
    free_axes: which parameters vary, (parameter,); the others are held.
    edge_length: edges of the first simplex, in the unit of the parameters.
    evaluations: at most so many, and one more for the residuals at the end.

    Ends when the simplex spans less than 0.003 in every parameter and 0.1 % of the cost at the start. Returns `start`
    itself where nothing better was found.
    """
    free = np.flatnonzero(free_axes)

    def all_parameters(free_values: Vector) -> Vector:
        x = start.x.copy()
        x[free] = free_values
        return bounds.clip(x)

    corners = np.vstack([start.x[free], *(start.x[free] + edge_length * edge for edge in np.eye(len(free)))])
    result = minimize(
        lambda free_values: sum_of_squares(function(all_parameters(free_values))),
        start.x[free],
        method="Nelder-Mead",
        options={
            "initial_simplex": corners,
            "xatol": _PARAMETER_TOLERANCE,
            "fatol": _RELATIVE_COST_TOLERANCE * start.cost,
            "maxfev": evaluations,
        },
    )
    if result.fun >= start.cost:
        return start
    x = all_parameters(result.x)
    return Minimum(x, float(result.fun), function(x), start.evaluations + int(result.nfev) + 1)
