"""A search among the good captures: what stands out is left out, and every capture is judged by the final model.

A capture that isn't what its record says must neither be fitted nor judge others, and none may pass unseen. So captures
that stand out far are left out of the search; its result judges all of them; and where it finds that bad ones were
used, the search is repeated without them.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

from holoview.diagnose.bad_captures import BadCapture, bad_share
from holoview.diagnose.capture_judgement import find_suspects, judge_by_search, leave_out
from holoview.diagnose.capture_reasons import explain_suspects
from holoview.diagnose.fit import FittedValues
from holoview.diagnose.judge import Decision, SearchResult, Verdict, decide, limited_by_bad_captures, rank_on_held_out
from holoview.diagnose.nuisances import detect_nuisances, drop_sampling_artefacts, excuse_laser_drift
from holoview.diagnose.power_law import changes_only_power
from holoview.diagnose.refine import fit_to_the_end, prefer_fewer_numbers, refine_fit
from holoview.diagnose.search import select_causes
from holoview.diagnose.search_context import NEVER, SearchContext, SearchEnd, SearchEnded
from holoview.util.progress import ProgressCallback


@dataclass(frozen=True)
class SearchOutcome:
    """What a search found, the decision on it, notes, and the captures that are bad.

    context: as it ended. was_ended: whether it was ended before it was done, by its time or by somebody.
    """

    context: SearchContext
    result: SearchResult
    decision: Decision
    notes: list[str]
    bad_captures: tuple[BadCapture, ...] = ()
    was_ended: bool = False


def search_good_captures(
    context: SearchContext, useless: Sequence[BadCapture], count: int, progress: ProgressCallback
) -> SearchOutcome:
    """The causes among the captures that are good, and those that are bad.

    context: without the useless captures, those that are bad whatever the model. count: of all captures.
    """
    config, always = context.config.judgement, context.left_out
    progress(0, 1, "every capture")
    left_out: Collection[int]
    if context.leads is None:
        left_out = find_suspects(context, {}, always, is_final=False).indices
    else:
        left_out = context.leads.doubted
    for _ in range(config.rounds):
        context.best_so_far.clear()
        budget = context.predictor.fields_requested + context.field_budget
        good = leave_out(replace(context, field_budget=budget), {*always, *left_out})
        outcome = _search_once(good, progress)
        if context.is_region and not context.end.was_asked:  # whole pictures judge
            return outcome
        progress(0, 1, "every capture")
        suspects = judge_by_search(outcome.context, outcome.decision.values, outcome.result, always)
        left_out = suspects.indices
        if outcome.was_ended or good.split.used.isdisjoint(suspects.indices):
            break
    found = explain_suspects(outcome.context, suspects)
    left_out = tuple(sorted({*outcome.context.left_out, *suspects.indices}))
    outcome = replace(outcome, context=replace(outcome.context, left_out=left_out))
    return _with_bad_captures(outcome, tuple(sorted([*useless, *found], key=lambda bad: bad.index)), count)


def _with_bad_captures(outcome: SearchOutcome, bad: tuple[BadCapture, ...], count: int) -> SearchOutcome:
    """The outcome with the bad ones of `count` captures, and with the verdict and the notes that they allow."""
    share, max_share = bad_share(bad, count), outcome.context.config.judgement.bad_share
    notes = list(outcome.notes)
    if bad:
        notes.append(f"The verdict speaks of {count - len(bad)} of {count} captures; the others are bad.")
    if share > max_share:
        notes.append(f"{share:.0%} of the captures are bad: the others can neither clear nor explain the bench.")
    decision = limited_by_bad_captures(outcome.decision, share, max_share)
    return replace(outcome, decision=decision, notes=notes, bad_captures=bad)


def _search_once(context: SearchContext, progress: ProgressCallback) -> SearchOutcome:
    """One search, and the decision on it. The end of its time ends nothing but the search itself."""
    end, context.predictor.end = context.end, context.end
    was_ended = False
    result: SearchResult | None
    try:
        context, result = _search_causes(_with_nuisances(context, {}), progress)
    except SearchEnded:
        context.workers.close(kill=True)
        result, was_ended = context.best_so_far.result, True
    is_out_of_budget = context.budget_exhausted
    context = replace(context, end=NEVER)
    context.predictor.end = NEVER
    result = result or rank_on_held_out(context, context.leads.fits if context.leads else ())
    decision, drift_notes = excuse_laser_drift(context, result, _decide(context, result))
    sampling_notes: list[str] = []
    if context.region is None:
        decision, sampling_notes = drop_sampling_artefacts(context, result, decision)
    notes = [*drift_notes, *sampling_notes, *_end_notes(end, decision, was_ended, is_out_of_budget)]
    return SearchOutcome(context, result, decision, notes, was_ended=was_ended)


def _decide(context: SearchContext, result: SearchResult) -> Decision:
    return decide(result, context.equivalents, context.config.verdict)


def _with_nuisances(context: SearchContext, values: FittedValues) -> SearchContext:
    """The context with what varies by itself; with leads from the middle, that was found there."""
    return context if context.leads is not None else detect_nuisances(context, values)


def _search_causes(context: SearchContext, progress: ProgressCallback) -> tuple[SearchContext, SearchResult]:
    """The context with the nuisances found, and the candidates ranked with them.

    No search is begun where movements of the camera alone explain the captures.
    """
    nothing = rank_on_held_out(context, [])
    if context.has_camera_jitter:
        decision, _ = excuse_laser_drift(context, nothing, _decide(context, nothing))
        if decision.verdict is Verdict.CONSISTENT:
            return context, nothing
    result = select_causes(context, [e for e in context.effects.values() if not changes_only_power(e)], progress)
    result = fit_to_the_end(context, prefer_fewer_numbers(context, result))
    settled = _with_nuisances(context, result.best.fit.values)
    if settled is context:
        return context, result
    config = context.config.selection
    max_excess = config.reranked_excess_factor * result.best.excess + config.reranked_excess
    near = [c.fit for c in result.candidates[: config.reranked] if c.excess < max_excess]
    return settled, rank_on_held_out(settled, settled.run_parallel(partial(refine_fit, settled, f) for f in near))


def _end_notes(end: SearchEnd, decision: Decision, was_ended: bool, is_out_of_budget: bool) -> list[str]:
    """A note where a search that found no full explanation was ended."""
    if was_ended and end.was_asked:
        return ["The search was interrupted; this is the best that it had found."]
    if not (was_ended or is_out_of_budget) or decision.verdict not in (Verdict.UNEXPLAINED, Verdict.PARTLY):
        return []
    if was_ended:
        return [
            f"The search was ended after {end.time_s:.0f} s with causes left to try; give it more time (--time 10min), "
            "or all that it needs (--thorough)."
        ]
    return ["The search was ended with causes left to try; a thorough one (--thorough) takes minutes more."]
