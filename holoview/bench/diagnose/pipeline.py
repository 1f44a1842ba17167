"""From captures to a diagnosis: prepare, search, decide, and state how certain it is."""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

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
    known_corrections,
)
from holoview.bench.diagnose.capture_split import split_captures
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.correct.bad_captures import BadCapture, find_useless_captures
from holoview.bench.diagnose.correct.wrong_records import CheckedRecords, check_records
from holoview.bench.diagnose.crop import middle_captures, middle_of_context, within_limits
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects, add_effect_values
from holoview.bench.diagnose.fit import FittedValues
from holoview.bench.diagnose.judge import SearchResult
from holoview.bench.diagnose.likelihood import Values
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
from holoview.bench.diagnose.search import MAX_FURTHER_EXCESS_SHARE
from holoview.bench.diagnose.search_context import (
    BestSoFar,
    NeighbourVariances,
    PerThreadPredictor,
    SearchContext,
    SearchEnd,
    SearchEnded,
    describe_so_far,
    equivalent_effects,
    field_samples,
)
from holoview.bench.diagnose.single_capture import ONE_PICTURE_NOTE, with_one_picture
from holoview.bench.diagnose.speckle_evidence import FAR_CHI2, LightWindow, light_by_speckle, window_for_light
from holoview.bench.diagnose.speckle_search import FoundLight
from holoview.bench.diagnose.steps import DECIDING_SHARE, Views, Where, find_causes_in_views, judge_light
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
_LAST_BEGIN = 0.7
"""[1] After this share of the time nothing new is begun, so that fits underway end in time. Evidence: measured: the
longest step of a pair, each cause fitted without the other, took 20 of 80 s."""
_LEAST_LEFT = 0.15
"""[1] Of the time, with less of which no other search begins. Evidence: a reason: its preparation takes as long."""


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
    """The arguments of `diagnose` but for the captures.

    has_open_sampling: neither the caller nor, so far, the captures say how the light is sampled. left_by_samples:
    excess of χ²/n, where the captures chose them.
    """

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
    has_open_sampling: bool
    left_by_samples: float = 0.0

    def start_workers(self) -> WorkerPool:
        """Processes for a search."""
        return WorkerPool(self.workers, self.config.budget.worker_start_s)

    def within(self, clock: SearchEnd, share: float = 1.0) -> _Request:
        """The request with a share of the time that is left."""
        return replace(self, time_s=share * max(clock.seconds_left, 0.0))

    @property
    def is_asked(self) -> bool:
        """Whether the caller has asked for the end of the search."""
        return self.is_asked_to_end is not None and self.is_asked_to_end()


def _diagnose(captures: Captures, request: _Request) -> Diagnosis:
    """Leaves out clipped counts, puts records right, corrects known effects that were measured, and searches."""
    said: list[str] = []
    captures = with_clipped_as_saturated(captures, said.append)
    records = check_records(captures, request.known)
    clock = SearchEnd(request.time_s)
    window = None if request.known else window_for_light(records.captures, [e.id for e in request.candidates])

    def told(diagnosis: Diagnosis, notes: tuple[str, ...] = ()) -> Diagnosis:
        return replace(diagnosis, notes=(*diagnosis.notes, *notes, *(f"{text}." for text in said)))

    by_light = None
    if window is not None and window.is_first:
        by_light = _search_light(records, window, request.within(clock), clock, said.append, {})
        is_nearly_over = max(clock.seconds_left, 0.0) < _LEAST_LEFT * clock.time_s
        if by_light is not None and (
            captures.is_fourier or not _lacks_much(by_light) or request.is_asked or is_nearly_over
        ):
            return told(by_light)
        window = None
    usual, notes = _search_causes(captures, records, request.within(clock, _USUAL_SHARE if window else 1.0))
    if window is not None and usual.verdict.is_open and not request.is_asked:
        by_light = _search_light(records, window, request.within(clock), clock, said.append, usual.values)
    if by_light is None or not by_light.causes:
        return told(usual, notes)
    is_by_light = _is_clearly_better(by_light, usual) if window else not _is_clearly_better(usual, by_light)
    return told(by_light) if is_by_light else told(usual, notes)


def _is_clearly_better(later: Diagnosis, earlier: Diagnosis) -> bool:
    """Whether the later of two searches explains what the earlier leaves open, or leaves clearly less: one that leaves
    about as much has nothing to add."""
    left, before = (max(one.after.chi2_per_pixel - 1.0, 0.0) for one in (later, earlier))
    explains = earlier.verdict.is_open and not later.verdict.is_open
    return explains or left < MAX_FURTHER_EXCESS_SHARE * before


def _lacks_much(diagnosis: Diagnosis) -> bool:
    """Whether it leaves so much unexplained that another search may find more."""
    left = diagnosis.after.chi2_per_pixel
    return diagnosis.verdict.is_open and left > FAR_CHI2 and diagnosis.unexplained > DECIDING_SHARE


def _search_causes(captures: Captures, records: CheckedRecords, request: _Request) -> tuple[Diagnosis, tuple[str, ...]]:
    """The diagnosis by derivatives, of corrected records and where these are doubtful as recorded, with notes."""
    share = 0.5 if records.are_doubtful else 1.0
    request, _ = _with_chosen_sampling(records.captures, request)
    request = replace(request, uncertain={**uncertainties(records.captures), **request.uncertain})
    records = _with_noise_of_residuals(records, request)
    request, notes = _with_corrected_known(records, request)
    diagnosis = _search(records, request, share)
    if records.are_doubtful and diagnosis.verdict.is_open and not request.is_asked:
        as_recorded = _search(records.as_recorded(captures), request, share)
        diagnosis = better_explained(records, diagnosis, as_recorded)
    return replace(diagnosis, known=request.known), notes


def _search_light(
    records: CheckedRecords,
    window: LightWindow,
    request: _Request,
    clock: SearchEnd,
    tell: TextCallback,
    earlier: FittedValues,
) -> Diagnosis | None:
    """The diagnosis in a window by the light that is found by speckle; None where none is, or the time ends before.

    earlier: values of the causes that a search by derivatives has named.
    """
    end = SearchEnd(_SPECKLE_SHARE * request.time_s, request.is_asked_to_end)

    def progress(done: int, total: int, what: str) -> None:
        request.progress(done, total, what)
        end.check()

    try:
        light = light_by_speckle(window, progress, tell, request.config.region, earlier, request.workers)
        if request.is_asked:
            raise SearchEnded
    except SearchEnded:
        tell("The search by speckle was ended before it had found the light")
        return None
    if light is None:
        return None
    request = request.within(clock)
    request = replace(request, uncertain={**uncertainties(window.captures), **request.uncertain})
    return _search(replace(records, captures=window.captures), request, 1.0, light)


def _prepare(
    captures: Captures, request: _Request, pool: WorkerPool, share: float, light: FoundLight | None = None
) -> Views:
    """The views of a search that may spend a share of the budget of fields and of the time. light: found by speckle
    before, which is judged in the parts that it was sought in, or in whole pictures."""
    config, known = request.config, request.known
    captures, cut_notes = within_limits(captures, request.sampling, config.region)
    useless = find_useless_captures(captures, known)
    whole, notes = prepare_search(captures, useless, request.candidates, known, request.sampling, config, pool)
    fields, so_far = config.budget.fields_for(field_samples(captures, request.sampling)), request.so_far
    best: BestSoFar[SearchResult] = BestSoFar(
        None if so_far is None else lambda result: so_far(describe_so_far(result))
    )
    whole = replace(
        whole,
        field_budget=math.inf if request.thorough else share * fields,
        end=SearchEnd(share * request.time_s, request.is_asked_to_end, _LAST_BEGIN),
        best_so_far=best,
        has_open_sampling=request.has_open_sampling,
        left_by_samples=request.left_by_samples,
    )
    with whole.measuring_pace():
        middle = middle_of_context(whole)
    parts = None
    if middle is not None and light is None:
        parts = parts_of_context(whole, middle.data.captures, known)
    weighted = PerThreadPredictor(partial(whole.predictor.create, has_weighted_stops=True))
    only = {*range(len(captures))} - {bad.index for bad in useless}
    if len(only) == 1:
        whole, notes = with_one_picture(whole, min(only)), [*notes, ONE_PICTURE_NOTE]
        middle, parts = None if middle is None else with_one_picture(middle, min(only)), None
    if light is not None and light.is_of_parts:
        like = middle_captures(captures, config.region)
        parts = parts_of_context(whole, like, known, light.values.get("beam"), min_saving=1.0)
        parts = replace(parts, split=whole.split) if parts is not None and len(only) == 1 else parts
    views = {Where.WHOLE: whole, Where.MIDDLE: middle, Where.PARTS: parts}
    of = {where: view for where, view in views.items() if view is not None}
    shared: dict[str, object] = {} if middle is None else {"predictor with weighted stops": weighted}
    for where, view in of.items():
        shared |= {f"{name} of {where.value}": one for name, one in view.shared_objects().items()}
    files = sorted({inspect.getfile(type(effect)) for effect in request.candidates if is_user_effect(effect)})
    needed = prediction_bytes(captures, request.sampling) + cache_bytes(captures)
    pool.share(shared, partial(_prepare_worker, files), needed)
    if pool.workers < request.workers:
        cut_notes = [*cut_notes, f"{pool.workers} of {request.workers} processes worked: no more fit into the memory."]
    return Views(of, weighted, len(captures), useless, only, [*notes, *cut_notes])


@contextmanager
def _for_corrections(records: CheckedRecords, request: _Request) -> Iterator[SearchContext]:
    """What corrections of known effects work with."""
    with request.start_workers() as pool:
        yield _prepare(records.captures, replace(request, so_far=None), pool, _CORRECTION_SHARE).first


def _with_noise_of_residuals(records: CheckedRecords, request: _Request) -> CheckedRecords:
    """The records with the noise that the nominal bench leaves, where nothing else told it.

    Known effects are corrected beside the nominal bench alone: beside other causes, errors of an assumed noise would
    choose.
    """
    if not is_noise_assumed(records.captures):
        return records
    known = request.known
    if request.uncertain:
        with _for_corrections(records, request) as context:
            known = add_effect_values(known, corrections_alone(context, request.uncertain))
    useless = [bad.index for bad in find_useless_captures(records.captures, known)]
    return replace(records, captures=with_noise_of_residuals(records.captures, useless, known, request.sampling))


def _with_corrected_known(records: CheckedRecords, request: _Request) -> tuple[_Request, tuple[str, ...]]:
    """The request with known effects corrected within their uncertainties, and notes on the corrections."""
    if not request.uncertain:
        return request, ()
    with _for_corrections(records, request) as context:
        corrections = known_corrections(context, request.uncertain, request.progress)
    known = add_effect_values(request.known, corrections or {})
    return replace(request, known=known), correction_notes(corrections, request.uncertain)


def _search(records: CheckedRecords, request: _Request, share: float, light: FoundLight | None = None) -> Diagnosis:
    """The diagnosis of captures with checked records, within a share of the budget. light: found by speckle before."""
    began, progress = time.monotonic(), request.progress
    request, assumed = _with_chosen_sampling(records.captures, request)
    with request.start_workers() as pool:
        views = _prepare(records.captures, request, pool, share, light)
        if light is None:
            outcome = find_causes_in_views(views, progress, request.forecast or (lambda text: None))
        else:
            outcome = judge_light(views, light, request.known, request.uncertain, progress)
        better, put_right = None if outcome.was_ended else outcome.better_sampling, outcome.put_right
        if better is None and not put_right:
            outcome, end = replace(outcome, notes=[*assumed, *outcome.notes]), views.whole.end
            maps = request.free_maps and not end.was_asked
            diagnosis = assemble(outcome, views.notes, maps, progress, end, of_one_picture=views.is_one)
            if views.is_one:  # which was split into two
                samples = tuple(replace(sample, capture=min(views.only)) for sample in diagnosis.samples)
                diagnosis = replace(diagnosis, samples=samples)
            return with_wrong_records(diagnosis, records)
    again = replace(request, time_s=max(request.time_s - (time.monotonic() - began) / share, 0.0))
    if better is not None:
        diagnosis = _search(records, replace(again, sampling=better, has_open_sampling=False), share, light)
        return replace(diagnosis, notes=(describe_better(better), *diagnosis.notes))
    again = replace(again, known=add_effect_values(request.known, put_right))
    others, earlier = (
        {name: own for name, own in values.items() if name not in put_right}
        for values in (outcome.result.best.fit.values, light.earlier if light else {})
    )
    diagnosis = _search(records, again, share, light and replace(light, values=others, earlier=earlier))
    notes = (*correction_notes(put_right, request.uncertain), *diagnosis.notes)
    return replace(diagnosis, known=again.known, notes=notes)


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


def _prepare_worker(effect_files: Sequence[str]) -> None:
    """Prepares another process for the jobs of a diagnosis."""
    torch.set_num_threads(1)
    for file in effect_files:
        load_user_effects(file)


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
