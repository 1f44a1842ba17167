"""How well a capture tells hypotheses apart, before it is taken: expected Δχ², and the expected information.

A hypothesis i predicts the picture u_i, in σ of its noise, and its parameters, known from the captures so far, spread
it along the rows of B_i, each by one standard deviation. If i is true and its rival j is fitted again, to first order,
with what the captures so far say of j's parameters as a prior,

    E[Δχ²_ij] = (u_i − u_j)ᵀ M_j (u_i − u_j) + tr(B_i M_j B_iᵀ),   M_j = (I + B_jᵀ B_j)⁻¹

which is the criterion of T-optimal designs (Atkinson & Fedorov, Biometrika 62, 57 (1975)) with its rival linearised.
The gain of a capture is unknown, so that all is projected onto what no gain can imitate.

Many Δχ² between two hypotheses tell no more than which of them is true. So what counts is the information in nats,

    I = −Σ_i p_i ln Σ_j p_j exp(−Δχ²_ij / 8)

with Bhattacharyya's distances of Gaussians of equal variance, a lower bound of the mutual information between cause
and capture (Kolchinsky & Tracey, Entropy 19, 361 (2017)). It is never negative, nor more than the entropy of p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """What a hypothesis predicts of one capture, in σ: picture (pixel,), spreads (parameter, pixel)."""

    picture: Floats
    spreads: Floats

    def without(self, gain: Floats) -> Response:
        """The part that isn't along the direction `gain` (pixel,)."""
        unit = gain / max(float(np.linalg.norm(gain)), 1e-300)
        picture = self.picture - unit * (unit @ self.picture)
        return Response(picture, self.spreads - np.outer(self.spreads @ unit, unit))


def expected_delta_chi2(truth: Response, rival: Response) -> float:
    """By how much χ² of the rival, fitted again, will exceed that of the truth, in the mean."""
    d, b = truth.picture - rival.picture, rival.spreads
    rows = np.vstack([d[None], truth.spreads])
    along = rows @ b.T
    normal = np.eye(len(b)) + b @ b.T
    explained = np.einsum("rp,pr->r", along, np.linalg.solve(normal, along.T)) if len(b) else np.zeros(len(rows))
    return float(np.maximum(np.einsum("rn,rn->r", rows, rows) - explained, 0.0).sum())


def pairwise_delta_chi2(responses: Sequence[Response]) -> Floats:
    """Δχ² (hypothesis, hypothesis) by which a capture separates each pair, whichever of the two is true."""
    count = len(responses)
    directed = np.zeros((count, count))
    for i, truth in enumerate(responses):
        for j, rival in enumerate(responses):
            if i != j:
                directed[i, j] = expected_delta_chi2(truth, rival)
    return np.minimum(directed, directed.T)


def expected_information(probabilities: Floats, delta_chi2: Floats) -> float:
    """I in nats. probabilities: (hypothesis,), of sum 1. delta_chi2: (hypothesis, hypothesis), zero on the diagonal."""
    mixture = np.exp(-delta_chi2 / 8.0) @ probabilities
    known = probabilities > 0
    return max(0.0, float(-(probabilities[known] @ np.log(mixture[known]))))


def entropy(probabilities: Floats) -> float:
    """−Σ p ln p, in nats."""
    p = probabilities[probabilities > 0]
    return max(0.0, float(-(p @ np.log(p))))
