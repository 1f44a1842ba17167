"""Candidates ranked on captures that no fit has used, all with the same frozen weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.config import SearchConfig
from holoview.diagnose.effect_fit import CandidateFit, cost_or_inf
from holoview.diagnose.search_context import SearchContext


@dataclass(frozen=True)
class HeldOutScore:
    """A fit and its χ²/n on held-out captures.

    tolerant_chi2: the same with weights that tolerate the present error of the model.
    """

    fit: CandidateFit
    chi2_per_pixel: float
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
    """What a search found. nominal: the nominal bench. candidates: best first, all with the same frozen weights."""

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
        """Number of held-out pixels."""
        return self.comparison.pixel_count


NOMINAL_FIT = CandidateFit((), {}, float("inf"))

HasCauses = TypeVar("HasCauses", CandidateFit, HeldOutScore)


def rank_on_held_out(context: SearchContext, fits: Sequence[CandidateFit]) -> SearchResult:
    """All fits on the held-out captures, with weights frozen at the prediction of the best of them.

    Weights from a wrong prediction favour similar errors. So while even the best fit is far off, the order is by
    weights that tolerate its error.
    """
    indices, all_fits = context.split.held_out, [NOMINAL_FIT, *fits]
    rough = context.data_weighted_comparison(indices, context.config.fits.max_tolerated_error)
    first = min(all_fits, key=lambda f: cost_or_inf(rough, f.values))
    tolerant = context.tolerant_comparison(indices, context.relative_model_error(first.values, indices))
    first = min(all_fits, key=lambda f: cost_or_inf(tolerant, f.values))
    comparison = context.model_weighted_comparison(indices, first.values)
    scores = [score_on_held_out(f, comparison, tolerant) for f in fits]
    near = min((s.chi2_per_pixel for s in scores), default=np.inf) < context.config.ranking.near_chi2
    if near:
        ordered = sorted(scores, key=lambda s: s.chi2_per_pixel)
        ordered = _simpler_first(ordered, comparison.pixel_count, context.config)
    else:
        ordered = sorted(scores, key=lambda s: s.tolerant_chi2)
    nominal = score_on_held_out(NOMINAL_FIT, comparison, tolerant)
    result = SearchResult(nominal, tuple(first_per_cause_set(ordered)), comparison, tolerant)
    context.best_so_far.note(result)
    return result


def score_on_held_out(fit: CandidateFit, comparison: Comparison, tolerant_comparison: Comparison) -> HeldOutScore:
    """One fit, with weights that were frozen before."""
    tolerant = cost_or_inf(tolerant_comparison, fit.values) / tolerant_comparison.pixel_count
    return HeldOutScore(fit, comparison.chi2_per_pixel(fit.values), tolerant)


def first_per_cause_set(items: Sequence[HasCauses]) -> list[HasCauses]:
    """The first of each set of causes."""
    seen: dict[frozenset[str], HasCauses] = {}
    for item in items:
        seen.setdefault(frozenset(item.causes), item)
    return list(seen.values())


def _simpler_first(scores: Sequence[HeldOutScore], pixels: float, config: SearchConfig) -> list[HeldOutScore]:
    """Scores sorted by χ²/n; among those that tie with the best, fewer causes and parameters come first.

    Ties are within a share of the excess, an excess, and the Δχ² that a cause must gain.
    """
    if not scores:
        return []
    best, ties = scores[0], config.ranking
    excess = max(best.excess, 0.0)
    tolerance = ties.tie_excess_share * excess
    limit = best.chi2_per_pixel + tolerance + min(ties.tie_excess, ties.tie_near_share * excess)
    limit += config.verdict.min_delta_chi2 / pixels
    leaders = [s for s in scores if s.chi2_per_pixel <= limit]
    rest = [s for s in scores if s.chi2_per_pixel > limit]
    return sorted(leaders, key=lambda s: (len(s.causes), s.fit.parameter_count, s.chi2_per_pixel)) + rest
