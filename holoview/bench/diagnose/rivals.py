"""Other names for the causes that a search has found: names that the captures can't exclude, and the simplest name.

prefer_fewer_numbers  of names that no data can tell apart, the name with fewer numbers. A wrong gap is a defocus of
                      relay 1, one of the aberrations that it may have: gap states it by one number, aberration1 by
                      many. A search may come to either first, alone or together with other causes. A second line that
                      has most of the light isn't an offset of the wavelength, but comes so near that a search may not
                      look further
with_rivals           effects that could stand for a cause in these captures alone. A search ends with its first
                      explanation, and may not have come to the others
find_lookalikes       how much alike the effects change these captures
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from holoview.bench.diagnose.fit import CandidateFit, FittedValues, effect_jacobian, identity_values, number_count
from holoview.bench.diagnose.intervals import LocalJacobian, canonical_correlation, local_jacobian, share_in_span
from holoview.bench.diagnose.judge import (
    Decision,
    Lookalikes,
    SearchResult,
    Verdict,
    decide,
    rank_on_held_out,
    score_on_held_out,
)
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.refine import refine_fit
from holoview.bench.diagnose.screening import fit_over_range, is_very_costly
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.effects.effect import Effect

MIN_CORRELATION = 0.5
"""[1] Canonical correlation from which a look-alike is told. Evidence: the screening study: most pairs are below
0.3."""
_TRIED_SHARE = 0.99
"""[1] An effect is tried in a cause's place if its derivatives explain this share of the cause's change. Evidence:
pictures in single precision, and steps of finite length, leave derivatives of equal effects about 0.1 % apart."""
_TRIED_DELTA_FACTOR = 4.0
"""[1] An effect is also tried if the unexplained rest of the cause's change is below this factor times the Δχ² that
excludes a rival. Evidence: a reason: a fit
may come nearer than derivatives predict."""
_TRIED_FOR_EACH = 3  # [effects] Tried for each cause. Evidence: their cost; a fit of all causes each.


def find_lookalikes(context: SearchContext, fit: CandidateFit) -> Lookalikes:
    """The look-alikes of a fit's causes in one or two smooth captures; changes that its other causes explain are
    removed first.

    The same physics in as many numbers or more counts as a correlation of 1.
    """
    one_or_two = [0] if is_very_costly(context, fit) else [0, -1]
    few = context.model_weighted_comparison(context.split.coarse[one_or_two], fit.values)
    at = local_jacobian(fit, [context.effects[name] for name in fit.causes], few)
    others = [e for e in (context.effects | context.unseen).values() if e.id not in fit.causes]
    slopes = context.run_parallel([partial(_slopes_beside, e, fit, few, at) for e in others])
    owner = np.array([effect for effect, _ in at.parameters.entries])
    moved = (at.parameters.pack(fit.values) - np.nan_to_num(at.parameters.identity)).astype(np.float32)
    correlations: dict[str, dict[str, float]] = {}
    shares: dict[str, dict[str, float]] = {}
    for cause in fit.causes:
        own, rest, by = at.slopes[owner == cause], at.slopes[owner != cause], moved[owner == cause]
        known = {e.id: s for e, s in zip(others, slopes, strict=True) if len(s)}
        found = {name: canonical_correlation(own, s, rest) for name, s in known.items()}
        equal = context.equivalents.get(cause, frozenset())
        numbers = number_count(context.effects[cause])
        found |= {name: 1.0 for name in equal if number_count(context.effects[name]) >= numbers}
        alike = {name: value for name, value in found.items() if value >= MIN_CORRELATION}
        seen = [name for name in sorted(alike, key=lambda name: -alike[name]) if name in context.effects]
        correlations[cause] = {name: alike[name] for name in seen}
        change = by @ own
        shares[cause] = {n: share_in_span(change, s, rest) for n, s in known.items() if n in alike and n not in equal}
    return Lookalikes(fit, correlations, shares)


def _slopes_beside(effect: Effect, fit: CandidateFit, comparison: Comparison, at: LocalJacobian) -> NDArray[np.float32]:
    """Derivatives of the residuals, beside a fit, by an effect that the fit doesn't have."""
    return effect_jacobian(effect, {**fit.values, effect.id: identity_values(effect)}, comparison, at.residual)


def with_rivals(context: SearchContext, result: SearchResult) -> SearchResult:
    """The result with look-alikes, and with fits in which another effect in place of a cause predicts the same.

    Such a fit is a rival if the held-out captures don't exclude it, by the Δχ² that a cause must gain. Effects that the
    search has fitted in the cause's place aren't tried again. Effects that can't be seen in these captures are rivals
    of another kind: with one plane, a stage that leans is the same as a camera that is displaced. Nothing is tried
    where the causes explain too little to have rivals.
    """
    decision = decide(result, context.equivalents, context.config.verdict)
    if decision.verdict not in (Verdict.EXPLAINED, Verdict.AMBIGUOUS):
        return result
    alike = find_lookalikes(context, result.best.fit)
    wide = replace(context, effects=context.effects | context.unseen)
    jobs = [
        partial(_fit_over_range, wide, result.best.fit.without(cause).values, name, [])
        for cause in result.best.causes
        for name in _possible_rivals(context, result, alike, cause)
    ]
    limit = result.best.chi2_per_pixel + _excluding_delta(context, result) / result.pixel_count
    fits = [
        fit
        for fit in context.run_parallel(jobs)
        if score_on_held_out(fit, result.comparison, result.tolerant_comparison).chi2_per_pixel < limit
    ]
    unseen = tuple(fit for fit in fits if not context.unseen.keys().isdisjoint(fit.causes))
    if len(fits) > len(unseen):
        seen = [fit for fit in fits if fit not in unseen]
        result = rank_on_held_out(context, [*(c.fit for c in result.candidates), *seen])
    return replace(result, lookalikes=alike, unseen_rivals=unseen)


def _possible_rivals(context: SearchContext, result: SearchResult, alike: Lookalikes, cause: str) -> list[str]:
    """Effects that may imitate a cause of the best candidate, the most alike first."""
    best = result.best
    searched = {frozenset(c.causes) for c in result.candidates}
    others = frozenset(best.causes) - {cause}
    without = score_on_held_out(best.fit.without(cause), result.comparison, result.tolerant_comparison)
    change = (without.chi2_per_pixel - best.chi2_per_pixel) * result.pixel_count
    nearly_all = max(1.0 - _TRIED_DELTA_FACTOR * _excluding_delta(context, result) / max(change, 1e-9), 0.0)
    shares = alike.shares[cause]
    likely = [
        name
        for name in sorted(shares, key=lambda name: -shares[name])
        if shares[name] > min(_TRIED_SHARE, nearly_all) and others | {name} not in searched
    ]
    return likely[:_TRIED_FOR_EACH]


def _excluding_delta(context: SearchContext, result: SearchResult) -> float:
    """The Δχ² on held-out captures from the best explanation, beyond which another explanation is excluded."""
    return context.config.verdict.min_delta_chi2 * max(1.0, result.best.chi2_per_pixel)


def prefer_fewer_numbers(context: SearchContext, result: SearchResult) -> SearchResult:
    """The result with fits in which an effect of fewer numbers, equal or alike, replaces a cause of the best candidate.

    Ranked with the others, such a fit comes first if it explains the held-out captures as well.
    """
    best = result.best
    jobs = [
        partial(_fit_over_range, context, best.fit.without(cause).values, simple, _first_values(result, simple))
        for cause in best.causes
        for simple in sorted(_simpler_names(context, cause))
        if simple not in best.causes
    ]
    if not jobs:
        return result
    return rank_on_held_out(context, [*context.run_parallel(jobs), *(c.fit for c in result.candidates)])


def wider_names(context: SearchContext, decision: Decision) -> list[tuple[str, ...]]:
    """The named causes, each time with one replaced by the same physics in more numbers, which contain it."""
    causes = decision.best.causes if decision.best else ()
    return [
        tuple(wide if name == cause else name for name in causes)
        for cause in causes
        for wide in sorted(context.equivalents.get(cause, ()))
        if number_count(context.effects[wide]) > number_count(context.effects[cause])
    ]


def _simpler_names(context: SearchContext, cause: str) -> set[str]:
    """Effects of fewer numbers that are the same physics as a cause, or that the cause tends to imitate."""
    names = {*context.equivalents.get(cause, ()), *context.effects[cause].degenerate_limit} & context.effects.keys()
    return {name for name in names if number_count(context.effects[name]) < number_count(context.effects[cause])}


def _first_values(result: SearchResult, name: str) -> list[dict[str, float]]:
    """The values of an effect in the best candidate that has it."""
    return [c.fit.values[name] for c in result.candidates if name in c.fit.values][:1]


def _fit_over_range(
    context: SearchContext, base: FittedValues, name: str, starts: list[dict[str, float]]
) -> CandidateFit:
    """Fits of an effect on top of a base: over its range and from other starts, then of all causes together."""
    return refine_fit(context, fit_over_range(context, base, context.effects[name], starts))
