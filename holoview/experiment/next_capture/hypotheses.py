"""What may be the cause: sets of effects with values, their evidence and their probabilities.

Fitted hypotheses are the nominal bench, single effects, and pairs. Once one of them leads, effects that could act
beside it join as open ones, each at its identity with all that the captures so far leave possible: they keep captures
coming until they are excluded, or show. What an open one would gain counts once it is significant, and is fitted then:
small gains are those of the model's own error as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.fit import (
    CandidateFit,
    FittedValues,
    FreeParameters,
    free_parameters_of,
    identity_values,
    residual_function,
)
from holoview.diagnose.likelihood import Comparison
from holoview.diagnose.search_context import SearchContext
from holoview.experiment.next_capture.evidence import (
    covariance_root,
    linear_gain,
    log_evidence,
    log_prior,
    probabilities,
)
from holoview.numerics.least_squares import jacobian
from holoview.util.errors import UserError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Hypothesis:
    """Causes with values, and what the captures so far say of them.

    free: the parameters that are known as `root` says, L with L Lᵀ their covariance in priors². log_weight: evidence
    and prior. gain: by how much an open one, whose last cause is at its identity, would lower χ²; None for fitted ones.
    """

    causes: tuple[str, ...]
    values: FittedValues
    free: FreeParameters
    root: Floats
    log_weight: float
    gain: float | None = None

    @property
    def is_open(self) -> bool:
        """Whether its last cause is at its identity."""
        return self.gain is not None

    @property
    def name(self) -> str:
        """In words."""
        return " and ".join(self.causes) or "the nominal bench"


@dataclass(frozen=True)
class Belief:
    """The hypotheses, the most probable first, with their probabilities.

    chi2_per_pixel: of the leader. explains: whether it leaves as little as an explanation may. temperature: by which
    differences of χ² are divided. comparison: with all captures so far.
    """

    hypotheses: tuple[Hypothesis, ...]
    probabilities: Floats
    chi2_per_pixel: float
    explains: bool
    temperature: float
    context: SearchContext = field(repr=False)
    comparison: Comparison = field(repr=False)

    @property
    def leader(self) -> Hypothesis:
        """The most probable one that was fitted."""
        return next(h for h in self.hypotheses if not h.is_open)

    @property
    def certainty(self) -> float:
        """Probability of the leader, and of what is the same physics."""
        return float(sum(p for h, p in zip(self.hypotheses, self.probabilities, strict=True) if self._is_leader(h)))

    @property
    def rivals(self) -> tuple[Hypothesis, ...]:
        """The others, the most probable first."""
        return tuple(h for h in self.hypotheses if not self._is_leader(h))

    def _is_leader(self, other: Hypothesis) -> bool:
        leader, equal = self.leader, self.context.equivalents
        return len(other.causes) == len(leader.causes) and all(
            name in leader.causes or equal.get(name, frozenset()) & {*leader.causes} for name in other.causes
        )


def fitted_hypothesis(
    fit: CandidateFit, comparison: Comparison, context: SearchContext, temperature: float
) -> Hypothesis:
    """A fit, whose cost is that in this comparison, with its evidence."""
    effects = [context.effects[name] for name in fit.causes]
    free = free_parameters_of(effects, fit.values)
    x, slopes = free.pack(fit.values), slopes_of(free, fit.values, comparison, context)
    normal = (slopes @ slopes.T).astype(np.float64)
    away = x - free.identity
    weight = log_evidence(fit.cost, normal, np.where(np.isfinite(away), away, 0.0), temperature)
    root = covariance_root(normal, temperature)
    return Hypothesis(fit.causes, fit.values, free, root, weight + log_prior(len(fit.causes), len(context.effects)))


def open_hypotheses(
    leader: Hypothesis,
    cost: float,
    names: Sequence[str],
    comparison: Comparison,
    context: SearchContext,
    temperature: float,
) -> list[Hypothesis]:
    """The leader with each of these effects beside it, at its identity. cost: of the leader in this comparison."""
    residual = comparison.residual(leader.values)
    own = slopes_of(leader.free, leader.values, comparison, context)
    found = []
    for name in names:
        values = {**leader.values, name: identity_values(context.effects[name])}
        added = free_parameters_of([context.effects[name]], values)
        if not len(added):
            continue  # a list, which is empty until something shows
        free = FreeParameters((*leader.free.entries, *added.entries))
        try:
            slopes = np.vstack([own, slopes_of(added, values, comparison, context)])
        except UserError:
            continue
        normal = (slopes @ slopes.T).astype(np.float64)
        gain = linear_gain(normal, (slopes @ residual).astype(np.float64), temperature)
        causes = (*leader.causes, name)
        weight = log_evidence(cost, normal, np.zeros(len(free)), temperature)
        root = covariance_root(normal, temperature)
        weight += log_prior(len(causes), len(context.effects))
        found.append(Hypothesis(causes, values, free, root, weight, gain))
    return sorted(found, key=lambda h: -h.log_weight)


def slopes_of(
    free: FreeParameters, values: FittedValues, comparison: Comparison, context: SearchContext
) -> NDArray[np.float32]:
    """Derivatives (parameter, pixel) of the residuals at `values`, in units of the priors."""
    residual = comparison.residual(values)
    bounds = free.bounds()
    return jacobian(residual_function(free, values, comparison), free.pack(values), residual, bounds)


def with_probabilities(hypotheses: Sequence[Hypothesis]) -> tuple[tuple[Hypothesis, ...], Floats]:
    """The hypotheses, the most probable first, and their probabilities."""
    ordered = tuple(sorted(hypotheses, key=lambda h: -h.log_weight))
    return ordered, probabilities([h.log_weight for h in ordered])
