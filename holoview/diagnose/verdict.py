"""The verdict: what the figures of a search allow one to say, and no more.

Share explained alone misleads: of a large error a blur often explains nine tenths. What separates the true cause from
stand-ins is how close it comes to the noise floor on captures that no fit has seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from holoview.diagnose.held_out_ranking import ALARM, HeldOutScore, SearchResult

_QUIET = 0.02  # χ²/n − 1 that exposure jitter, λ jitter and the like may leave
_NEAR_FLOOR = 0.10  # χ²/n − 1 up to which a cause may be said to explain the captures
_MOST_LEFT = 0.2  # of the excess, after an explanation
HALF = 0.5
_RIVAL = 2.0  # a rival that leaves less than so many times what the best leaves can't be excluded


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


def decide(selection: SearchResult, equivalents: Mapping[str, frozenset[str]]) -> Decision:
    """The verdict of a selection. equals: for each effect those that are the same physics."""
    nominal, best, n = selection.nominal, selection.best, selection.pixel_count
    excess = nominal.excess
    gain = (nominal.chi2_per_pixel - best.chi2_per_pixel) * n
    share = share_explained(nominal, best)
    found = bool(selection.candidates) and gain > ALARM and share >= HALF
    if not found:
        verdict = Verdict.CONSISTENT if excess < jitter_excess(n) else Verdict.UNEXPLAINED
        return Decision(verdict, None)
    is_explained = best.excess <= max(chance_excess(n), min(_NEAR_FLOOR, _MOST_LEFT * excess))
    if not is_explained:
        return Decision(Verdict.PARTLY, best)
    rivals = rivals_of(best, selection.candidates, excess, n, equivalents)
    return Decision(Verdict.AMBIGUOUS if rivals else Verdict.EXPLAINED, best, rivals)


def chance_excess(pixels: float) -> float:
    """χ²/n − 1 that so many pixels reach by chance: 2.5 σ."""
    return float(2.5 * (2.0 / pixels) ** 0.5)


def jitter_excess(pixels: float) -> float:
    """χ²/n − 1 that jitter of an ordinary laboratory and chance may leave."""
    return max(_QUIET, chance_excess(pixels))


def share_explained(nominal: HeldOutScore, explained: HeldOutScore) -> float:
    """Share of the excess that is gone, 0 … 1."""
    if nominal.excess <= 0:
        return 0.0
    return min(1.0, max(0.0, (nominal.chi2_per_pixel - explained.chi2_per_pixel) / nominal.excess))


def rivals_of(
    best: HeldOutScore,
    candidates: Sequence[HeldOutScore],
    excess: float,
    pixels: float,
    equivalents: Mapping[str, frozenset[str]],
) -> tuple[HeldOutScore, ...]:
    """Other causes, not more numerous, that come about as close to the floor as the best.

    A candidate that contains all of the best's causes, or the same physics under another name, isn't a rival.
    """
    tolerated = max(ALARM / pixels, min(0.01, 0.1 * excess))
    limit = _RIVAL * max(best.excess, tolerated)
    return tuple(
        c
        for c in candidates
        if len(c.causes) <= len(best.causes)
        and c.excess < limit
        and not _are_equivalent(c.causes, best.causes, equivalents)
    )


def _are_equivalent(a: Sequence[str], b: Sequence[str], equals: Mapping[str, frozenset[str]]) -> bool:
    return all(any(x == y or y in equals.get(x, ()) or x in equals.get(y, ()) for y in b) for x in a)
