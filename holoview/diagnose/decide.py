"""The verdict: what the figures of a search allow one to say, and no more.

Share explained alone misleads: of a large error a blur often explains nine tenths. What separates the true cause from
stand-ins is how close it comes to the noise floor on captures that no fit has seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from holoview.diagnose.judge import ALARM, Judged, Selection

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
    best: Judged | None
    rivals: tuple[Judged, ...] = ()


def decide(selection: Selection, equals: Mapping[str, frozenset[str]]) -> Decision:
    """The verdict of a selection. equals: for each effect those that are the same physics."""
    nominal, best, n = selection.nominal, selection.best, selection.pixels
    excess = nominal.excess
    gain = (nominal.chi2 - best.chi2) * n
    share = share_explained(nominal, best)
    found = bool(selection.candidates) and gain > ALARM and share >= HALF
    if not found:
        verdict = Verdict.CONSISTENT if excess < quiet(n) else Verdict.UNEXPLAINED
        return Decision(verdict, None)
    is_explained = best.excess <= max(scatter(n), min(_NEAR_FLOOR, _MOST_LEFT * excess))
    if not is_explained:
        return Decision(Verdict.PARTLY, best)
    rivals = rivals_of(best, selection.candidates, excess, n, equals)
    return Decision(Verdict.AMBIGUOUS if rivals else Verdict.EXPLAINED, best, rivals)


def scatter(pixels: float) -> float:
    """χ²/n − 1 that so many pixels reach by chance: 2.5 σ."""
    return float(2.5 * (2.0 / pixels) ** 0.5)


def quiet(pixels: float) -> float:
    """χ²/n − 1 that jitter of an ordinary laboratory and chance may leave."""
    return max(_QUIET, scatter(pixels))


def share_explained(nominal: Judged, judged: Judged) -> float:
    """Share of the excess that is gone, 0 … 1."""
    if nominal.excess <= 0:
        return 0.0
    return min(1.0, max(0.0, (nominal.chi2 - judged.chi2) / nominal.excess))


def rivals_of(
    best: Judged, candidates: Sequence[Judged], excess: float, pixels: float, equals: Mapping[str, frozenset[str]]
) -> tuple[Judged, ...]:
    """Other causes, not more numerous, that come about as close to the floor as the best.

    A candidate that contains all of the best's causes, or the same physics under another name, isn't a rival.
    """
    tolerated = max(ALARM / pixels, min(0.01, 0.1 * excess))
    limit = _RIVAL * max(best.excess, tolerated)
    return tuple(
        c
        for c in candidates
        if len(c.causes) <= len(best.causes) and c.excess < limit and not _same_physics(c.causes, best.causes, equals)
    )


def _same_physics(a: Sequence[str], b: Sequence[str], equals: Mapping[str, frozenset[str]]) -> bool:
    return all(any(x == y or y in equals.get(x, ()) or x in equals.get(y, ()) for y in b) for x in a)
