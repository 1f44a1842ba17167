"""Random values of an effect, for tests that hide one: as far from the identity as a share of the searched range."""

from __future__ import annotations

from typing import Any

import numpy as np

from holoview.light.model.effects.effect import Effect, ListParameter, Parameter
from holoview.light.model.system import System

_REACH = 1.5  # of the prior, where a parameter is never scanned
_MOST_TERMS = 2
_MOST_LINES = 6
_MOST_PLANE_ERROR_M = 0.6e-3
_WHOLE = ("camera_fringes", "slm1_fringes", "slm2_fringes")  # effects whose many parameters show together only


def sample_effect(effect: Effect, system: System, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Values of the parameters that a diagnosis searches first; `size` 1 is the edge of the scan.

    An effect with many independent terms gets one or two of them.
    """
    if effect.id == "plane_errors":
        return _sample_planes(system, size, rng)
    if any(isinstance(p, ListParameter) for p in effect.parameters):
        return _sample_lines(effect, system, size, rng)
    open_ones = [p for p in effect.parameters if not p.secondary]
    if len(open_ones) > 3 and effect.id not in _WHOLE:
        chosen = rng.choice(len(open_ones), size=int(rng.integers(1, _MOST_TERMS + 1)), replace=False)
        open_ones = [open_ones[k] for k in sorted(chosen)]
    reaches = _scan_extents(effect, system)
    return {p.name: _sample_parameter(p, reaches.get(p.name, _REACH * p.prior), size, rng) for p in open_ones}


def _sample_lines(effect: Effect, system: System, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Up to so many columns of an effect of places, each with a level of its own; the first two lists are these."""
    places, levels = effect.parameters[:2]
    count = max(1, round(_MOST_LINES * size))
    chosen = np.sort(rng.choice(system.modulators[0].shape[1], size=count, replace=False))
    return {
        places.name: tuple(int(column) for column in chosen),
        levels.name: tuple(float(x) for x in rng.uniform(0.0, 1.0, count)),
    }


def _sample_planes(system: System, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Some planes of the system, but not all, each with an error of its own."""
    count = int(rng.integers(1, max(2, len(system.planes_m))))
    chosen = np.sort(rng.choice(system.planes_m, size=count, replace=False))
    errors = rng.choice([-1.0, 1.0], count) * rng.uniform(0.8, 1.1, count) * size * _MOST_PLANE_ERROR_M
    return {"distances": tuple(chosen.tolist()), "errors": tuple(errors.tolist())}


def _scan_extents(effect: Effect, system: System) -> dict[str, float]:
    """How far the starts of a search go from the identity."""
    reaches: dict[str, float] = {}
    for point in effect.starting_points(system):
        for p in effect.parameters:
            away = abs(point.get(p.name, p.identity) - p.identity)
            if away:
                reaches[p.name] = max(reaches.get(p.name, 0.0), away)
    return reaches


def _sample_parameter(p: Parameter, reach: float, size: float, rng: np.random.Generator) -> float:
    amount = reach * size * rng.uniform(0.8, 1.1)
    signs = [s for s in (1.0, -1.0) if p.low <= p.identity + s * amount <= p.high and (not p.even_symmetric or s > 0)]
    lowest = p.scan_values()
    inside = [s for s in signs if not p.scan or s > 0 or min(lowest, default=0.0) < p.identity] or signs
    value = p.identity + float(rng.choice(inside or [1.0])) * amount
    return float(np.clip(value, p.low, p.high))
