"""Forward selection: the cause, or the causes together, that predict held-out captures best.

Every effect is screened on the smoothest captures. The best few are refined on more captures, first with weights that
tolerate errors of the model, then with weights of the noise, and ranked with frozen weights on captures that no fit has
used. While much stays unexplained, each of the best is taken as a base, and every effect is tried on top of it; a cause
that the others make superfluous is dropped. Once the budget of fields is spent, nothing further is begun.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import partial

import numpy as np

from holoview.bench.diagnose.capture_split import spread_over_wavelengths
from holoview.bench.diagnose.fit import FIT_ITERATIONS, CandidateFit, cost_or_inf, free_parameters_of, local_fit
from holoview.bench.diagnose.judge import (
    FLOOR_CHI2,
    NEAR_CHI2,
    HeldOutScore,
    SearchResult,
    Verdict,
    decide,
    first_per_cause_set,
    jitter_excess,
    rank_on_held_out,
    score_on_held_out,
)
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.nuisances import (
    detect_nuisances,
    excuse_laser_drift,
    may_be_samples,
    samples_that_explain,
)
from holoview.bench.diagnose.power_law import changes_only_power
from holoview.bench.diagnose.refine import (
    SETTLED_SHARE,
    RefinementQueue,
    explains_everything,
    fit_to_the_end,
    free_fine_parameters,
    is_at_floor,
    is_settled,
    refine_fit,
    refine_leaders_along_axes,
)
from holoview.bench.diagnose.rivals import prefer_fewer_numbers, with_rivals
from holoview.bench.diagnose.screening import (
    COSTLY_FIELDS,
    SCAN_CAPTURES,
    changes_light,
    field_count,
    fit_over_range,
    is_dear,
    largest_field_count,
    screen_effects,
    usual_budget,
    without_costly_fits,
)
from holoview.bench.diagnose.search_context import SearchContext, SearchEnded
from holoview.bench.diagnose.starts.stuck import is_stuck_effect
from holoview.light.model.effects.effect import Effect
from holoview.util.progress import ProgressCallback

_SHORT_LIST = 3  # [fits] The best of a screening are refined. Evidence: the search study.
_CLOSE_FITS = 2  # [fits] Refined beyond these where they are close. Evidence: the search study.
_CLOSE_COST = 1.3  # [1] Close: less than so many times the best cost. Evidence: the search study.
_AS_GOOD_COST = 1.05  # [1] Of one batch, fits below so many times the best cost are refined at once.
_NUMBER_COST = 0.01
"""[1] Of a base's cost in smooth captures, for each of its numbers. Evidence: derivation: a number fits a share of a
hundredth of the error in a hundred speckles. Measured: 16 numbers of an aberration left 0.95 of what an iris left,
which was one of the two causes.
"""
_JOINT_FITS = 3  # [fits] Joint fits of a base and one more cause after each stage of a screening.
_REFINED_JOINT_FITS = 2  # [fits] The best of these are refined.
_BASE_EXCESS_FACTOR = 2.0
"""[1] Of the best candidate's excess, up to which others are bases, where there are several causes. Evidence: measured:
beside a gap, a blur with stray light left 14 and 11, and with a black level, first in smooth captures, 105 and 39."""
_MAX_CAUSES = 3
"""[causes] At most so many are named. Evidence: the search study named pairs only; more: none recorded."""
_MAX_CAUSES_BEYOND_MIDDLE = 2
"""[causes] Up to so many, further ones are searched in whole pictures beside those of a corrected middle, unless the
search is thorough. Evidence: measured: with 1024 × 768 modulator pixels a field takes a second, and the derivatives by
all effects that vary over the field took minutes; the middle shows most causes."""
_PROMISING_SHARE = 0.5
"""[1] A second cause is tried before ranges are scanned, if the best cause leaves less than this share of the nominal
excess, on held-out or on smooth captures; no ranges are scanned for a further cause that leaves less than this share of
the cost. Evidence: beside a cause that was found near the nominal bench, the other cause is mostly near too, and scans
take half of a minute. Smooth captures count by themselves because a cause may show in them alone: beside light
of the other polarisation, the true angle of a stage explained six tenths of the excess in smooth captures, and nothing
in rough captures."""
_ALIKE_SHARE = 0.25
"""[1] Effects that each leave less than this share of the nominal excess change the pictures alike. Evidence:
derivation: the change by either is at most 30° from the residual, so that their correlation is 0.5 or more."""
_TOLD_SHARE = 0.3
"""[1] A cause that leaves less than this share of the cost is told before all effects are screened. Evidence: measured:
beside a gap, a displaced modulator left 0.15, and a displaced camera, which takes a part of the same change, 0.49."""
_SUPERFLUOUS_COST = 2.0
"""[1] The best candidate without one of its causes is refined only if its fit to coarse captures costs less than so
many times the candidate's. Evidence: derivation: fewer causes come first within a tenth of the excess."""
_JOINT_PREDICTIONS = 200
"""[captures] Predicted in a joint fit of two costly causes, whose fields multiply; the budget must have so many left.
Evidence: derivation: 4 coarse captures in 4 iterations of 3 predictions, then 8 fine ones in 6. A bandwidth beside a
flicker (66 fields a capture) fits into the budget, an extended source beside either (600 and more) doesn't."""
_JOINT_SHARE = 0.5
"""[1] Of the usual budget of fields, which a joint fit of many causes may take, one in place of another. Evidence:
measured: beside 46 numbers of a beam, a wavefront and stuck pixels, two fits of an extended source took nine budgets,
or ten minutes."""
_JOINT_NO_SCAN_CHI2 = 2.0
"""[χ²/n] A joint fit that reaches this on coarse captures ends the screening for a further cause; as
`screening._NO_SCAN_CHI2`."""
_WORTHWHILE_COST = 0.7
"""[1] A further cause that leaves less than this share of the base's excess is fitted jointly at once. Evidence: weak
fringes beside a bandwidth left nothing of an excess of 0.23; judged by the cost, they came twenty thousand fields
later."""
MAX_FURTHER_EXCESS_SHARE = 0.8  # [1] A further cause must leave less than this share of the excess.
_RERANKED = 3  # [candidates] Refined again once nuisances are known.
_RERANKED_EXCESS_FACTOR = 4.0  # [1] They have an excess below this factor times the best, plus `_RERANKED_EXCESS`.
_RERANKED_EXCESS = 0.1  # [χ²/n]
_EXPLAINED = (Verdict.EXPLAINED, Verdict.AMBIGUOUS)


class Beside(Enum):
    """The effects that a further search looks for beside the causes of an earlier one."""

    NOTHING = auto()
    OVER_FIELD = auto()  # that vary over the field
    AFFORDABLE = auto()  # these, and effects whose search takes few fields


class Until(Enum):
    """How much a further search has to find, unless it is thorough."""

    EXPLAINED = auto()  # causes that explain the captures, where every effect was searched before
    AT_FLOOR = auto()  # a fit at the floor; once it explains the captures, effects of many fields aren't tried


class Refit(Enum):
    """Whether the causes of an earlier search are fitted again, to the pictures of a further one."""

    ALWAYS = auto()
    OF_ALL_NUMBERS = auto()  # always, with their secondary parameters
    UNLESS_EXPLAINED = auto()  # where they don't explain these pictures, or the search is thorough
    NEVER = auto()  # unless the search is thorough


@dataclass(frozen=True)
class Policy:
    """How a search goes on from the causes of an earlier one. beside: the effects that it looks for. until: how much it
    has to find. refit: whether it fits those causes again. more: how many causes are added where these leave something,
    though they be many already. share: of the excess, below which a further cause has to leave.
    """

    beside: Beside
    until: Until
    refit: Refit = Refit.ALWAYS
    more: int = 0
    share: float = MAX_FURTHER_EXCESS_SHARE


@dataclass(frozen=True)
class InitialCandidates:
    """The causes that an earlier search suggests for a further one, the best first, then its rivals."""

    fits: tuple[CandidateFit, ...]
    policy: Policy


def find_causes(context: SearchContext, progress: ProgressCallback) -> tuple[SearchContext, SearchResult]:
    """The context with the nuisances found, and the candidates ranked with them, rivals among them.

    No search is begun where movements of the camera alone explain the captures, or where samples may.
    """
    context = detect_nuisances(context, {})
    nothing = rank_on_held_out(context, [])
    if (context.has_camera_jitter and _is_consistent(context, nothing)) or may_be_samples(
        context, nothing.nominal.excess, nothing.pixel_count
    ):
        return context, nothing
    result = select_causes(context, _visible_effects(context), progress)
    if result.better_sampling is not None:
        return context, result
    result = fit_to_the_end(context, prefer_fewer_numbers(context, result))
    settled = detect_nuisances(context, result.best.fit.values)
    if settled is not context:
        result = fit_to_the_end(settled, _ranked_again(settled, result))
    return settled, with_rivals(settled, result)


def _ranked_again(settled: SearchContext, result: SearchResult) -> SearchResult:
    """The best candidates refined and ranked once more, with the nuisances that the best of them has shown."""
    max_excess = _RERANKED_EXCESS_FACTOR * result.best.excess + _RERANKED_EXCESS
    near = [c.fit for c in result.candidates[:_RERANKED] if c.excess < max_excess]
    return rank_on_held_out(settled, settled.run_parallel(partial(refine_fit, settled, f) for f in near))


def refine_candidates(context: SearchContext, initial: InitialCandidates, progress: ProgressCallback) -> SearchResult:
    """The causes that an earlier search suggests, fitted to the captures of another context, and others beside them, as
    the policy says."""
    nothing = rank_on_held_out(context, [])
    if context.has_camera_jitter and _is_consistent(context, nothing):
        return nothing
    fits, policy, is_limited = initial.fits, initial.policy, math.isfinite(context.field_budget)
    further = _effects_beside(context, policy.beside)
    progress(0, 1, "causes of the first search")
    result = rank_on_held_out(context, fits)
    stands = policy.refit is Refit.UNLESS_EXPLAINED and _is_explained(context, result)
    if is_limited and (stands or policy.refit is Refit.NEVER):
        return result
    if fits:
        fine = policy.refit is Refit.OF_ALL_NUMBERS
        refined = context.run_parallel([partial(refine_fit, context, fit, include_fine=fine) for fit in fits])
        result = rank_on_held_out(context, [*refined, *fits])
    elif further and result.nominal.excess > jitter_excess(result.pixel_count):
        result = _search_single_causes(context, further, progress)
    most, is_explained = _MAX_CAUSES, _is_explained(context, result)
    if is_limited and is_explained:
        further = [e for e in further if not is_dear(context, e)]
    if is_limited and policy.until is Until.EXPLAINED:
        most = 0 if is_explained else _MAX_CAUSES_BEYOND_MIDDLE
    if policy.more and not is_explained:
        most = max(most, len(result.best.causes) + policy.more)
    result = _with_further_causes(context, result, further, progress, most, policy.share)
    has_simplest_names = policy.until is Until.EXPLAINED and result.best.causes in [fit.causes for fit in fits]
    if has_simplest_names or result.better_sampling is not None:
        return result
    return prefer_fewer_numbers(context, result)


def _effects_beside(context: SearchContext, beside: Beside) -> list[Effect]:
    """The effects that are searched beside the causes of an earlier search."""
    effects = [] if beside is Beside.NOTHING else _visible_effects(context)
    if len(context.windows) > 1:  # stuck pixels are seen where pictures and patterns are in one piece
        effects = [e for e in effects if not is_stuck_effect(e)]
    return [e for e in effects if e.varies_over_field or (beside is Beside.AFFORDABLE and not is_dear(context, e))]


def select_causes(context: SearchContext, effects: Sequence[Effect], progress: ProgressCallback) -> SearchResult:
    """Searches causes until the held-out captures are explained, nothing helps, or there are as many as allowed."""
    single = _search_single_causes(context, effects, progress)
    if single.better_sampling is not None:
        return single
    return _with_further_causes(context, free_fine_parameters(context, single), effects, progress)


def _visible_effects(context: SearchContext) -> list[Effect]:
    """The effects that pictures show; laws of the lasers' power show in the gains alone."""
    return [e for e in context.effects.values() if not changes_only_power(e)]


def _is_explained(context: SearchContext, result: SearchResult) -> bool:
    """Whether the best candidate explains the captures."""
    return decide(result, context.equivalents, context.config.verdict).verdict in _EXPLAINED


def _is_consistent(context: SearchContext, result: SearchResult) -> bool:
    """Whether the nominal bench predicts the captures, perhaps with drifting lasers."""
    decision, _ = excuse_laser_drift(context, result, decide(result, context.equivalents, context.config.verdict))
    return decision.verdict is Verdict.CONSISTENT


def _with_further_causes(
    context: SearchContext,
    result: SearchResult,
    effects: Sequence[Effect],
    progress: ProgressCallback,
    most: int = _MAX_CAUSES,
    share: float = MAX_FURTHER_EXCESS_SHARE,
) -> SearchResult:
    """Causes added one by one, up to `most`, as long as they improve the prediction of held-out captures, each to less
    than a share of the excess, and other samples don't explain what is left.

    A cause that leaves more than that share, but less than `MAX_FURTHER_EXCESS_SHARE`, waits for the next ones: they
    stay once together they leave less than the share to the power of their count. Where two causes take half each,
    neither alone would be named. Where the search has to end meanwhile, the causes count that were accepted.
    """
    accepted = result

    def is_enough(wider: SearchResult) -> bool:
        return _is_better(context, wider, accepted, _share_of(wider, accepted, share))

    try:
        while (number := max(len(result.best.causes), 1) + 1) <= most:  # one may have been dropped
            if is_at_floor(result) or not result.candidates or context.budget_exhausted:
                break
            if may_be_samples(context, result.best.excess, result.pixel_count):
                break
            if better := samples_that_explain(context, result):
                return replace(result, better_sampling=better)
            wider = _search_further_causes(context, result, number, effects, progress)
            if share < MAX_FURTHER_EXCESS_SHARE and number < most and not is_enough(wider):
                wider = _with_two_of_a_round(context, result, wider)
            if share >= MAX_FURTHER_EXCESS_SHARE or is_enough(wider):  # of causes that wait none is dropped
                wider = _drop_superfluous_causes(context, wider)
            may_stay = is_enough(wider)
            if not may_stay and not _is_better(context, wider, result, MAX_FURTHER_EXCESS_SHARE):
                break
            result = free_fine_parameters(context, wider)
            accepted = result if may_stay else accepted
    except SearchEnded:
        so_far = context.best_so_far.result or accepted
        has_more = len(so_far.best.causes) > len(accepted.best.causes)
        if has_more and so_far.best.excess > _share_of(so_far, accepted, share) * accepted.best.excess:
            context.best_so_far.note(accepted)
        raise
    return accepted


def _with_two_of_a_round(context: SearchContext, base: SearchResult, wider: SearchResult) -> SearchResult:
    """The candidates, and both causes together where two candidates add one each to the base, and each leaves less."""
    limit = MAX_FURTHER_EXCESS_SHARE * base.best.excess
    different = first_per_cause_set(wider.candidates)
    alone = [c.fit for c in different if c.causes[:-1] == base.best.causes and c.excess < limit]
    if len(alone) < 2:
        return wider
    (first, second), name = alone[:2], alone[1].causes[-1]
    both = CandidateFit((*first.causes, name), {**first.values, name: second.values[name]}, math.inf)
    joint = [refine_fit(context, fit) for fit in _joint_fits(context, [both])]
    return rank_on_held_out(context, [*joint, *(c.fit for c in wider.candidates)])


def _share_of(wider: SearchResult, accepted: SearchResult, share: float) -> float:
    """The share of the excess below which the causes have to leave that a result adds to those that were accepted."""
    return float(share ** max(len(wider.best.causes) - len(accepted.best.causes), 1))


def _search_single_causes(
    context: SearchContext, effects: Sequence[Effect], progress: ProgressCallback
) -> SearchResult:
    """Single causes. Ends early when one cause explains everything, or when a pair does of which one cause shows near
    the nominal bench."""
    unbiased = context.data_weighted_comparison(context.split.coarse, 0.0)
    near_cost = NEAR_CHI2 * unbiased.pixel_count
    screened: list[CandidateFit] = []
    queue, result = RefinementQueue(context), rank_on_held_out(context, [])
    is_first_round = True
    for batch in screen_effects(context, {}, effects, progress, "one cause"):
        fits = batch.fits
        screened = first_per_cause_set(sorted([*screened, *fits], key=lambda f: f.cost))
        if fits and cost_or_inf(unbiased, fits[0].values) <= near_cost:
            as_good = [f for f in fits[:_SHORT_LIST] if f.cost < _AS_GOOD_COST * fits[0].cost]
            if queue.refine_new(as_good):
                result = rank_on_held_out(context, queue.fits)
            if explains_everything(result):
                return result
        if not batch.ends_round:
            _tell_early(context, fits, screened, queue)
            continue
        queue.refine_new(_short_list(without_costly_fits(context, screened, unbiased)))
        result = rank_on_held_out(context, queue.fits)
        if is_first_round and (better := samples_that_explain(context, result)):
            return replace(result, better_sampling=better)
        if is_first_round and not is_settled(result) and _is_promising(context, result):
            result = _search_second_causes_early(context, result, screened, effects, progress)
            if result.better_sampling is not None:
                return result
            queue.fits += [c.fit for c in result.candidates if len(c.causes) > 1]
        else:
            result = refine_leaders_along_axes(context, result)
        is_first_round = False
        if _is_settled(context, result) or (len(result.best.causes) > 1 and is_at_floor(result)):
            break
    return result


def _is_settled(context: SearchContext, result: SearchResult) -> bool:
    """Whether other causes can't leave much less, or what is left may be of samples."""
    return is_settled(result) or may_be_samples(context, result.best.excess, result.pixel_count)


def _tell_early(
    context: SearchContext, fits: Sequence[CandidateFit], screened: Sequence[CandidateFit], queue: RefinementQueue
) -> None:
    """Tells the best of some new fits, if it is the best of all fits so far and leaves little of the error in smooth
    captures, because screening all effects on large pictures takes a minute.
    """
    if not fits or fits[0] is not screened[0]:
        return
    if fits[0].cost < _TOLD_SHARE * cost_or_inf(_smooth_comparison(context), {}):
        rank_on_held_out(context, [*queue.fits, fits[0]])


def _search_second_causes_early(
    context: SearchContext,
    result: SearchResult,
    screened: Sequence[CandidateFit],
    effects: Sequence[Effect],
    progress: ProgressCallback,
) -> SearchResult:
    """Second causes before ranges are scanned. Single causes are polished before; costly single causes after, since
    a costly cause that can't explain the captures alone gains nothing by polishing, which spends the budget. A costly
    cause near the floor is polished like all others. screened: single causes, the best first.
    """
    if shared := shared_with_costly(context, screened):
        result = rank_on_held_out(context, [*shared, *(c.fit for c in result.candidates)])
    result = refine_leaders_along_axes(context, result, also_costly=False)
    result = free_fine_parameters(context, result, also_costly=False)
    if better := samples_that_explain(context, result):
        return replace(result, better_sampling=better)
    if not is_settled(result) and (costly := with_others_in_place(context, result, effects)):
        result = rank_on_held_out(context, [*costly, *(c.fit for c in result.candidates)])
    if _is_settled(context, result):
        return result
    result = _search_further_causes(context, result, 2, effects, progress)
    is_over = is_at_floor(result) or context.budget_exhausted
    return result if is_over else refine_leaders_along_axes(context, result)


def _is_promising(context: SearchContext, result: SearchResult) -> bool:
    """Whether a candidate explains much of the held-out captures, or of the smooth ones.

    Where a second cause spoils the speckle of rough patterns, the first cause alone explains nothing there.
    """
    share = _PROMISING_SHARE
    if result.best.excess < share * result.nominal.excess:
        return True
    smooth = _smooth_comparison(context)
    costs = [cost_or_inf(smooth, c.fit.values) for c in result.candidates]
    return min(costs, default=math.inf) < share * cost_or_inf(smooth, {})


def _smooth_comparison(context: SearchContext) -> Comparison:
    """The coarse captures, tolerant of the nominal model's error."""
    return context.tolerant_comparison(context.split.coarse, context.relative_model_error({}))


def _search_further_causes(
    context: SearchContext, result: SearchResult, number: int, effects: Sequence[Effect], progress: ProgressCallback
) -> SearchResult:
    """The candidates, with candidates of one cause more than the best. Ends early when a candidate explains nearly
    all."""
    fits = [c.fit for c in result.candidates]
    bases, count, exchanged = [c.fit for c in _bases(context, result, number - 1)], 0, tuple[str, ...]()
    while bases and not context.budget_exhausted and count <= context.config.bases:
        base, count = bases.pop(0), count + 1
        compatible = [e for e in effects if _is_compatible(context, e, base)]
        wider = _with_one_more_cause(context, base, compatible, progress, f"{number} causes")
        fits += context.run_parallel([partial(refine_fit, context, f) for f in wider])
        most_causes_first = first_per_cause_set(sorted(fits, key=lambda f: -len(f.causes)))
        result = refine_leaders_along_axes(context, rank_on_held_out(context, most_causes_first))
        if result.best.causes != exchanged and not is_settled(result):
            exchanged = result.best.causes
            if costly := with_others_in_place(context, result, effects):
                fits += costly
                result = rank_on_held_out(context, [*costly, *(c.fit for c in result.candidates)])
        if explains_everything(result) or is_settled(result):
            break
        bases = _with_exchanged_base(base, result.best.fit) + bases
    return result


def _with_exchanged_base(base: CandidateFit, best: CandidateFit) -> list[CandidateFit]:
    """The cause that the best candidate adds to a base, as a base of its own, since the base's cause may imitate
    another cause."""
    if len(base.causes) != 1 or len(best.causes) != 2 or best.causes[0] != base.causes[0]:
        return []
    return [best.without(base.causes[0])]


def _with_one_more_cause(
    context: SearchContext, base: CandidateFit, effects: Sequence[Effect], progress: ProgressCallback, note: str
) -> list[CandidateFit]:
    """The best joint fits of a base and one more cause; a fit that explains nearly all ends the search."""
    context = with_captures_that_show(context, base)
    unbiased = context.data_weighted_comparison(context.split.coarse, 0.0)
    base_cost, noise = cost_or_inf(unbiased, base.values), float(unbiased.pixel_count)
    best = noise + _WORTHWHILE_COST * (base_cost - noise) if base_cost > noise else _WORTHWHILE_COST * base_cost
    near = noise * _near_chi2(base_cost / noise)
    screened, tried, leaders, joint = (list[CandidateFit]() for _ in range(4))
    for batch in screen_effects(context, base.values, effects, progress, note):
        screened += batch.fits
        if batch.fits and (cost := cost_or_inf(unbiased, batch.fits[0].values)) < best:
            best = cost
            joint = _joint_fits(context, batch.fits[:1])
            if joint[0].cost >= near and (anew := _with_edges_anew(context, joint[0], base)):
                screened += anew
                joint = sorted([*joint, *_joint_fits(context, anew)], key=lambda f: f.cost)
            if joint[0].cost < near:
                return joint
        if not batch.ends_round:
            continue
        best_first = first_per_cause_set(sorted(screened, key=lambda f: f.cost))
        promising = without_costly_fits(context, best_first, unbiased)[:_JOINT_FITS]
        if promising != tried:
            tried, leaders = promising, _joint_fits(context, promising)[:_REFINED_JOINT_FITS]
        joint = leaders
        enough = max(_JOINT_NO_SCAN_CHI2 * noise, _PROMISING_SHARE * base_cost)
        settled = joint and joint[0].cost < enough
        if context.budget_exhausted or settled:
            break
    return joint


def with_captures_that_show(context: SearchContext, base: CandidateFit) -> SearchContext:
    """The context in which a further cause is screened on the roughest captures, if a base leaves nothing in the
    smoothest ones: there every effect would explain the rest."""
    split = context.split
    smooth = context.data_weighted_comparison(split.coarse, 0.0)
    roughest = split.rough[~np.isin(split.rough, split.fine)]
    if not len(roughest) or cost_or_inf(smooth, base.values) > FLOOR_CHI2 * smooth.pixel_count:
        return context
    return replace(context, split=replace(split, coarse=roughest))


def _with_edges_anew(context: SearchContext, fit: CandidateFit, base: CandidateFit) -> list[CandidateFit]:
    """Fits in which a stop among the base's causes is searched over its range once more, beside the other causes.

    Without these, it was taken for another stop: edges have many minima, in which joint fits stay.
    """
    stops = [name for name in base.causes if any(p.non_smooth for p in context.effects[name].parameters)]
    jobs = [
        partial(fit_over_range, context, fit.without(name).values, context.effects[name], [fit.values[name]])
        for name in stops
    ]
    return context.run_parallel(jobs)


def _near_chi2(base_chi2: float) -> float:
    """χ²/n of smooth captures below which a further cause leaves nearly nothing. base_chi2: χ²/n of its base."""
    least = FLOOR_CHI2 - 1
    return 1 + min(NEAR_CHI2 - 1, max(least, SETTLED_SHARE * (base_chi2 - 1)))


def _joint_fits(context: SearchContext, fits: Sequence[CandidateFit]) -> list[CandidateFit]:
    """Joint fits of base and addition on the coarse captures, the best first."""
    coarse, jobs = context.split.coarse, []
    for fit in fits:
        comparison = context.tolerant_comparison(coarse, context.relative_model_error(fit.values))
        effects = [context.effects[name] for name in fit.causes]
        jobs.append(partial(local_fit, effects, fit.values, comparison))
    unbiased = context.data_weighted_comparison(coarse, 0.0)
    joint = context.run_parallel(jobs)
    return sorted((replace(f, cost=cost_or_inf(unbiased, f.values)) for f in joint), key=lambda f: f.cost)


def shared_with_costly(context: SearchContext, screened: Sequence[CandidateFit]) -> list[CandidateFit]:
    """Refined fits of the best simple cause together with an effect of many fields that changes the pictures alike.

    screened: single causes, the best first. Where a blur of the camera and an extended source act together, either
    alone is fitted too large, and beside it the other has nothing left to explain. A joint fit is followed up only if
    it leaves nearly nothing.
    """
    costly = [f for f in screened if field_count(context, f.values) >= COSTLY_FIELDS]
    simple = next((f for f in screened if f not in costly), None)
    if simple is None or not costly or context.budget_exhausted:
        return []
    unbiased = context.data_weighted_comparison(context.split.coarse, 0.0)
    nominal, alone = (cost_or_inf(unbiased, values) - unbiased.pixel_count for values in ({}, simple.values))
    limit = unbiased.pixel_count + _ALIKE_SHARE * nominal
    alike = [f for f in costly if cost_or_inf(unbiased, f.values) < limit] if alone < _ALIKE_SHARE * nominal else []
    shared = context.run_parallel([partial(_fit_from_middle, context, simple, f) for f in alike])
    most = unbiased.pixel_count + min((NEAR_CHI2 - 1) * unbiased.pixel_count, _WORTHWHILE_COST * alone)
    near = [f for f in shared if cost_or_inf(unbiased, f.values) < most]
    return context.run_parallel([partial(refine_fit, context, f) for f in near])


def _fit_from_middle(context: SearchContext, a: CandidateFit, b: CandidateFit) -> CandidateFit:
    """A joint fit, on a few captures, of two causes that were fitted alone.

    If both change the pictures alike, their true values lie near the line from the one alone to the other alone, and
    the fit begins in its middle.
    """
    few = spread_over_wavelengths(context.data.captures, context.split.coarse, SCAN_CAPTURES)
    comparison = context.tolerant_comparison(few, context.relative_model_error(a.values))
    effects, values = [context.effects[name] for name in (*a.causes, *b.causes)], {**a.values, **b.values}
    free = free_parameters_of(effects, values)
    middle = 0.5 * (free.pack(a.values) + free.pack(b.values))
    return local_fit(effects, free.unpack(middle, values), comparison)


def with_others_in_place(context: SearchContext, result: SearchResult, effects: Sequence[Effect]) -> list[CandidateFit]:
    """Refined fits in which another effect stands in place of one cause of the best candidate.

    Simple effects come first in every screening, and imitate costly effects: a blur of the camera stands for an
    extended source, even more so while the distance is wrong. So each effect of many fields is tried beside the other
    causes. In place of a single cause, and once the budget is spent, only such as take a small part of it are tried. Of
    more causes than are searched from nothing only the one that was added last is replaced, by effects of the camera
    first, which need no further fields: of these the screening ended at the first that came near in smooth captures.
    Unless the search is thorough, a joint fit of so many takes no large part of the usual budget.
    """
    best = next((c for c in result.candidates if _is_like_best(context, c, result)), result.best).fit
    is_alone, are_many = len(best.causes) < 2, len(best.causes) > _MAX_CAUSES
    if not best.causes or context.screening_exhausted:
        return []
    if is_alone and field_count(context, best.values) >= COSTLY_FIELDS:
        return []  # no simple effect that imitates them
    others = [e for e in effects if e.id not in best.causes]
    costly = [e for e in others if largest_field_count(context, e) >= COSTLY_FIELDS]
    if context.budget_exhausted or is_alone:
        costly = [e for e in costly if not is_dear(context, e)]
    if not are_many:
        return _in_place(context, best, best.causes, costly)
    simple, last = [e for e in others if not changes_light(e)], best.causes[-1:]
    most = _JOINT_SHARE * usual_budget(context) if math.isfinite(context.field_budget) else math.inf
    return _in_place(context, best, last, simple) or _in_place(context, best, last, costly, most)


def _in_place(
    context: SearchContext,
    best: CandidateFit,
    replaced: Sequence[str],
    effects: Sequence[Effect],
    most_fields: float = math.inf,
) -> list[CandidateFit]:
    """Refined fits in which one of the effects stands in place of one of the causes to be replaced.

    It is followed up only if it leaves clearly less, and if a joint fit takes fewer than `most_fields`.
    """
    jobs = [
        partial(fit_over_range, context, others.values, effect, [])
        for others in map(best.without, replaced)
        for effect in effects
        if _is_compatible(context, effect, others)
    ]
    unbiased = context.data_weighted_comparison(context.split.coarse, 0.0)
    noise = unbiased.pixel_count
    limit = noise + _WORTHWHILE_COST * (cost_or_inf(unbiased, best.values) - noise)
    fits = [f for f in context.run_parallel(jobs) if cost_or_inf(unbiased, f.values) < limit]
    joint = _joint_fits(context, [f for f in fits if _joint_fields(context, f) < most_fields])
    return context.run_parallel([partial(refine_fit, context, f) for f in joint[:_REFINED_JOINT_FITS]])


def _joint_fields(context: SearchContext, fit: CandidateFit) -> float:
    """Fields that a joint fit of all causes takes: a prediction of each capture for each number and iteration."""
    numbers = len(free_parameters_of([context.effects[name] for name in fit.causes], fit.values))
    return FIT_ITERATIONS * (1 + numbers) * len(context.split.coarse) * field_count(context, fit.values)


def _is_like_best(context: SearchContext, score: HeldOutScore, result: SearchResult) -> bool:
    """Whether a candidate is the best, or names the same physics in fewer numbers and explains about as much."""
    return len(score.causes) == len(result.best.causes) and not _has_shorter_name(context, score, result)


def _short_list(fits: list[CandidateFit]) -> list[CandidateFit]:
    """The best of sorted fits, and a few that are close to the best."""
    if not fits:
        return []
    close = [f for f in fits[_SHORT_LIST:] if f.cost < _CLOSE_COST * fits[0].cost]
    return fits[:_SHORT_LIST] + close[:_CLOSE_FITS]


def _bases(context: SearchContext, result: SearchResult, causes: int) -> list[HeldOutScore]:
    """The bases of further causes: the best candidates with so many causes. Far from the floor, smooth captures order
    them, because rough captures favour every loss of contrast, but of several causes only such as leave not much more
    than the best. Of two names for the same physics, only the name of fewer numbers is a base. Many numbers lower the
    cost whatever is wrong.
    """
    count, limit = (context.config.bases, math.inf) if causes == 1 else (1, _BASE_EXCESS_FACTOR * result.best.excess)
    alike = [c for c in result.candidates if len(c.causes) == causes and c.excess <= limit]
    same = [c for c in alike if not _has_shorter_name(context, c, replace(result, candidates=tuple(alike)))]
    if result.best.chi2_per_pixel > NEAR_CHI2:
        smooth = _smooth_comparison(context)
        same.sort(key=lambda c: cost_or_inf(smooth, c.fit.values) * (1 + _NUMBER_COST * c.fit.parameter_count))
    affordable = without_costly_fits(context, [c.fit for c in same], result.tolerant_comparison)
    chosen = {id(f) for f in affordable}
    return [c for c in same if id(c.fit) in chosen][:count] or [result.best]


def _has_shorter_name(context: SearchContext, score: HeldOutScore, result: SearchResult) -> bool:
    """Whether a name of fewer numbers for the same physics explains about as much: fits on top of it are faster."""
    limit = _AS_GOOD_COST * score.tolerant_chi2
    return any(
        other.fit.parameter_count < score.fit.parameter_count
        and other.tolerant_chi2 < limit
        and len(other.causes) == len(score.causes)
        and all(name in score.causes or context.equivalents[name] & {*score.causes} for name in other.causes)
        for other in result.candidates
    )


def _is_better(context: SearchContext, new: SearchResult, old: SearchResult, share: float) -> bool:
    before = score_on_held_out(old.best.fit, new.comparison, new.tolerant_comparison)
    gained = (before.chi2_per_pixel - new.best.chi2_per_pixel) * new.pixel_count
    max_excess = share * before.excess
    return gained > context.config.verdict.min_delta_chi2 and new.best.excess < max_excess


def _drop_superfluous_causes(context: SearchContext, result: SearchResult) -> SearchResult:
    """The candidates, and fits of the best candidate without one of its causes. A fit that leaves much more in smooth
    captures than all causes together isn't refined: it can't come first.
    """
    best = result.best
    if len(best.causes) < 2:
        return result
    fewer = _joint_fits(context, [best.fit.without(name) for name in best.causes])
    unbiased = context.data_weighted_comparison(context.split.coarse, 0.0)
    limit = _SUPERFLUOUS_COST * max(cost_or_inf(unbiased, best.fit.values), unbiased.pixel_count)
    refits = context.run_parallel([partial(refine_fit, context, fit) for fit in fewer if fit.cost < limit])
    return rank_on_held_out(context, [*(c.fit for c in result.candidates), *refits]) if refits else result


def _is_compatible(context: SearchContext, effect: Effect, base: CandidateFit) -> bool:
    """Whether an effect isn't among the base's causes, and the budget allows a joint fit where both are costly."""
    if any(name == effect.id or name in context.equivalents.get(effect.id, ()) for name in base.causes):
        return False
    fields = field_count(context, base.values), largest_field_count(context, effect)
    return min(fields) < COSTLY_FIELDS or _JOINT_PREDICTIONS * math.prod(fields) < context.fields_left
