"""The downhill simplex (Nelder & Mead, Computer Journal 7, 308 (1965)) for costs without a gradient at their minimum.

The area between two hard edges is proportional to their distance, so that the cost has a crease where they meet.
Least squares with derivatives end anywhere along such a crease.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from holoview.numerics.least_squares import Minimum, ResidualFunction, SearchDomain, Vector, sum_of_squares

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
