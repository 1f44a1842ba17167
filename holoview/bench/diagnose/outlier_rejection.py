"""A search among the good captures: outliers are left out, and the final model judges every capture.

A capture that doesn't fit its record must neither be fitted nor judge others, and every capture must be judged. So
captures that stand out far are left out of the search, and its result judges all captures; if the search used bad
captures, it is repeated without them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.diagnose.correct.bad_captures import MAX_BAD_SHARE, BadCapture, bad_share
from holoview.bench.diagnose.correct.judged_captures import explain_suspects, judge_by_search, leave_out
from holoview.bench.diagnose.detail_veto import (
    fit_what_stays,
    veto_lost_detail,
    veto_uncorrelated,
    veto_without_effect,
)
from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.judge import (
    Decision,
    SearchResult,
    check_noise,
    decide,
    limited_by_bad_captures,
    limited_by_noise,
    rank_on_held_out,
)
from holoview.bench.diagnose.nuisances import drop_sampling_artefacts, excuse_laser_drift
from holoview.bench.diagnose.search import InitialCandidates, find_causes, refine_candidates
from holoview.bench.diagnose.search_context import NEVER, SearchContext, SearchEnd, SearchEnded
from holoview.util.progress import ProgressCallback

ROUNDS = 3
"""[1] Searches at most, each without the captures that the previous search found bad. Evidence: none recorded."""


@dataclass(frozen=True)
class SearchOutcome:
    """The result of a search, the decision on it, notes, and the bad captures. context: at the end of the search.
    was_ended: whether its time, or the caller, ended it early. middle: of large pictures, in which causes were searched
    before whole pictures were looked at. fitted: in which the named causes were fitted; None: in `context`.
    better_sampling: with which the captures are explained better, where nobody stated whether camera pixels integrate.
    put_right: causes that are no more than errors of what was estimated, and belong to the known effects.
    """

    context: SearchContext
    result: SearchResult
    decision: Decision
    notes: list[str]
    bad_captures: tuple[BadCapture, ...] = ()
    was_ended: bool = False
    middle: SearchContext | None = None
    fitted: SearchContext | None = None
    better_sampling: SamplingConfig | None = None
    put_right: FittedValues = field(default_factory=dict)

    @property
    def searched(self) -> SearchContext:
        """The context in which causes were searched; it serves for quantities that need no full size."""
        return self.middle or self.context


def search_once(
    context: SearchContext,
    left_out: Collection[int],
    progress: ProgressCallback,
    initial: InitialCandidates | None = None,
) -> SearchOutcome:
    """One search without some captures, and the decision on it. The end of its time ends the search alone.

    initial: the causes that an earlier search suggests; then the search goes on from these, by their policy.
    """
    context.best_so_far.clear()
    context = replace(context, field_budget=context.predictor.fields_requested + context.field_budget)
    context = leave_out(context, {*context.left_out, *left_out})
    end, context.predictor.end = context.end, context.end
    progress = context.telling_time_left(progress)
    was_ended = False
    result: SearchResult | None
    try:
        if initial is None:
            context, result = find_causes(context, progress)
        else:
            result = refine_candidates(context, initial, progress)
    except SearchEnded:
        context.workers.close(kill=True)
        result, was_ended = context.best_so_far.result, True
    is_out_of_budget = context.budget_exhausted
    context = replace(context, end=NEVER)
    context.predictor.end = NEVER
    result = result or rank_on_held_out(context, initial.fits if initial else ())
    decision = decide(result, context.equivalents, context.config.verdict)
    decision, notes = excuse_laser_drift(context, result, decision)
    better = result.better_sampling
    if initial is None and better is None:
        decision, sampling_notes, better = drop_sampling_artefacts(context, result, decision)
        notes = [*notes, *sampling_notes]
    before_vetoes = decision.best
    for veto in (veto_lost_detail, veto_uncorrelated, veto_without_effect):
        decision, veto_notes = veto(context, result, decision)
        notes = [*notes, *veto_notes]
    if decision.best is not before_vetoes and not was_ended:
        result, decision = fit_what_stays(context, result, decision)
    if context.missing_light is None:  # which counts as noise as well, and may be overstated
        decision, noise_notes = limited_by_noise(decision, check_noise(result.comparison, decision.values))
        notes = [*noise_notes, *notes]
    notes = [*notes, *_end_notes(end, decision, was_ended, is_out_of_budget)]
    return SearchOutcome(context, result, decision, notes, was_ended=was_ended, better_sampling=better)


def judge_captures(
    context: SearchContext,
    found: SearchOutcome,
    search: Callable[[Collection[int]], SearchOutcome],
    useless: Sequence[BadCapture],
    count: int,
    progress: ProgressCallback,
) -> SearchOutcome:
    """The outcome of a search that used no bad captures, and the reasons why captures are bad; with the verdict and
    notes that follow from their number. context, found: of the first search, and its result. search: repeats the search
    without some captures. useless: captures that are bad whatever the model. count: number of all captures.
    """
    for searches_left in reversed(range(ROUNDS)):
        progress(0, 1, "every capture")
        suspects = judge_by_search(found.context, found.decision.values, found.result, context.left_out)
        if found.was_ended or found.context.split.used.isdisjoint(suspects.indices) or not searches_left:
            break
        found = search(suspects.indices)
    explained = explain_suspects(found.context, suspects)
    left_out = tuple(sorted({*found.context.left_out, *suspects.indices}))
    found = replace(found, context=replace(found.context, left_out=left_out))
    bad = tuple(sorted([*useless, *explained], key=lambda one: one.index))
    share, max_share = bad_share(bad, count), MAX_BAD_SHARE
    notes = list(found.notes)
    if bad:
        notes.append(f"The verdict speaks of {count - len(bad)} of {count} captures; the others are bad.")
    if share > max_share:
        notes.append(f"{share:.0%} of the captures are bad: the others can neither clear nor explain the bench.")
    decision = limited_by_bad_captures(found.decision, share, max_share)
    return replace(found, decision=decision, notes=notes, bad_captures=bad)


def _end_notes(end: SearchEnd, decision: Decision, was_ended: bool, is_out_of_budget: bool) -> list[str]:
    """A note where a search was cut, or ended at its budget without a full explanation."""
    if was_ended and end.was_asked:
        return ["The search was interrupted; this is the best that it had found."]
    if was_ended or (is_out_of_budget and end.is_near and decision.verdict.is_open):
        return [
            f"The search was cut by its time, {end.time_s:.0f} s, with causes left to try: a faster machine might say "
            "more. Give it more time (--time 10min), or all that it needs (--thorough)."
        ]
    if is_out_of_budget and decision.verdict.is_open:
        return ["The search was ended with causes left to try; a thorough one (--thorough) takes minutes more."]
    return []
