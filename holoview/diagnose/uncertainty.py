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
from holoview.diagnose.effect_fit import CandidateFit, residual_function
from holoview.diagnose.free_parameters import FreeParameters, free_parameters_of
from holoview.model.effects.effect import Effect
from holoview.numerics.least_squares import Minimum, jacobian, profile_half_width

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
class LocalJacobian:
    """Slopes (parameter, pixel) of the residuals at a solution, and the residuals, for the causes that are on."""

    unknowns: FreeParameters
    slopes: Slopes
    residual: NDArray[np.float32]
    capture_count: int


def local_jacobian(fit: CandidateFit, effects: Sequence[Effect], comparison: Comparison) -> LocalJacobian:
    """The slopes by all parameters of the effects that are off their identity or may be fitted without slopes' help."""
    free = _varied_unknowns(free_parameters_of(effects, include_fine=True), fit)
    residual = comparison.residual(fit.values)
    slopes = jacobian(residual_function(free, fit.values, comparison), free.pack(fit.values), residual, free.bounds())
    return LocalJacobian(free, slopes, residual, len(comparison.indices))


def confidence_intervals(
    fit: CandidateFit, jacobian: LocalJacobian, comparison: Comparison
) -> dict[tuple[str, str], Interval]:
    """The 95 % interval of each (effect, parameter); an infinite one where the data hold nothing about it."""
    count = len(jacobian.unknowns)
    normal = (jacobian.slopes @ jacobian.slopes.T).astype(np.float64)
    inverse = np.linalg.pinv(normal, rcond=1e-10, hermitian=True)
    scores = np.einsum(
        "pkn,kn->kp",
        jacobian.slopes.reshape(count, jacobian.capture_count, -1),
        jacobian.residual.reshape(jacobian.capture_count, -1),
        dtype=np.float64,
    )
    many = jacobian.capture_count / max(jacobian.capture_count - 1, 1)
    robust = inverse @ (scores.T @ scores * many) @ inverse
    noise = inverse * max(1.0, float(np.mean(np.square(jacobian.residual[jacobian.residual != 0.0]))))
    variance = np.maximum(np.diag(robust), np.diag(noise))
    factor = float(student.ppf(0.5 + _LEVEL / 2, max(jacobian.capture_count - 1, 1)))
    blind = np.diag(normal) <= 0.0
    scale = jacobian.unknowns.value_derivatives(jacobian.unknowns.pack(fit.values))
    result = {}
    for i, (effect, parameter) in enumerate(jacobian.unknowns.entries):
        value = fit.values[effect][parameter.name]
        sigma = float("inf") if blind[i] else float(np.sqrt(variance[i]) * abs(scale[i]))
        sigma = float(np.hypot(sigma, _MODEL_ACCURACY * abs(value - parameter.identity)))
        if parameter.sharp:
            sigma = max(sigma, _edge_width(fit, jacobian, i, comparison) * abs(scale[i]) / factor)
        result[effect, parameter.name] = Interval(value, sigma, factor * sigma)
    return result


def _edge_width(fit: CandidateFit, jacobian: LocalJacobian, axis: int, comparison: Comparison) -> float:
    """Half the interval of a parameter with a hard edge, which may move between two samples and change nothing."""
    function = residual_function(jacobian.unknowns, fit.values, comparison)
    x = jacobian.unknowns.pack(fit.values)
    cost = float(np.square(jacobian.residual, dtype=np.float64).sum())
    rise = _EDGE_RISE * max(1.0, cost / comparison.pixel_count)
    return profile_half_width(function, Minimum(x, cost, jacobian.residual, 0), axis, jacobian.unknowns.bounds(), rise)


def canonical_correlation(first: Slopes, second: Slopes, known: Slopes | None = None) -> float:
    """The largest correlation between any two combinations of two sets of slopes, what `known` explains taken out."""
    a, b = (_orthonormal(_project_out(s, known)) for s in (first, second))
    if not len(a) or not len(b):
        return 0.0
    return float(min(1.0, np.linalg.svd((a @ b.T).astype(np.float64), compute_uv=False)[0]))


def _project_out(slopes: Slopes, known: Slopes | None) -> Slopes:
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


def _varied_unknowns(free: FreeParameters, fit: CandidateFit) -> FreeParameters:
    """Without parameters that stay at their identity because the fit never varied them."""
    return FreeParameters(
        tuple(
            (e, p) for e, p in free.entries if not p.fine or fit.values.get(e, {}).get(p.name, p.identity) != p.identity
        )
    )
