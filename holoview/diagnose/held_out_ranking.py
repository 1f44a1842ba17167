"""Candidates on captures that no fit has seen, all by the same frozen weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.effect_fit import CandidateFit, cost_or_inf
from holoview.diagnose.screening import relative_model_error
from holoview.diagnose.search_context import SearchContext

NEARLY = 1.3  # χ²/n from which a cause is worth judging at once
ALARM = 25.0  # Δχ² of held-out captures below which nothing has been found (5 σ)


@dataclass(frozen=True)
class HeldOutScore:
    """A trial and its χ²/n on held-out captures, in total and for each; rank: the same by weights that forgive."""

    fit: CandidateFit
    chi2_per_pixel: float
    per_capture: tuple[float, ...]
    tolerant_chi2: float

    @property
    def causes(self) -> tuple[str, ...]:
        """The effects that are on."""
        return self.fit.causes

    @property
    def excess(self) -> float:
        """χ²/n beyond the noise floor."""
        return self.chi2_per_pixel - 1.0


@dataclass(frozen=True)
class SearchResult:
    """What a search found: candidates, best first, all judged by the same frozen weights; the nominal bench's χ²."""

    nominal: HeldOutScore
    candidates: tuple[HeldOutScore, ...]
    comparison: Comparison
    tolerant_comparison: Comparison

    @property
    def best(self) -> HeldOutScore:
        """The best candidate; the nominal bench where there is none."""
        return self.candidates[0] if self.candidates else self.nominal

    @property
    def pixel_count(self) -> float:
        """How many held-out pixels judge."""
        return self.comparison.pixel_count


NOTHING = CandidateFit((), {}, float("inf"))

HasCauses = TypeVar("HasCauses", CandidateFit, HeldOutScore)


def rank_on_held_out(context: SearchContext, fits: Sequence[CandidateFit]) -> SearchResult:
    """All trials on the held-out captures, with weights frozen at the prediction of the best of them.

    Weights at a wrong prediction favour what is wrong alike. So as long as the best is far off, the order is by weights
    that forgive as much as that.
    """
    indices = context.split.held_out
    rough = context.data_weighted_comparison(indices, 1.0)
    first = min([NOTHING, *fits], key=lambda t: cost_or_inf(rough, t.values))
    forgiving = context.data_weighted_comparison(
        indices, min(relative_model_error(context, first.values, indices), 1.0)
    )
    first = min([NOTHING, *fits], key=lambda t: cost_or_inf(forgiving, t.values))
    comparison = context.model_weighted_comparison(indices, first.values)
    found = [score_on_held_out(t, comparison, forgiving) for t in fits]
    near = min((j.chi2_per_pixel for j in found), default=np.inf) < NEARLY
    ordered = sorted(found, key=lambda j: j.chi2_per_pixel if near else j.tolerant_chi2)
    candidates = first_per_cause_set(_simpler_first(ordered, comparison.pixel_count) if near else ordered)
    return SearchResult(score_on_held_out(NOTHING, comparison, forgiving), tuple(candidates), comparison, forgiving)


def score_on_held_out(fit: CandidateFit, comparison: Comparison, tolerant_comparison: Comparison) -> HeldOutScore:
    """One trial by weights that a selection froze."""
    squares = comparison.fit_gains(fit.values).squares
    per_capture = squares / np.maximum(comparison.pixels_per_capture, 1.0)
    rank = cost_or_inf(tolerant_comparison, fit.values) / tolerant_comparison.pixel_count
    return HeldOutScore(fit, float(squares.sum() / comparison.pixel_count), tuple(float(c) for c in per_capture), rank)


def first_per_cause_set(items: Sequence[HasCauses]) -> list[HasCauses]:
    """The first of each set of causes."""
    seen: dict[frozenset[str], HasCauses] = {}
    for one in items:
        seen.setdefault(frozenset(one.causes), one)
    return list(seen.values())


def _simpler_first(found: Sequence[HeldOutScore], pixels: float) -> list[HeldOutScore]:
    """Sorted by χ²; of the leaders, those within 0.02 + 0.02·excess and noise of the best, fewer numbers come first."""
    if not found:
        return []
    best = found[0]
    excess = max(best.excess, 0.0)
    limit = best.chi2_per_pixel + 0.02 * excess + min(0.02, 0.1 * excess) + ALARM / pixels
    leaders = [j for j in found if j.chi2_per_pixel <= limit]
    rest = [j for j in found if j.chi2_per_pixel > limit]
    return sorted(leaders, key=lambda j: (len(j.causes), j.fit.parameter_count, j.chi2_per_pixel)) + rest
