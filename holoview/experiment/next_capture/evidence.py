"""Evidence of a hypothesis by Laplace's approximation, and probabilities.

With χ² at the fit x̂, the derivatives J of the residuals there and a normal prior of width w about the identity x₀,

    ln E = −½ χ²/T − ½ ln |I + w² JᵀJ/T| − ½ |x̂ − x₀|²/w²

so that a parameter costs as much as the captures narrow it down (MacKay, Neural Computation 4, 415 (1992)). Where no
hypothesis reaches the noise floor, T > 1 is the χ²/n of the best one: neighbouring pixels share the model's error, and
differences of χ² mean less by that factor.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PRIOR_WIDTH = 3.0
"""Width of the prior in units of a parameter's `prior`, its usual size: gross errors happen too."""


def log_evidence(cost: float, normal: Floats, away: Floats, temperature: float) -> float:
    """ln E. cost: χ². normal: JᵀJ (parameter, parameter). away: x̂ − x₀, both in priors."""
    _, determinant = np.linalg.slogdet(np.eye(len(away)) + PRIOR_WIDTH**2 / temperature * normal)
    return -0.5 * (cost / temperature + float(determinant) + float(away @ away) / PRIOR_WIDTH**2)


def covariance_root(normal: Floats, temperature: float) -> Floats:
    """L with L Lᵀ = (JᵀJ/T + I/w²)⁻¹, the covariance of the parameters in priors²."""
    count = len(normal)
    if not count:
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(normal / temperature + np.eye(count) / PRIOR_WIDTH**2)
    return np.asarray(vectors / np.sqrt(np.maximum(values, 1e-12)))


FURTHER_CAUSE = 0.1
"""Odds of one cause more, before any capture."""


def log_prior(cause_count: int, effect_count: int) -> float:
    """Of a set of causes: each cause more is less likely, and of so many causes every set is as likely."""
    return cause_count * float(np.log(FURTHER_CAUSE / max(effect_count, 1)))


def probabilities(log_weights: Sequence[float]) -> Floats:
    """Weights as probabilities of sum 1."""
    weights = np.array(log_weights, dtype=np.float64)
    p = np.exp(weights - weights.max())
    return np.asarray(p / p.sum())


def linear_gain(normal: Floats, gradient: Floats, temperature: float) -> float:
    """By how much χ²/T falls if residuals depend linearly on the parameters. gradient: Jr, at the identity."""
    if not len(normal):
        return 0.0
    step = np.linalg.solve(normal / temperature + np.eye(len(normal)) / PRIOR_WIDTH**2, gradient / temperature)
    return max(0.0, float(gradient @ step) / temperature)
