"""The verdict: what the figures of a search allow one to say.

The share of the excess that is explained misleads: of a large error a blur often explains nine tenths. What separates
the true cause from others is how close it comes to the noise floor on captures that no fit has used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from holoview.diagnose.config import VerdictConfig
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.held_out_ranking import HeldOutScore, SearchResult

Equivalents = Mapping[str, frozenset[str]]


class Verdict(StrEnum):
    """What can be said."""

    CONSISTENT = "consistent"
    EXPLAINED = "explained"
    PARTLY = "partly-explained"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"


@dataclass(frozen=True)
class Decision:
    """The verdict, the candidate that it rests on (None: no cause is named), and rivals that can't be excluded."""

    verdict: Verdict
    best: HeldOutScore | None
    rivals: tuple[HeldOutScore, ...] = ()

    @property
    def values(self) -> FittedValues:
        """The effects of the candidate; none where no cause is named."""
        return self.best.fit.values if self.best else {}


def decide(result: SearchResult, equivalents: Equivalents, config: VerdictConfig) -> Decision:
    """The verdict on a search. equivalents: for each effect those that are the same physics."""
    nominal, best, n = result.nominal, result.best, result.pixel_count
    excess = nominal.excess
    gain = (nominal.chi2_per_pixel - best.chi2_per_pixel) * n
    share = _share_explained(nominal, best)
    if not (result.candidates and gain > config.min_delta_chi2 and share >= config.min_explained_share):
        is_consistent = excess < jitter_excess(n, config)
        return Decision(Verdict.CONSISTENT if is_consistent else Verdict.UNEXPLAINED, None)
    if best.excess > explained_excess(excess, n, config):
        return Decision(Verdict.PARTLY, best)
    rivals = _rivals_of(best, result, equivalents, config)
    return Decision(Verdict.AMBIGUOUS if rivals else Verdict.EXPLAINED, best, rivals)


def limited_by_bad_captures(decision: Decision, bad_share: float, max_share: float) -> Decision:
    """The decision where a share of the captures is bad: beyond `max_share`, no bench is cleared or explained."""
    if bad_share <= max_share:
        return decision
    lower = {
        Verdict.CONSISTENT: Verdict.UNEXPLAINED,
        Verdict.EXPLAINED: Verdict.PARTLY,
        Verdict.AMBIGUOUS: Verdict.PARTLY,
    }
    return replace(decision, verdict=lower.get(decision.verdict, decision.verdict))


def with_further_cause(verdict: Verdict) -> Verdict:
    """The verdict once a cause is named as well that the search for effects doesn't know."""
    return {Verdict.CONSISTENT: Verdict.EXPLAINED, Verdict.UNEXPLAINED: Verdict.PARTLY}.get(verdict, verdict)


def chance_excess(pixels: float, config: VerdictConfig) -> float:
    """The excess χ²/n − 1 that so many pixels reach by chance; its standard deviation is √(2/n)."""
    return float(config.chance_sigmas * (2.0 / pixels) ** 0.5)


def explained_excess(nominal_excess: float, pixels: float, config: VerdictConfig) -> float:
    """The excess χ²/n − 1 that causes may leave and count as an explanation."""
    max_excess = min(config.explained_excess, config.explained_max_share * nominal_excess)
    return max(chance_excess(pixels, config), max_excess)


def jitter_excess(pixels: float, config: VerdictConfig) -> float:
    """The excess χ²/n − 1 that jitter of an ordinary laboratory and chance, which don't depend on each other, leave."""
    return math.hypot(config.jitter_excess, chance_excess(pixels, config))


def _share_explained(nominal: HeldOutScore, best: HeldOutScore) -> float:
    """Share of the excess that is gone, 0 … 1."""
    if nominal.excess <= 0:
        return 0.0
    return min(1.0, max(0.0, (nominal.chi2_per_pixel - best.chi2_per_pixel) / nominal.excess))


def _rivals_of(
    best: HeldOutScore, result: SearchResult, equivalents: Equivalents, config: VerdictConfig
) -> tuple[HeldOutScore, ...]:
    """Other causes, not more numerous, that come about as close to the floor as the best.

    A candidate that contains all of the best's causes, or the same physics under another name, isn't a rival.
    """
    accuracy = min(config.rival_excess, config.rival_excess_share * result.nominal.excess)
    limit = config.rival_factor * max(best.excess, max(config.min_delta_chi2 / result.pixel_count, accuracy))
    return tuple(
        c
        for c in result.candidates
        if len(c.causes) <= len(best.causes)
        and c.excess < limit
        and not _are_equivalent(c.causes, best.causes, equivalents)
    )


def _are_equivalent(a: Sequence[str], b: Sequence[str], equivalents: Equivalents) -> bool:
    """Whether each cause in `a` is one of `b` or the same physics as one of them."""
    return all(any(x == y or y in equivalents.get(x, ()) or x in equivalents.get(y, ()) for y in b) for x in a)
