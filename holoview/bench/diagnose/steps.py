"""Which search follows which, as tables: a first one in the middle of large pictures, further ones from its causes.

Each step of a table names a view, and the policy by which causes are searched there beside those of the step before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Any

import torch

from holoview.bench.diagnose.calibration_prior import Uncertainties, errors_of_estimates
from holoview.bench.diagnose.correct.bad_captures import BadCapture
from holoview.bench.diagnose.correct.judged_captures import find_suspects
from holoview.bench.diagnose.crop import (
    describe_middle,
    measure_missing_light,
    with_fitting_stops,
    without_light_from_beyond,
)
from holoview.bench.diagnose.fit import CandidateFit, FittedValues
from holoview.bench.diagnose.judge import Decision, Lookalikes, Verdict
from holoview.bench.diagnose.likelihood import Values
from holoview.bench.diagnose.nuisances import detect_nuisances
from holoview.bench.diagnose.outlier_rejection import SearchOutcome, judge_captures, search_once
from holoview.bench.diagnose.screening import LOCAL_MAX_ERROR
from holoview.bench.diagnose.search import Beside, InitialCandidates, Policy, Refit, Until
from holoview.bench.diagnose.search_context import NEVER, PerThreadPredictor, SearchContext, SearchEnded, describe_work
from holoview.bench.diagnose.speckle_evidence import NEAR_CORRELATION, describe_light
from holoview.bench.diagnose.speckle_search import FoundLight, with_or_without_unmodulated
from holoview.util.progress import ProgressCallback, TextCallback

DECIDING_SHARE = 0.1
"""[1] Of the nominal excess χ²/n that light found by speckle leaves at most where brightness decides on unmodulated
light, further causes are searched beside it however its speckle stands, and no other search follows. Evidence: drawn
benches: it was right where 8 % were left and less; what leaves a third lacks other things."""
_BESIDE_LIGHT = 3
"""[causes] Searched beside light found by speckle, at most. Evidence: drawn benches: stray light, a blur and dust."""
_DECISIVE_SHARE = 0.3
"""[1] Of the excess, below which such a cause has to leave. Evidence: drawn benches: stray light left 0.04; a crosstalk
and a fringing that weren't there 0.4 and 0.7."""
_MODEL_SHARE = 0.005
"""[1] Of the nominal excess, which models of the same bench leave of each other: less isn't searched. Evidence: drawn
benches: light that was right to a hundredth left 0.001 of it, for which a fringing and a crosstalk were named; stray
light and a distance beside it 0.26 and 0.07."""
_PART_ROUNDS = 2
"""[1] Searches in parts, of which the second follows if the first names other causes. Evidence: a reason: a third would
change the light from beyond by the error of an error."""


class Where(Enum):
    """What of the pictures a search compares with predictions."""

    MIDDLE = "the middle"
    PARTS = "the parts"
    WHOLE = "whole pictures"


@dataclass(frozen=True)
class Views:
    """The contexts of searches. of: whole pictures; their middle, unless it would save little; the middle and the
    corners as parts, as for the middle. weighted: predicts whole pictures with weighted stops. count: number of all
    captures. useless: captures that are left out. only: the captures that remain. notes: on effects that the captures
    can't show.
    """

    of: Mapping[Where, SearchContext]
    weighted: PerThreadPredictor
    count: int
    useless: Sequence[BadCapture]
    only: set[int]
    notes: list[str]

    @property
    def whole(self) -> SearchContext:
        """Of whole pictures."""
        return self.of[Where.WHOLE]

    @property
    def is_one(self) -> bool:
        """Whether one picture remains, which was split into two."""
        return len(self.only) == 1

    @property
    def first(self) -> SearchContext:
        """Of the pictures that are searched first: the middle of large ones."""
        return self.of.get(Where.MIDDLE, self.whole)


@dataclass(frozen=True)
class Step:
    """A search that goes on from the causes of the one before it, by a policy. In the middle and in parts the light
    from beyond them is subtracted, as these causes predict it. rounds: searches at most, as long as they find others.
    """

    where: Where
    policy: Policy
    rounds: int = 1


_NEAR_FIELDS = (
    Step(Where.MIDDLE, Policy(Beside.AFFORDABLE, Until.AT_FLOOR)),
    Step(Where.PARTS, Policy(Beside.OVER_FIELD, Until.EXPLAINED), _PART_ROUNDS),
    Step(Where.WHOLE, Policy(Beside.OVER_FIELD, Until.EXPLAINED, Refit.UNLESS_EXPLAINED)),
)
"""Behind a search of all effects in the middle of several pictures, in which the light from beyond counts as noise."""
_EXACT_MIDDLE = (Step(Where.WHOLE, Policy(Beside.AFFORDABLE, Until.AT_FLOOR)),)
"""Behind that search on a Fourier bench, where no light comes from beyond, and of one picture."""
_LIGHT_ALONE = Policy(Beside.NOTHING, Until.EXPLAINED, Refit.OF_ALL_NUMBERS)
_LIGHT = Policy(Beside.AFFORDABLE, Until.EXPLAINED, Refit.OF_ALL_NUMBERS, _BESIDE_LIGHT, _DECISIVE_SHARE)
"""Of light that was found by speckle: before errors of estimates are put right, and then."""
_LIGHT_IN_WHOLE = Policy(Beside.NOTHING, Until.EXPLAINED, Refit.NEVER)
"""Of that light behind its fit to parts."""


def find_causes_in_views(views: Views, progress: ProgressCallback, forecast: TextCallback) -> SearchOutcome:
    """The causes and the bad captures: searched in the middle of large pictures, refined and judged in whole ones.

    forecast: is told how much work that is.
    """
    steps: Sequence[Step] = ()
    if Where.MIDDLE in views.of:
        progress(0, 1, "light from beyond the middle")
        with views.whole.measuring_pace():
            missing = measure_missing_light(replace(views.whole, end=NEVER), views.first)
        is_cut = views.whole.data.captures.slm_frame is not None  # whole pictures too: known as in a smaller part
        lacking = {k: replace(v, missing_light=missing) for k, v in views.of.items() if is_cut or v is not views.whole}
        views = replace(views, of={**views.of, **lacking})
        is_exact = views.whole.data.captures.is_fourier or views.is_one
        steps = [step for step in (_EXACT_MIDDLE if is_exact else _NEAR_FIELDS) if step.where in views.of]
    later = [views.of[step.where] for step in steps]
    with views.first.measuring_pace():  # whose predictions tell how long later searches take, too
        progress(0, 1, "every capture")
        doubtful = find_suspects(views.first, {}, views.first.left_out, is_final=False).indices
    a_field = views.first.pace.first
    for one in later:
        if one.windows and one.pace.first is None and a_field is not None:  # parts, each of which is like the middle
            one.pace.first = len(one.windows) * a_field
    forecast(describe_work([views.first, *later]))
    search = partial(search_once, views.first, progress=progress)
    found = search(doubtful)
    was_asked = bool(steps) and views.whole.end.was_asked
    if found.better_sampling is not None and not was_asked:
        return found
    if was_asked or not steps:
        outcome = judge_captures(views.first, found, search, views.useless, views.count, progress)
        unseen = [f"{describe_middle(views.first)}; whole pictures weren't looked at."] if was_asked else []
        return replace(outcome, notes=[*outcome.notes, *unseen])
    first = in_middle = found
    *cut, last = steps
    if cut:
        progress(0, 1, "stops that fit")
        whole = with_fitting_stops(replace(views.whole, end=NEVER), views.weighted, first.decision.values)
        views = replace(views, of={**views.of, Where.WHOLE: replace(whole, end=views.whole.end)})
    for step in cut:
        found = _searched_in_cut(views, step, first, found, progress)
        if step.where is Where.MIDDLE:
            found = in_middle = _with_findings_of(first, found)
    outcome = _with_findings_of(in_middle, _judged_whole(views, found, last.policy, progress))
    of_parts = "five parts fitted them, whole ones judged"
    how = "whole pictures fitted and judged them" if outcome.fitted is None else of_parts
    note = f"{describe_middle(views.first)}; {how}."
    return replace(outcome, middle=in_middle.context, notes=[*outcome.notes, note])


def _searched_in_cut(
    views: Views, step: Step, first: SearchOutcome, found: SearchOutcome, progress: ProgressCallback
) -> SearchOutcome:
    """The outcome of a step in the middle or in parts, without the light from beyond, which hides weak faults. It is
    `found`, with whose causes the step begins, where these are too far from the truth to predict that light, or where
    the search has to end meanwhile.

    first: the earliest search, whose causes predict the light for as long as the same are named. Further causes change
    it; in parts they are then fitted once more without that light.
    """
    view = views.of[step.where]
    for _ in range(step.rounds):
        values = found.decision.values
        causes = {*values}
        if found.context.relative_model_error(values) > LOCAL_MAX_ERROR:
            break
        values = first.decision.values if {*first.decision.values} == causes else values
        is_middle = step.where is Where.MIDDLE
        progress(0, 1, f"light from beyond {step.where.value}, as predicted")
        try:
            corrected = without_light_from_beyond(views.whole, found.context if is_middle else view, values)
        except SearchEnded:
            views.whole.workers.close(kill=True)
            break
        if is_middle:
            corrected = replace(detect_nuisances(corrected, values), field_budget=view.field_budget, end=view.end)
        else:
            corrected = _with_nuisances_of(found.context, corrected)
        found = search_once(corrected, found.context.left_out, progress, _start(found, step.policy))
        if {*found.decision.values} == causes or found.was_ended:
            break
    return found


def _judged_whole(views: Views, found: SearchOutcome, policy: Policy, progress: ProgressCallback) -> SearchOutcome:
    """The outcome in whole pictures of causes that were found in the middle or fitted to parts.

    Where these leave much open, nothing is searched beside them. Values of a middle are always fitted again.
    """
    views.whole.workers.rest()  # they hold a gigabyte each, and whole pictures are mostly fitted here
    torch.set_num_threads(views.whole.workers.workers)  # most of what follows runs here, a few large fields at a time
    whole, is_of_parts = _with_nuisances_of(found.context, views.whole), len(found.context.windows) > 1
    beside = Beside.NOTHING if found.decision.verdict.is_open else policy.beside
    initial = _start(found, replace(policy, beside=beside, refit=policy.refit if is_of_parts else Refit.ALWAYS))
    search = partial(search_once, whole, progress=progress, initial=initial)
    outcome = judge_captures(whole, search(found.context.left_out), search, views.useless, views.count, progress)
    are_kept = is_of_parts and outcome.result.best.fit in initial.fits
    return replace(outcome, fitted=found.context if are_kept else None)


def judge_light(
    views: Views, light: FoundLight, known: Values, uncertain: Uncertainties, progress: ProgressCallback
) -> SearchOutcome:
    """The causes that stand for the light that was found by speckle, judged by least squares: in whole pictures, or in
    parts of large ones and then in these. Not judged where they are to be searched with other samples or known effects.

    Causes of an earlier search are judged beside that light, and together with what they lack of it.
    """
    whole = views.whole
    torch.set_num_threads(whole.workers.workers)  # one fit after another, here, of large fields
    view = whole
    if Where.PARTS in views.of:
        progress(0, 1, "light from beyond the parts")
        view = views.of[Where.PARTS]
        view = replace(view, missing_light=measure_missing_light(replace(whole, end=NEVER), view))

    def search_from(starts: Sequence[FittedValues], policy: Policy) -> Callable[[Collection[int]], SearchOutcome]:
        fits = tuple(CandidateFit(tuple(values), values, math.inf) for values in starts)
        return partial(search_once, view, progress=progress, initial=InitialCandidates(fits, policy))

    estimated: dict[str, dict[str, Any]] = {
        name: {} for name in uncertain if name in whole.effects and name not in known
    }
    starts = [{**estimated, **light.values}]
    if light.earlier:
        starts += [{**estimated, **light.earlier, **light.values}, {**estimated, **light.earlier}]
    search = search_from(starts, _LIGHT_ALONE)
    found = search(whole.left_out)
    best, nominal = found.result.best, found.result.nominal
    if not found.was_ended and (put_right := errors_of_estimates(found.result, uncertain, known)):
        return replace(found, put_right=put_right)
    starts, is_near = [best.fit.values], best.excess < DECIDING_SHARE * nominal.excess
    if is_near:
        starts.append(with_or_without_unmodulated(best.fit.values))
    is_right = is_near or light.after > NEAR_CORRELATION
    is_worth_it = is_right and best.excess > _MODEL_SHARE * nominal.excess
    may_have_samples = view.has_open_sampling and not whole.data.captures.is_fourier
    if found.decision.verdict.is_open and (len(starts) > 1 or is_worth_it or may_have_samples) and not found.was_ended:
        search = search_from(starts, _LIGHT if is_worth_it else replace(_LIGHT, beside=Beside.NOTHING))
        found = search(whole.left_out)
    if found.better_sampling is not None:
        return found
    if view is whole:
        outcome = judge_captures(whole, found, search, views.useless, views.count, progress)
    else:  # whole pictures tell which causes are needed: in a part a beam may be as good as even light
        found = replace(found, decision=Decision(Verdict.PARTLY, found.result.best))
        outcome = _judged_whole(views, found, _LIGHT_IN_WHOLE, progress)
        if Where.MIDDLE in views.of:
            outcome = replace(outcome, middle=replace(views.first, missing_light=view.missing_light, end=NEVER))
    outcome = replace(outcome, notes=[*outcome.notes, describe_light(light)])
    if outcome.decision.verdict is not Verdict.PARTLY or outcome.decision.best is None:
        return outcome
    named = outcome.decision.best.fit  # far from the captures, derivatives tell nothing of what looks alike
    alike = Lookalikes(named, {cause: {} for cause in named.causes}, {cause: {} for cause in named.causes})
    return replace(outcome, result=replace(outcome.result, lookalikes=alike))


def _with_nuisances_of(first: SearchContext, further: SearchContext) -> SearchContext:
    """The context of a further search with the nuisances of a first one, which has decided on samples, too."""
    jitter = first.has_camera_jitter
    return replace(further, prnu=first.prnu, has_camera_jitter=jitter, has_open_sampling=False)


def _with_findings_of(earlier: SearchOutcome, outcome: SearchOutcome) -> SearchOutcome:
    """The outcome of a further search with the notes of an earlier one, and its unseen rivals of the same causes."""
    notes = list(dict.fromkeys([*earlier.notes, *outcome.notes]))
    if outcome.result.best.causes != earlier.result.best.causes:
        return replace(outcome, notes=notes)
    unseen = earlier.result.unseen_rivals
    return replace(outcome, result=replace(outcome.result, unseen_rivals=unseen), notes=notes)


def _start(found: SearchOutcome, policy: Policy) -> InitialCandidates:
    """The best candidate of a search and its rivals, from which a further one goes on."""
    named = (found.decision.best, *found.decision.rivals)
    return InitialCandidates(tuple(score.fit for score in named if score is not None), policy)
