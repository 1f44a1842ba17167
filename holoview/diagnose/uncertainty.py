"""How sure a value is, and what it could be mistaken for: both from the slopes of the residuals at the solution.

With J the slopes of the whitened residuals r (gains and movements of the camera projected out), photon noise alone
gives the covariance (JᵀJ)⁻¹. Where the model doesn't reach the floor, what is left is the same in neighbouring pixels,
so the scores g_k = J_kᵀ r_k of whole captures are the independent draws: (JᵀJ)⁻¹ (Σ g_k g_kᵀ) (JᵀJ)⁻¹ · K/(K − 1). The
larger of the two is reported (White, Econometrica 48, 817 (1980); clusters: Liang & Zeger, Biometrika 73, 13 (1986)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.levenberg import Minimum, jacobian, profile_width
from holoview.diagnose.search import Trial, residual_of
from holoview.diagnose.unknowns import Unknowns, unknowns
from holoview.effects.effect import Effect

_LEVEL = 0.95
_MODEL_ACCURACY = 1e-3  # of a value: two programs for the same physics hardly agree better on grids of this size
_EDGE_RISE = 25.0  # χ² by which an edge is surely on the wrong side of a sample
Slopes = NDArray[np.float32]


@dataclass(frozen=True)
class Interval:
    """A value with its standard deviation and the half-width of its 95 % interval, SI."""

    value: float
    sigma: float
    half_width: float


@dataclass(frozen=True)
class Tangent:
    """Slopes (parameter, pixel) of the residuals at a solution, and the residuals, for the causes that are on."""

    free: Unknowns
    slopes: Slopes
    residual: NDArray[np.float32]
    captures: int


def tangent(trial: Trial, effects: Sequence[Effect], comparison: Comparison) -> Tangent:
    """The slopes by all parameters of the effects that are off their identity or may be fitted without slopes' help."""
    free = _moving(unknowns(effects, fine=True), trial)
    residual = comparison.residual(trial.values)
    slopes = jacobian(residual_of(free, trial.values, comparison), free.pack(trial.values), residual, free.bounds())
    return Tangent(free, slopes, residual, len(comparison.indices))


def intervals(trial: Trial, at: Tangent, comparison: Comparison) -> dict[tuple[str, str], Interval]:
    """The 95 % interval of each (effect, parameter); an infinite one where the data hold nothing about it."""
    count = len(at.free)
    normal = (at.slopes @ at.slopes.T).astype(np.float64)
    inverse = np.linalg.pinv(normal, rcond=1e-10, hermitian=True)
    scores = np.einsum(
        "pkn,kn->kp", at.slopes.reshape(count, at.captures, -1), at.residual.reshape(at.captures, -1), dtype=np.float64
    )
    many = at.captures / max(at.captures - 1, 1)
    robust = inverse @ (scores.T @ scores * many) @ inverse
    noise = inverse * max(1.0, float(np.mean(np.square(at.residual[at.residual != 0.0]))))
    variance = np.maximum(np.diag(robust), np.diag(noise))
    factor = float(student.ppf(0.5 + _LEVEL / 2, max(at.captures - 1, 1)))
    blind = np.diag(normal) <= 0.0
    scale = at.free.values_per_unit(at.free.pack(trial.values))
    result = {}
    for i, (effect, parameter) in enumerate(at.free.entries):
        value = trial.values[effect][parameter.name]
        sigma = float("inf") if blind[i] else float(np.sqrt(variance[i]) * abs(scale[i]))
        sigma = float(np.hypot(sigma, _MODEL_ACCURACY * abs(value - parameter.identity)))
        if parameter.sharp:
            sigma = max(sigma, _edge_width(trial, at, i, comparison) * abs(scale[i]) / factor)
        result[effect, parameter.name] = Interval(value, sigma, factor * sigma)
    return result


def _edge_width(trial: Trial, at: Tangent, axis: int, comparison: Comparison) -> float:
    """Half the interval of a parameter with a hard edge, which may move between two samples and change nothing."""
    function = residual_of(at.free, trial.values, comparison)
    x = at.free.pack(trial.values)
    cost = float(np.square(at.residual, dtype=np.float64).sum())
    rise = _EDGE_RISE * max(1.0, cost / comparison.count)
    return profile_width(function, Minimum(x, cost, at.residual, 0), axis, at.free.bounds(), rise)


def canonical_correlation(first: Slopes, second: Slopes, known: Slopes | None = None) -> float:
    """The largest correlation between any two combinations of two sets of slopes, what `known` explains taken out."""
    a, b = (_orthonormal(_without(s, known)) for s in (first, second))
    if not len(a) or not len(b):
        return 0.0
    return float(min(1.0, np.linalg.svd((a @ b.T).astype(np.float64), compute_uv=False)[0]))


def _without(slopes: Slopes, known: Slopes | None) -> Slopes:
    if known is None or not len(known):
        return slopes
    basis = _orthonormal(known)
    return np.asarray(slopes - (slopes @ basis.T) @ basis, dtype=np.float32)


def _orthonormal(slopes: Slopes) -> Slopes:
    """An orthonormal basis (rows) of the rows' span; rows that add nothing are left out."""
    norms = np.linalg.norm(slopes, axis=1)
    kept = slopes[norms > 0] / norms[norms > 0, None]
    if not len(kept):
        return kept
    gram = (kept @ kept.T).astype(np.float64)
    values, vectors = np.linalg.eigh(gram)
    good = values > 1e-4 * values.max()
    return np.asarray((vectors[:, good] / np.sqrt(values[good])).T @ kept, dtype=np.float32)


def _moving(free: Unknowns, trial: Trial) -> Unknowns:
    """Without parameters that stay at their identity because the fit never varied them."""
    return Unknowns(
        tuple(
            (e, p)
            for e, p in free.entries
            if not p.fine or trial.values.get(e, {}).get(p.name, p.identity) != p.identity
        )
    )
