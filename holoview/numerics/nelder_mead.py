"""The downhill simplex for hard edges: a moved edge costs in proportion to how far it moved, a cost with a crease.

Least squares from slopes ends in such a crease. Nelder & Mead, Computer Journal 7, 308 (1965).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from holoview.numerics.least_squares import Minimum, ResidualFunction, SearchDomain, Vector, sum_of_squares

_GAIN = 1e-3  # of the cost, and
_MOVE = 3e-3  # of a prior: with less in sight it ends


def nelder_mead(
    function: ResidualFunction,
    start: Minimum,
    bounds: SearchDomain,
    free_axes: NDArray[np.bool_],
    edge_length: float,
    evaluations: int,
) -> Minimum:
    """The least cost found by varying some axes, from a simplex with edges of `width`; the start if nothing is better.

    axes: which components vary. evaluations: at most so many.
    """
    free = np.flatnonzero(free_axes)

    def whole(part: Vector) -> Vector:
        x = start.x.copy()
        x[free] = part
        return bounds.clip(x)

    corners = np.vstack([start.x[free], *(start.x[free] + edge_length * edge for edge in np.eye(len(free)))])
    found = minimize(
        lambda part: sum_of_squares(function(whole(part))),
        start.x[free],
        method="Nelder-Mead",
        options={"initial_simplex": corners, "xatol": _MOVE, "fatol": _GAIN * start.cost, "maxfev": evaluations},
    )
    if found.fun >= start.cost:
        return start
    x = whole(found.x)
    return Minimum(x, float(found.fun), function(x), start.evaluations + int(found.nfev) + 1)
