"""From captures to a diagnosis: prepare, search, decide, and state how certain it is."""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import torch

from holoview.bench.captures.count_bits import with_clipped_as_saturated
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.patterns import pattern_roughness
from holoview.bench.captures.predictor import PLAIN, SamplingConfig, cache_bytes, check_known_effects, prediction_bytes
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.unknown_settings import uncertainties
from holoview.bench.diagnose.calibration_prior import (
    Uncertainties,
    correction_notes,
    corrections_alone,
    errors_of_estimates,
    known_corrections,
)
from holoview.bench.diagnose.capture_split import split_captures
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.correct.bad_captures import BadCapture, find_useless_captures
from holoview.bench.diagnose.correct.wrong_records import CheckedRecords, check_records
from holoview.bench.diagnose.crop import (
    MAX_TIME_SHARE,
    describe_middle,
    measure_missing_light,
    middle_captures,
    middle_of_context,
    with_fitting_stops,
    within_limits,
    without_light_from_beyond,
)
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects, add_effect_values
from holoview.bench.diagnose.fit import CandidateFit, FittedValues
from holoview.bench.diagnose.judge import Decision, Lookalikes, SearchResult, Verdict
from holoview.bench.diagnose.likelihood import Values
from holoview.bench.diagnose.nuisances import detect_nuisances
from holoview.bench.diagnose.outlier_rejection import SearchOutcome, doubtful_captures, judge_captures, search_once
from holoview.bench.diagnose.parts import parts_of_context
from holoview.bench.diagnose.power_law import changes_only_power
from holoview.bench.diagnose.report.assemble import assemble, better_explained, with_wrong_records
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.bench.diagnose.sampling_choice import (
    choose_sampling,
    describe_better,
    is_noise_assumed,
    with_noise_of_residuals,
)
from holoview.bench.diagnose.screening import LOCAL_MAX_ERROR
from holoview.bench.diagnose.search import InitialCandidates, Refit
from holoview.bench.diagnose.search_context import (
    NEVER,
    BestSoFar,
    NeighbourVariances,
    PerThreadPredictor,
    SearchContext,
    SearchEnd,
    SearchEnded,
    describe_so_far,
    describe_work,
    equivalent_effects,
    field_samples,
)
from holoview.bench.diagnose.single_capture import ONE_PICTURE_NOTE, with_one_picture
from holoview.bench.diagnose.speckle_evidence import (
    FAR_CHI2,
    NEAR_CORRELATION,
    LightWindow,
    describe_light,
    light_by_speckle,
    window_for_light,
)
from holoview.bench.diagnose.speckle_search import FoundLight, with_or_without_unmodulated
from holoview.bench.diagnose.worker_pool import WorkerPool
from holoview.light.model.effects.effect import Effect
from holoview.light.model.effects.registry import (
    ActiveEffects,
    effect_on_bench,
    effects_of,
    is_user_effect,
    load_user_effects,
    unmet_by_bench,
    unmet_by_data,
)
from holoview.light.model.fields import Duration, Integer, Maybe, Truth, described_field, with_field_docs
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback, TextCallback, no_progress

_CORRECTION_SHARE = 0.7
"""[1] Of a search's budget, which corrections of known effects may take before it. Evidence: 16 s of one core on the
virtual rig (48 × 64 pixels, 24 captures)."""
_SPECKLE_SHARE = 0.6
"""[1] Of the time, which the search by speckle may take. Evidence: a reason: the usual search needs the rest."""
_USUAL_SHARE = 0.5
"""[1] Of the time, which the search by derivatives may take where light may be sought by speckle behind it. Evidence: a
reason: the other half is then sought and judged in."""
_LEAST_LEFT = 0.15
"""[1] Of the time, with less of which no other search begins. Evidence: a reason: its preparation takes as long."""
_DECIDING_SHARE = 0.1
"""[1] Of the nominal excess χ²/n that light found by speckle leaves at most where brightness decides on unmodulated
light, and where no other search follows. Evidence: drawn benches: it was right where 7 % were left and less; what
leaves a third lacks other things."""
_BESIDE_LIGHT = 2
"""[causes] Searched beside light found by speckle, at most, of two pictures and more. Evidence: drawn benches: a blur
and dust; of one picture a vignetting, which stood for the missing envelope of another program's pixels."""
_LAST_BEGIN = 0.7
"""[1] After this share of the time nothing new is begun, so that fits underway end in time. Evidence: measured: the
longest step of a pair, each cause fitted without the other, took 20 of 80 s."""
_PART_ROUNDS = 2
"""[1] Searches in parts, of which the second follows if the first names other causes. Evidence: a reason: a third would
change the light from beyond by the error of an error."""

_OPEN = (Verdict.UNEXPLAINED, Verdict.PARTLY)


@with_field_docs
@dataclass(frozen=True)
class DiagnosisOptions:
    """How far a diagnosis searches, with how many processes. The ranges are those of a user's choice.

    Fields:
    """

    workers: int = described_field(
        Integer(1, 1024),
        "Processes side by side, and threads where one fit follows another; results depend on their number by rounding "
        "alone. The command takes as many as there are cores, at most 8.",
        default=1,
    )
    time_s: float | None = described_field(
        Maybe(Duration()),
        "Search to the end, but for at most so long, e.g. 10min, then tell the best that was found; records, intervals "
        "and notes take a little longer. If absent as much work as two cores do in about a minute, up to five for "
        "large modulators, so that the result doesn't depend on the machine's speed.",
        flag="time",
        default=None,
    )
    thorough: bool = described_field(Truth(), "Search to the end, however long that takes.", default=False)


def diagnose(
    captures: Captures,
    effects: Iterable[Effect] | None = None,
    *,
    known: Values | None = None,
    uncertain: Uncertainties | None = None,
    workers: int = 1,
    progress: ProgressCallback | None = None,
    free_maps: bool = True,
    thorough: bool = False,
    time_s: float | None = None,
    is_asked_to_end: Callable[[], bool] | None = None,
    so_far: TextCallback | None = None,
    forecast: TextCallback | None = None,
    sampling: SamplingConfig = PLAIN,
    config: SearchConfig | None = None,
) -> Diagnosis:
    """Names the differences of the real bench from the nominal model of these captures, wrong records first.

    effects: the candidates; all of the registry when None.
    known: effects that the nominal model has, {id: {parameter: value}}; the values found add to them.
    uncertain: standard deviations of known effects that were measured, {id: {parameter: value}}; their errors are
    fitted first, within these. `Diagnosis.known` has the known effects as they were used.
    workers, thorough, time_s: as in `DiagnosisOptions`; the work by default is `config.budget.max_fields`. With more
    than one worker, a script needs the usual `if __name__ == "__main__":` of Python's multiprocessing.
    progress: called with (done, total, what).
    free_maps: look for the place of an error that no effect explains, if one remains.
    is_asked_to_end: asked now and then; the search ends in the same way once it returns True.
    so_far: called with a sentence when the search has found a better result.
    forecast: called with a sentence before the search: how many fields it computes at most, and the seconds that these
    are expected to take on this machine, measured with the first predictions. Notes of `progress` go on from there.
    sampling: how predictions sample light. Where nobody states how camera pixels do, the captures decide.
    config: settings of all stages.

    Where corrected records leave the captures unexplained, and a gross error of the bench can imitate these wrong
    records, the captures are searched as recorded as well, each within half of the budget; the better explanation
    counts.

    Counts clipped below the camera's full scale count as saturated. Every capture is judged: `Diagnosis.bad_captures`
    lists those that don't fit their records. Of a single picture, blocks of pixels are held out. Raises UserError when
    no capture shows anything, and for known effects that such a bench can't have.
    """
    began, known = time.monotonic(), known or {}
    check_known_effects(captures, known)
    candidates = list(effects_of(captures.data_properties()) if effects is None else effects)
    most_s = math.inf if time_s is None else time_s
    given = (workers, progress or no_progress, free_maps, thorough, most_s, is_asked_to_end, so_far, forecast, sampling)
    request = _Request(candidates, known, uncertain or {}, *given, config or SearchConfig(), sampling == PLAIN)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        diagnosis = _diagnose(captures, request)
    finally:
        torch.set_num_threads(threads)
    return replace(diagnosis, captures=len(captures), seconds=time.monotonic() - began)


@dataclass(frozen=True)
class _Request:
    """The arguments of `diagnose` but for the captures."""

    candidates: list[Effect]
    known: Values
    uncertain: Uncertainties
    workers: int
    progress: ProgressCallback
    free_maps: bool
    thorough: bool
    time_s: float
    is_asked_to_end: Callable[[], bool] | None
    so_far: TextCallback | None
    forecast: TextCallback | None
    sampling: SamplingConfig
    config: SearchConfig
    has_open_sampling: bool  # neither the caller nor, so far, the captures say how the light is sampled
    left_by_samples: float = 0.0  # excess of χ²/n, where the captures chose them

    def start_workers(self) -> WorkerPool:
        """Processes for a search."""
        return WorkerPool(self.workers, self.config.budget.worker_start_s)

    @property
    def is_asked(self) -> bool:
        """Whether the caller has asked for the end of the search."""
        return self.is_asked_to_end is not None and self.is_asked_to_end()


def _diagnose(captures: Captures, request: _Request) -> Diagnosis:
    """Leaves out clipped counts, puts records right, corrects known effects that were measured, and searches."""
    said: list[str] = []
    captures = with_clipped_as_saturated(captures, said.append)
    records = check_records(captures, request.known)
    has_time = _Clock(request)
    ids = [effect.id for effect in request.candidates]
    window = None if request.known else window_for_light(records.captures, ids)
    of_light = partial(_search_light, records, has_time=has_time, tell=said.append)

    def told(diagnosis: Diagnosis, notes: tuple[str, ...] = ()) -> Diagnosis:
        return replace(diagnosis, notes=(*diagnosis.notes, *notes, *(f"{text}." for text in said)))

    judged = of_light(window) if window is not None and window.is_first else None
    if judged is not None and (
        captures.is_fourier or not _lacks_much(judged) or request.is_asked or has_time.is_nearly_over
    ):
        return told(judged)
    is_later = window is not None and not window.is_first
    usual, notes = _search_causes(captures, records, has_time.left(_USUAL_SHARE if is_later else 1.0))
    if window is not None and is_later and usual.verdict in _OPEN and not request.is_asked:
        judged = of_light(window)
    if judged is not None and judged.causes and judged.after.chi2_per_pixel < usual.after.chi2_per_pixel:
        return told(judged)
    return told(usual, notes)


def _lacks_much(diagnosis: Diagnosis) -> bool:
    """Whether it leaves so much unexplained that another search may find more."""
    left = diagnosis.after.chi2_per_pixel
    return diagnosis.verdict in _OPEN and left > FAR_CHI2 and diagnosis.unexplained > _DECIDING_SHARE


class _Clock:
    """What is left of the time of a diagnosis, whose parts come one after another."""

    def __init__(self, request: _Request) -> None:
        self._request, self._began = request, time.monotonic()

    @property
    def is_nearly_over(self) -> bool:
        """Whether less is left than another search needs to begin."""
        return self._left_s < _LEAST_LEFT * self._request.time_s

    def left(self, share: float = 1.0) -> _Request:
        """The request with a share of the time that is left."""
        return replace(self._request, time_s=share * self._left_s)

    @property
    def _left_s(self) -> float:
        return max(self._request.time_s - (time.monotonic() - self._began), 0.0)


def _search_causes(captures: Captures, records: CheckedRecords, request: _Request) -> tuple[Diagnosis, tuple[str, ...]]:
    """The diagnosis by derivatives, of corrected records and where these are doubtful as recorded, with notes."""
    share = 0.5 if records.are_doubtful else 1.0
    request, _ = _with_chosen_sampling(records.captures, request)
    request = replace(request, uncertain={**uncertainties(records.captures), **request.uncertain})
    records = _with_noise_of_residuals(records, request)
    request, notes = _with_corrected_known(records, request)
    diagnosis = _search(records, request, share)
    if records.are_doubtful and diagnosis.verdict in _OPEN and not request.is_asked:
        as_recorded = _search(records.as_recorded(captures), request, share)
        diagnosis = better_explained(records, diagnosis, as_recorded)
    return replace(diagnosis, known=request.known), notes


def _search_light(
    records: CheckedRecords, window: LightWindow, has_time: _Clock, tell: Callable[[str], None]
) -> Diagnosis | None:
    """The diagnosis in a window by the light that is found by speckle; None where none is, or the time ends before."""
    request, began = has_time.left(), time.monotonic()

    def progress(done: int, total: int, what: str) -> None:
        request.progress(done, total, what)
        if request.is_asked or time.monotonic() - began > _SPECKLE_SHARE * request.time_s:
            raise SearchEnded

    try:
        light = light_by_speckle(window, progress, tell, request.config.region)
        if request.is_asked:
            raise SearchEnded
    except SearchEnded:
        tell("The search by speckle was ended before it had found the light")
        return None
    if light is None:
        return None
    request = replace(has_time.left(), uncertain={**uncertainties(window.captures), **request.uncertain})
    return _search(replace(records, captures=window.captures), request, 1.0, light)


@dataclass(frozen=True)
class _Preparation:
    """The contexts of a diagnosis before its search begins. whole: of the pictures as they are. middle: of the middle
    of large pictures; None where it would save little. parts: of the middle and the corners; None as for the middle.
    weighted: predicts whole pictures with weighted stops. count: number of all captures. useless: captures that are
    left out. only: the captures that remain. notes: on effects that the captures can't show.
    """

    whole: SearchContext
    middle: SearchContext | None
    parts: SearchContext | None
    weighted: PerThreadPredictor
    count: int
    useless: Sequence[BadCapture]
    only: set[int]
    notes: list[str]


def _prepare(
    records: CheckedRecords, request: _Request, pool: WorkerPool, share: float, light: FoundLight | None = None
) -> _Preparation:
    """The contexts of a search that may spend a share of the budget. light: found by speckle before, which is judged in
    the parts that it was sought in, or in whole pictures."""
    config = request.config
    captures, cut_notes = within_limits(records.captures, request.sampling, config.region)
    useless = find_useless_captures(captures, request.known)
    whole, notes = prepare_search(captures, useless, request.candidates, request.known, request.sampling, config, pool)
    whole = _limited(whole, request, share)
    whole = replace(whole, has_open_sampling=request.has_open_sampling, left_by_samples=request.left_by_samples)
    with whole.measuring_pace():
        middle = middle_of_context(whole)
    parts = None
    if middle is not None and light is None:
        parts = parts_of_context(whole, middle.data.captures, request.known)
    weighted = PerThreadPredictor(partial(whole.predictor.create, has_weighted_stops=True))
    only = {*range(len(captures))} - {bad.index for bad in useless}
    if len(only) == 1:
        whole, notes = with_one_picture(whole, min(only)), [*notes, ONE_PICTURE_NOTE]
        middle, parts = None if middle is None else with_one_picture(middle, min(only)), None
    if light is not None and light.is_of_parts:
        like = middle_captures(captures, config.region)
        parts = parts_of_context(whole, like, request.known, light.values.get("beam"), min_saving=1.0)
        parts = replace(parts, split=whole.split) if parts is not None and len(only) == 1 else parts
    shared: dict[str, object] = {}
    if middle is not None:
        shared = {f"{name} of the middle": one for name, one in middle.shared_objects().items()}
        shared["predictor with weighted stops"] = weighted
    if parts is not None:
        shared |= {f"{name} of the parts": one for name, one in parts.shared_objects().items()}
    prepare = partial(_prepare_worker, _user_effect_files(request.candidates))
    needed = prediction_bytes(captures, request.sampling)
    needed += cache_bytes(captures)
    pool.share(shared | whole.shared_objects(), prepare, needed)
    if pool.workers < request.workers:
        cut_notes = [*cut_notes, f"{pool.workers} of {request.workers} processes worked: no more fit into the memory."]
    return _Preparation(whole, middle, parts, weighted, len(captures), useless, only, [*notes, *cut_notes])


def _limited(context: SearchContext, request: _Request, share: float) -> SearchContext:
    """The context with a share of the budget of fields and of the time, and with the receiver of its best results."""
    budget, samples = request.config.budget, field_samples(context.data.captures)
    end = SearchEnd(share * request.time_s, request.is_asked_to_end, _LAST_BEGIN)
    fields, so_far = math.inf if request.thorough else share * budget.fields_for(samples), request.so_far
    best: BestSoFar[SearchResult] = BestSoFar(
        None if so_far is None else lambda result: so_far(describe_so_far(result))
    )
    return replace(context, field_budget=fields, end=end, best_so_far=best)


def _with_noise_of_residuals(records: CheckedRecords, request: _Request) -> CheckedRecords:
    """The records with the noise that the nominal bench leaves, where nothing else told it.

    Known effects are corrected beside the nominal bench alone: beside other causes, errors of an assumed noise would
    choose.
    """
    if not is_noise_assumed(records.captures):
        return records
    known, silent = request.known, replace(request, so_far=None)
    if request.uncertain:
        with request.start_workers() as pool:
            prepared = _prepare(records, silent, pool, _CORRECTION_SHARE)
            found = corrections_alone(prepared.middle or prepared.whole, request.uncertain)
        known = add_effect_values(known, found)
    useless = [bad.index for bad in find_useless_captures(records.captures, known)]
    return replace(records, captures=with_noise_of_residuals(records.captures, useless, known, request.sampling))


def _with_corrected_known(records: CheckedRecords, request: _Request) -> tuple[_Request, tuple[str, ...]]:
    """The request with known effects corrected within their uncertainties, and notes on the corrections."""
    if not request.uncertain:
        return request, ()
    share, silent = _CORRECTION_SHARE, replace(request, so_far=None)
    with request.start_workers() as pool:
        prepared = _prepare(records, silent, pool, share)
        context = prepared.middle or prepared.whole
        corrections = known_corrections(context, request.uncertain, request.progress)
    known = add_effect_values(request.known, corrections or {})
    return replace(request, known=known), correction_notes(corrections, request.uncertain)


def _search(records: CheckedRecords, request: _Request, share: float, light: FoundLight | None = None) -> Diagnosis:
    """The diagnosis of captures with checked records, within a share of the budget. light: found by speckle before."""
    began = time.monotonic()
    request, assumed = _with_chosen_sampling(records.captures, request)
    put_right = None
    with request.start_workers() as pool:
        prepared = _prepare(records, request, pool, share, light)
        if light is None:
            outcome = _find_causes(prepared, request.progress, request.forecast or (lambda text: None))
        else:
            outcome, put_right = _judge_light(prepared, light, request)
        better = None if outcome.was_ended else outcome.better_sampling
        if better is None and put_right is None:
            outcome = replace(outcome, notes=[*assumed, *outcome.notes])
            diagnosis = _assembled(prepared, outcome, request)
    left_s = max(request.time_s - (time.monotonic() - began) / share, 0.0)
    if light is not None and put_right is not None:
        again = replace(request, known=add_effect_values(request.known, put_right), time_s=left_s)
        others = {name: own for name, own in outcome.result.best.fit.values.items() if name not in put_right}
        diagnosis = _search(records, again, share, replace(light, values=others))
        notes = (*correction_notes(put_right, request.uncertain), *diagnosis.notes)
        return replace(diagnosis, known=again.known, notes=notes)
    if better is not None:
        again = replace(request, sampling=better, has_open_sampling=False, time_s=left_s)
        diagnosis = _search(records, again, share, light)
        return replace(diagnosis, notes=(describe_better(better), *diagnosis.notes))
    return with_wrong_records(diagnosis, records)


def _with_chosen_sampling(captures: Captures, request: _Request) -> tuple[_Request, list[str]]:
    """The request with the sampling that suits the captures where neither they nor the caller state it; with a note."""
    if not request.has_open_sampling:
        return request, []
    if captures.camera.integrates is not None and captures.chain is None:
        return replace(request, has_open_sampling=False), []
    useless = [bad.index for bad in find_useless_captures(captures, request.known)]
    chosen = choose_sampling(captures, useless, request.known)
    if chosen is None:
        return request, []
    return replace(request, sampling=chosen.sampling, left_by_samples=chosen.may_leave), [chosen.note]


def _assembled(prepared: _Preparation, outcome: SearchOutcome, request: _Request) -> Diagnosis:
    wants_maps = request.free_maps and not prepared.whole.end.was_asked
    of_one_picture = len(prepared.only) == 1
    end = prepared.whole.end
    diagnosis = assemble(outcome, prepared.notes, wants_maps, request.progress, end, of_one_picture=of_one_picture)
    if of_one_picture:  # which was split into two
        only = min(prepared.only)
        samples = tuple(replace(sample, capture=only) for sample in diagnosis.samples)
        diagnosis = replace(diagnosis, samples=samples)
    return diagnosis


def _judge_light(
    prepared: _Preparation, light: FoundLight, request: _Request
) -> tuple[SearchOutcome, FittedValues | None]:
    """The causes that stand for the light that was found by speckle, judged by least squares: in whole pictures, or in
    parts of large ones and then in these.

    Where some of them are no more than errors of what was estimated, these come beside an outcome that isn't judged.
    """
    whole, are_searched, progress = prepared.whole, light.after > NEAR_CORRELATION, request.progress
    torch.set_num_threads(whole.workers.workers)  # one fit after another, here, of large fields
    judge = partial(judge_captures, useless=prepared.useless, count=prepared.count, progress=progress)
    context = whole
    if prepared.parts is not None:
        progress(0, 1, "light from beyond the parts")
        context = replace(prepared.parts, missing_light=measure_missing_light(whole, prepared.parts))

    def search_from(*starts: FittedValues) -> Callable[[Collection[int]], SearchOutcome]:
        fits = tuple(CandidateFit(tuple(values), values, math.inf) for values in starts)
        beside = _BESIDE_LIGHT if len(prepared.only) > 1 else 0
        initial = InitialCandidates(fits, are_searched, over_field_only=True, has_fine=True, beside=beside)
        return partial(search_once, context, progress=progress, initial=initial)

    estimated: dict[str, dict[str, Any]] = {
        name: {} for name in request.uncertain if name in whole.effects and name not in request.known
    }
    search = search_from({**estimated, **light.values})
    found = search(whole.left_out)
    best, nominal = found.result.best, found.result.nominal
    if found.better_sampling is not None:
        return found, None
    if not found.was_ended and (put_right := errors_of_estimates(found.result, request.uncertain, request.known)):
        return found, put_right
    if not found.was_ended and best.excess < _DECIDING_SHARE * nominal.excess:
        search = search_from(best.fit.values, with_or_without_unmodulated(best.fit.values))
        found = search(whole.left_out)
        if found.better_sampling is not None:
            return found, None
    if context is whole:
        outcome = judge(whole, found, search)
    else:  # whole pictures tell which causes are needed: in a part a beam may be as good as even light
        found = replace(found, decision=Decision(Verdict.PARTLY, found.result.best))
        outcome = _judged_whole(whole, found, found, True, Refit.NEVER, judge, progress)
        if (middle := prepared.middle) is not None:
            middle = replace(middle, missing_light=context.missing_light, end=NEVER)
        outcome = replace(outcome, middle=middle)
    outcome = replace(outcome, notes=[*outcome.notes, describe_light(light)])
    if outcome.decision.verdict is not Verdict.PARTLY or outcome.decision.best is None:
        return outcome, None
    named = outcome.decision.best.fit  # far from the captures, derivatives tell nothing of what looks alike
    alike = Lookalikes(named, {cause: {} for cause in named.causes}, {cause: {} for cause in named.causes})
    return replace(outcome, result=replace(outcome.result, lookalikes=alike)), None


def _find_causes(prepared: _Preparation, progress: ProgressCallback, forecast: TextCallback) -> SearchOutcome:
    """The causes and the bad captures: searched in the middle of large pictures, refined and judged in whole
    pictures. forecast: is told how much work that is."""
    whole = prepared.whole
    judge = partial(judge_captures, useless=prepared.useless, count=prepared.count, progress=progress)
    if prepared.middle is None:
        search = partial(search_once, whole, progress=progress)
        found = search(_doubtful(whole, progress, forecast, []))
        return found if found.better_sampling is not None else judge(whole, found, search)
    progress(0, 1, "light from beyond the middle")
    with whole.measuring_pace():
        missing = measure_missing_light(whole, prepared.middle)
    middle = replace(prepared.middle, missing_light=missing)
    is_corrected = not whole.data.captures.is_fourier and len(prepared.only) > 1
    search = partial(search_once, middle, progress=progress)
    later = [middle, *([prepared.parts] if prepared.parts is not None else []), whole] if is_corrected else [whole]
    found = search(_doubtful(middle, progress, forecast, later))
    where = describe_middle(middle)
    if found.better_sampling is not None and not whole.end.was_asked:
        return found
    if whole.end.was_asked:
        outcome = judge(middle, found, search)
        return replace(outcome, notes=[*outcome.notes, f"{where}; whole pictures weren't looked at."])
    if whole.data.captures.slm_frame is not None:  # whole pictures are cut too: known as well as in a smaller part
        whole = replace(whole, missing_light=missing)
    if is_corrected:
        progress(0, 1, "light from beyond the middle, as predicted")
        whole = with_fitting_stops(whole, prepared.weighted, found.decision.values)
        first, found = found, _found_without_light_from_beyond(whole, found, prepared.middle.field_budget, progress)
    fitted = None
    if is_corrected and prepared.parts is not None:
        fitted = _fitted_to_parts(whole, replace(prepared.parts, missing_light=missing), first, found, progress)
    refit = Refit.ALWAYS if fitted is None else Refit.UNLESS_EXPLAINED
    outcome = _judged_whole(whole, found, fitted, is_corrected, refit, judge, progress)
    is_of_parts = outcome.fitted is not None
    how = "five parts fitted them, whole ones judged" if is_of_parts else "whole pictures fitted and judged them"
    return replace(outcome, notes=list(dict.fromkeys([*found.notes, *outcome.notes, f"{where}; {how}."])))


def _judged_whole(
    whole: SearchContext,
    found: SearchOutcome,
    fitted: SearchOutcome | None,
    is_corrected: bool,
    refit: Refit,
    judge: Callable[..., SearchOutcome],
    progress: ProgressCallback,
) -> SearchOutcome:
    """The outcome in whole pictures of the causes found in the middle, and perhaps fitted to parts.

    is_corrected: whether the light from beyond the middle was subtracted. judge: judges every capture by an outcome.
    """
    whole.workers.rest()  # they hold a gigabyte each, and whole pictures are mostly fitted here
    torch.set_num_threads(whole.workers.workers)  # most of what follows runs here, a few large fields at a time
    whole = _with_findings_of(found.context, whole)
    last = fitted or found
    explains = last.decision.verdict not in _OPEN
    initial = InitialCandidates(_named_fits(last), explains, is_corrected, refit)
    refine = partial(search_once, whole, progress=progress, initial=initial)
    outcome = judge(whole, refine(found.context.left_out), refine)
    if outcome.result.best.causes == found.result.best.causes:
        unseen = found.result.unseen_rivals
        outcome = replace(outcome, result=replace(outcome.result, unseen_rivals=unseen))
    are_of_parts = fitted is not None and outcome.result.best.fit in initial.fits
    return replace(outcome, middle=found.context, fitted=fitted.context if fitted and are_of_parts else None)


def _with_findings_of(first: SearchContext, further: SearchContext) -> SearchContext:
    """The context of a further search with the nuisances of a first one, which has decided on samples, too."""
    jitter = first.has_camera_jitter
    return replace(further, prnu=first.prnu, has_camera_jitter=jitter, has_open_sampling=False)


def _fitted_to_parts(
    whole: SearchContext,
    parts: SearchContext,
    first: SearchOutcome,
    found: SearchOutcome,
    progress: ProgressCallback,
) -> SearchOutcome | None:
    """The outcome of a search in parts of the pictures that starts from that in their middle, `found`; None where its
    causes are too far from the truth to predict the light from beyond the parts.

    first: the outcome of the earlier search in the middle, with whose values the light from beyond the parts was
    predicted. This prediction serves as long as `found` names the same causes. Further causes change the light from
    beyond the parts; they are then fitted once more without that light.
    """
    outcome = None
    for _ in range(_PART_ROUNDS):
        causes = {*found.decision.values}
        values = (first if {*first.decision.values} == causes else found).decision.values
        if found.context.relative_model_error(found.decision.values) > LOCAL_MAX_ERROR:
            break
        progress(0, 1, "light from beyond the parts")
        corrected = without_light_from_beyond(whole, parts, values)
        corrected = _with_findings_of(found.context, corrected)
        initial = InitialCandidates(_named_fits(found), are_searched=True, over_field_only=True)
        found = outcome = search_once(corrected, found.context.left_out, progress, initial)
        if {*found.decision.values} == causes or found.was_ended:
            break
    return outcome


def _doubtful(
    context: SearchContext, progress: ProgressCallback, forecast: TextCallback, later: Sequence[SearchContext]
) -> Collection[int]:
    """The captures that stand out, whose predictions tell how long the search takes, and later searches after it."""
    with context.measuring_pace():
        doubtful = doubtful_captures(context, progress)
    a_field = context.pace.first
    for one in later:
        if one.windows and one.pace.first is None and a_field is not None:  # parts, each of which is like the middle
            one.pace.first = len(one.windows) * a_field
    forecast(describe_work([context, *later]))
    return doubtful


def _found_without_light_from_beyond(
    whole: SearchContext, found: SearchOutcome, field_budget: float, progress: ProgressCallback
) -> SearchOutcome:
    """The outcome of a search in the middle, and of a further one that starts from it, without the light from beyond
    the middle, which hides weak faults. As it was where its causes are too far from the truth to predict that light.
    """
    values = found.decision.values
    if found.context.relative_model_error(values) > LOCAL_MAX_ERROR:
        return found
    corrected = detect_nuisances(without_light_from_beyond(whole, found.context, values), values)
    corrected = replace(corrected, field_budget=field_budget, end=whole.end.after_share(MAX_TIME_SHARE))
    initial = InitialCandidates(_named_fits(found), are_searched=True)
    again = search_once(corrected, found.context.left_out, progress, initial)
    unseen = found.result.unseen_rivals if again.result.best.causes == found.result.best.causes else ()
    notes = list(dict.fromkeys([*found.notes, *again.notes]))
    return replace(again, result=replace(again.result, unseen_rivals=unseen), notes=notes)


def _named_fits(found: SearchOutcome) -> tuple[CandidateFit, ...]:
    """The best candidate of a search and its rivals."""
    named = (found.decision.best, *found.decision.rivals)
    return tuple(score.fit for score in named if score is not None)


def _prepare_worker(effect_files: Sequence[str]) -> None:
    """Prepares another process for the jobs of a diagnosis."""
    torch.set_num_threads(1)
    for file in effect_files:
        load_user_effects(file)


def _user_effect_files(effects: Sequence[Effect]) -> list[str]:
    return sorted({inspect.getfile(type(effect)) for effect in effects if is_user_effect(effect)})


def prepare_search(
    captures: Captures,
    useless: Sequence[BadCapture],
    effects: Sequence[Effect],
    known: Values,
    sampling: SamplingConfig,
    config: SearchConfig,
    pool: WorkerPool,
) -> tuple[SearchContext, list[str]]:
    """The context of a search, and notes on effects that these captures can't show.

    useless: captures that are left out. effects: the candidates. known: effects that the nominal model has. Raises
    UserError when no capture is left.
    """
    left_out = tuple(bad.index for bad in useless)
    kept = [k for k in range(len(captures)) if k not in left_out]
    if not kept:
        raise UserError("captures", "every one is dark or saturated", remedy="check shutter and exposures")
    properties = (captures.subset(kept) if left_out else captures).data_properties()
    unmet = {e.id: unmet_by_data(e, properties) for e in effects}
    visible = {e.id: effect_on_bench(e, properties) for e in effects if not unmet[e.id]}
    others = [e for e in effects if unmet[e.id] and not unmet_by_bench(e, properties)]
    unseen = {e.id: e for e in others if not changes_only_power(e)}
    notes = [f"{name} can't be seen in these captures: {why}." for name, why in unmet.items() if why]
    if properties.wavelengths == 1:
        notes.append("With one wavelength, errors of the wavelength and of distances can't be told apart.")
    if properties.planes == 1 and not properties.is_fourier:
        notes.append("With one plane, a wrong wavelength looks much like a wrong distance.")
    notes += [f"Estimated, because nobody stated it: {sentence}." for sentence in captures.estimated]
    options = {"captures": captures, "known_values": known, **sampling.keywords}
    data = prepare_captures(captures)
    context = SearchContext(
        data=data,
        system=ActiveEffects(known).actual_system(captures.nominal_system()),
        effects=visible,
        split=split_captures(captures, pattern_roughness(captures), left_out),
        predictor=PerThreadPredictor(partial(PredictorWithKnownEffects, **options)),
        workers=pool,
        variances=NeighbourVariances(data),
        config=config,
        sampling=sampling,
        equivalents=equivalent_effects(visible, properties),
        unseen=unseen,
        left_out=left_out,
    )
    return context, notes
