"""Forward selection: the cause, or the causes together, that predict held-out captures best.

Coarse to fine. Every effect is screened on the smoothest captures; the best few are fitted on more of them, first with
weights that forgive what is still wrong, then with the noise alone; all are judged on captures that no fit has seen,
with weights that are frozen. While much stays unexplained, each of the best is taken as a base and everything is tried
on top of it; a cause that the others turn out to do without is dropped again. Once a bench has computed its share of
fields, nothing further is begun.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from holoview.diagnose.effect_fit import CandidateFit, cost_or_inf, local_fit
from holoview.diagnose.field_count import (
    MANY,
    VERY_MANY,
    incoherent_field_count,
    is_costly,
    max_field_count,
    without_costly_fits,
)
from holoview.diagnose.held_out_ranking import (
    ALARM,
    NEARLY,
    HeldOutScore,
    SearchResult,
    first_per_cause_set,
    rank_on_held_out,
    score_on_held_out,
)
from holoview.diagnose.refine import RefinementQueue, refine_along_axes, refine_fit
from holoview.diagnose.screening import relative_model_error, screen_effects
from holoview.diagnose.search_context import SearchContext
from holoview.model.effects.effect import Effect
from holoview.util.progress import ProgressCallback

_SHORT_LIST, _CLOSE_SECONDS, _CLOSE = 3, 2, 1.3
_BASES, _SECONDS, _MOST_CAUSES = 3, 3, 3
FLOOR = 1.05  # χ²/n at which nothing worth a further cause is left
_REFINED, _ALONG = 2, 2
_NEARBY, _HARDLY = 0.2, 0.02  # r.m.s. residual: of the nominal bench's; over mean light
_HELPS = 0.9  # of the nominal excess: what leaves more explains nothing
_AS_GOOD = 1.05  # cost that is as good as another on coarse captures
_SETTLED, _SETTLED_SHARE = 0.1, 0.05  # χ²/n − 1, and of the nominal one: so close, scans over ranges bring nothing
_NO_SCAN = 2.0  # χ²/n of two causes on coarse captures, likewise
_WORTHWHILE = 0.7  # of a base's cost: with less left, base and addition are fitted together at once
_EARLY = 1.02  # a single cause that reaches this on held-out captures ends the search


def select_causes(context: SearchContext, effects: Sequence[Effect], progress: ProgressCallback) -> SearchResult:
    """Searches causes until the held-out captures are explained, nothing helps, or there are three."""
    selection = _refine_fine_parameters(context, _search_single_causes(context, effects, progress))
    for number in range(2, _MOST_CAUSES + 1):
        if _is_done(context, selection):
            break
        wider = _drop_superfluous_causes(context, _search_further_causes(context, selection, number, effects, progress))
        if not _is_better(wider, selection):
            break
        selection = _refine_fine_parameters(context, wider)
    return selection


def _search_single_causes(
    context: SearchContext, effects: Sequence[Effect], progress: ProgressCallback
) -> SearchResult:
    """Single causes; ends early when one explains everything."""
    blind = context.data_weighted_comparison(context.split.coarse, 0.0)
    trials: list[CandidateFit] = []
    found, selection = RefinementQueue(context), rank_on_held_out(context, [])
    for stage in screen_effects(context, {}, effects, progress, "one cause"):
        for batch in stage:
            trials = first_per_cause_set(sorted([*trials, *batch], key=lambda t: t.cost))
            if not batch or cost_or_inf(blind, batch[0].values) > NEARLY * blind.pixel_count:
                continue
            if found.refine_new([t for t in batch[:_SHORT_LIST] if t.cost < _AS_GOOD * batch[0].cost]):
                selection = rank_on_held_out(context, found.fits)
            if selection.best.chi2_per_pixel < _EARLY:
                return selection
        found.refine_new(_short_list(without_costly_fits(context, trials, blind)))
        selection = _refine_leaders_along_axes(context, rank_on_held_out(context, found.fits))
        if selection.best.excess < min(_SETTLED, _SETTLED_SHARE * selection.nominal.excess):
            break
    return selection


def _search_further_causes(
    context: SearchContext, selection: SearchResult, number: int, effects: Sequence[Effect], progress: ProgressCallback
) -> SearchResult:
    """The candidates, and such with one cause more than the best ones; ends early when one explains everything."""
    known = [c.fit for c in selection.candidates]
    for base in _bases(context, selection, number - 1):
        if context.budget_exhausted:
            break
        rest = [e for e in effects if _is_compatible(context, e, base.fit)]
        wider = _with_one_more_cause(context, base.fit, rest, progress, f"{number} causes")
        known += context.run_parallel([partial(refine_fit, context, t) for t in wider])
        selection = _refine_leaders_along_axes(
            context, rank_on_held_out(context, first_per_cause_set(sorted(known, key=lambda t: -len(t.causes))))
        )
        if selection.best.chi2_per_pixel < _EARLY:
            break
    return selection


def _with_one_more_cause(
    context: SearchContext, base: CandidateFit, effects: Sequence[Effect], progress: ProgressCallback, note: str
) -> list[CandidateFit]:
    """The best with one cause more than a base, fitted together; the first that nearly explains all ends the search."""
    blind = context.data_weighted_comparison(context.split.coarse, 0.0)
    best, screened, joint = _WORTHWHILE * cost_or_inf(blind, base.values), list[CandidateFit](), list[CandidateFit]()
    for stage in screen_effects(context, base.values, effects, progress, note):
        for batch in stage:
            screened += batch
            if batch and (cost := cost_or_inf(blind, batch[0].values)) < best:
                best = cost
                joint = _joint_fits(context, batch[:1])
                if joint[0].cost < NEARLY * blind.pixel_count:
                    return joint
        best_first = first_per_cause_set(sorted(screened, key=lambda t: t.cost))
        joint = _joint_fits(context, without_costly_fits(context, best_first, blind)[:_SECONDS])[:_REFINED]
        if context.budget_exhausted or (joint and joint[0].cost < _NO_SCAN * blind.pixel_count):
            break
    return joint


def _joint_fits(context: SearchContext, fits: Sequence[CandidateFit]) -> list[CandidateFit]:
    """Joint fits of base and addition on the coarse captures."""
    jobs = []
    for trial in fits:
        comparison = context.data_weighted_comparison(
            context.split.coarse, min(relative_model_error(context, trial.values), 1.0)
        )
        effects = [context.effects[name] for name in trial.causes]
        jobs.append(partial(local_fit, effects, trial.values, comparison))
    blind = context.data_weighted_comparison(context.split.coarse, 0.0)
    fits = context.run_parallel(jobs)
    return sorted((replace(t, cost=cost_or_inf(blind, t.values)) for t in fits), key=lambda t: t.cost)


def _short_list(fits: list[CandidateFit]) -> list[CandidateFit]:
    if not fits:
        return []
    close = [t for t in fits[_SHORT_LIST:] if t.cost < _CLOSE * fits[0].cost]
    return fits[:_SHORT_LIST] + close[:_CLOSE_SECONDS]


def _refine_fine_parameters(context: SearchContext, selection: SearchResult) -> SearchResult:
    """The best candidate with its fine parameters freed, where it is near but not at the floor, and they help."""
    best = selection.best
    effects = [context.effects[name] for name in best.causes]
    if (
        best.chi2_per_pixel < _EARLY
        or not any(p.fine for e in effects for p in e.parameters)
        or not _is_near(context, best.fit)
    ):
        return selection
    freed = refine_fit(context, best.fit, include_fine=True)
    again = score_on_held_out(freed, selection.comparison, selection.tolerant_comparison)
    if (best.chi2_per_pixel - again.chi2_per_pixel) * selection.pixel_count < ALARM or again.excess > 0.9 * best.excess:
        return selection
    return rank_on_held_out(context, [freed, *(c.fit for c in selection.candidates[1:])])


def _refine_leaders_along_axes(context: SearchContext, selection: SearchResult) -> SearchResult:
    """The best candidates looked for along their axes, twice, where they stopped short of the floor, but not far off.

    What is far off lacks a cause: the best values of what it has would be others with it.
    """
    for _ in range(2):
        if selection.best.chi2_per_pixel < FLOOR:
            break
        some = [c.fit for c in selection.candidates[:_ALONG] if c.excess < _HELPS * selection.nominal.excess]
        leaders = [t for t in some if incoherent_field_count(context, t.values) < VERY_MANY and _is_near(context, t)]
        if not leaders:
            break
        closer = context.run_parallel([partial(refine_along_axes, context, t) for t in leaders])
        better = [new for new, old in zip(closer, leaders, strict=True) if new.values != old.values]
        if not better:
            break
        selection = rank_on_held_out(context, [*better, *(c.fit for c in selection.candidates)])
    return selection


def _is_near(context: SearchContext, fit: CandidateFit) -> bool:
    """Whether a trial leaves hardly anything, or a small part of what the nominal bench does."""
    return relative_model_error(context, fit.values) < max(_HARDLY, _NEARBY * relative_model_error(context, {}))


def _is_done(context: SearchContext, selection: SearchResult) -> bool:
    return selection.best.chi2_per_pixel < FLOOR or not selection.candidates or context.budget_exhausted


def _bases(context: SearchContext, selection: SearchResult, causes: int) -> list[HeldOutScore]:
    """What to build on: the best candidates with so many causes.

    Far from the floor smooth captures tell them apart better: rough ones favour whatever loses contrast.
    """
    most = _BASES if causes == 1 else 1
    same = [c for c in selection.candidates if len(c.causes) == causes]
    if selection.best.chi2_per_pixel > NEARLY:
        smooth = context.data_weighted_comparison(context.split.coarse, min(relative_model_error(context, {}), 1.0))
        same.sort(key=lambda c: cost_or_inf(smooth, c.fit.values))
    few = {id(t) for t in without_costly_fits(context, [c.fit for c in same], selection.tolerant_comparison)}
    return [c for c in same if id(c.fit) in few][:most] or [selection.best]


def _is_better(new: SearchResult, old: SearchResult) -> bool:
    before = score_on_held_out(old.best.fit, new.comparison, new.tolerant_comparison)
    return (
        before.chi2_per_pixel - new.best.chi2_per_pixel
    ) * new.pixel_count > ALARM and new.best.excess < 0.8 * before.excess


def _drop_superfluous_causes(context: SearchContext, selection: SearchResult) -> SearchResult:
    """Without causes that the best candidate's others do without: from its values a fit may find what it missed."""
    best = selection.best
    if len(best.causes) < 2:
        return selection
    refits = context.run_parallel([partial(refine_fit, context, best.fit.without(name)) for name in best.causes])
    return rank_on_held_out(context, [*(c.fit for c in selection.candidates), *refits])


def _is_compatible(context: SearchContext, effect: Effect, base: CandidateFit) -> bool:
    """Whether it is another cause than those that are in, and doesn't multiply many fields by many."""
    if any(name == effect.id or name in context.equivalents.get(effect.id, ()) for name in base.causes):
        return False
    return not (is_costly(context, base) and max_field_count(context, effect) >= MANY)
