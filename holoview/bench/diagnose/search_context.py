"""The shared state of a search: captures, nominal bench, effects, predictors, workers, settings; and its end.

SearchEnd      when a search has to end: after some time, or when the caller asks for it
BestSoFar      the best result until then
SearchContext  everything that the stages share
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import PLAIN, Prediction, SamplingConfig
from holoview.bench.captures.prepared_captures import Images, PreparedCaptures, add_model_error, neighbour_variance
from holoview.bench.diagnose.capture_split import CaptureSplit
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.likelihood import Comparison, PredictorProtocol, Values
from holoview.bench.diagnose.worker_pool import FinishedCallback, WorkerPool
from holoview.light.model.effects.effect import DataProperties, Effect
from holoview.light.model.system import System
from holoview.util.processes import process_cpu_count
from holoview.util.progress import ProgressCallback
from holoview.util.units import format_duration

MAX_TOLERATED_ERROR = 1.0
"""[error] Weights tolerate at most so large an error of the model. Evidence: the search study screened with weights
that tolerate an error of the mean light."""
_HALF_TOLERATED_ERROR = 0.5
"""[1] First joint fits tolerate this share of the present error, up to this error. Evidence: the search study."""
_MIN_PACE_FIELDS = 100  # [fields] From so many on, their time tells the time of the others.
_SCREENING_FACTOR = 4.0
"""[1] After so many times the budget of fields, no further effect is tried alone. Evidence: single faults of 128 × 96
modulator pixels take less than half of the budget, and a search whose fields take a second each has to end."""


class _Score(Protocol):
    @property
    def causes(self) -> tuple[str, ...]: ...
    @property
    def chi2_per_pixel(self) -> float: ...
    @property
    def excess(self) -> float: ...


class _Result(Protocol):
    @property
    def nominal(self) -> _Score: ...
    @property
    def best(self) -> _Score: ...
    @property
    def candidates(self) -> tuple[Any, ...]: ...


R = TypeVar("R", bound=_Result)


class SearchEnded(Exception):
    """Raised where light is predicted, once a search has to end."""


class SearchEnd:
    """When a search has to end.

    time_s: after so long, counted from now. is_asked: whether the caller wants the search to end; only this process
    asks. last_begin: share of the time after which nothing new is begun.
    """

    def __init__(
        self,
        time_s: float = math.inf,
        is_asked: Callable[[], bool] | None = None,
        last_begin: float = 1.0,
    ) -> None:
        self._began = time.monotonic()  # the same clock in all processes of a machine
        self.time_s, self._last_begin = time_s, last_begin
        self._is_asked = is_asked

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_is_asked": None}

    def after_share(self, share: float) -> SearchEnd:
        """The end of a part of the search that may take this share of the time, counted from the same beginning."""
        part = SearchEnd(share * self.time_s, self._is_asked, self._last_begin)
        part._began = self._began
        return part

    def check(self) -> None:
        """Raises SearchEnded once the time is over or the caller asked for the end."""
        if self.seconds_left < 0.0 or self.was_asked:
            raise SearchEnded

    @property
    def last_begin_s(self) -> float:
        """Seconds from the beginning after which nothing new is begun."""
        return self._last_begin * self.time_s

    @property
    def is_near(self) -> bool:
        """Whether too little time is left to begin something new."""
        return time.monotonic() - self._began > self.last_begin_s

    @property
    def seconds_left(self) -> float:
        """Seconds until the time is over; negative afterwards."""
        return self._began + self.time_s - time.monotonic()

    @property
    def was_asked(self) -> bool:
        """Whether the caller asked for the end."""
        return self._is_asked is not None and self._is_asked()


NEVER = SearchEnd()


class Pace:
    """How fast a search computes fields on this machine, from its beginning to the last count.

    first: seconds a field takes, for as long as the search has computed few; None: not known.
    """

    def __init__(self) -> None:
        self.first: float | None = None
        self._begin: tuple[float, int] | None = None
        self._last = (0.0, 0)

    def seconds_for(self, fields: float, done: int) -> float | None:
        """Expected seconds of so many more fields; None while nothing was measured. done: number of fields so far."""
        now = time.monotonic()
        if self._begin is None:
            self._begin = self._last = (now, done)
        if done > self._last[1]:
            self._last = (now, done)
        seconds, counted = (last - begin for last, begin in zip(self._last, self._begin, strict=True))
        a_field = self.first if counted < _MIN_PACE_FIELDS else seconds / counted
        return None if a_field is None else fields * a_field


def describe_so_far(result: _Result) -> str:
    """A sentence on the best result of a search so far."""
    before, after = result.nominal.chi2_per_pixel, result.best.chi2_per_pixel
    if not result.best.causes:
        return f"no cause yet (held-out captures: χ²/n {before:.4g}, noise: 1)"
    return f"{' and '.join(result.best.causes)} (held-out captures: χ²/n {before:.4g} → {after:.4g}, noise: 1)"


class BestSoFar(Generic[R]):
    """The best result of a search so far.

    on_change: is told the result whenever it names other causes than the result before, or leaves less than half of the
    excess. A repeated search begins without causes: its first results aren't told if an earlier search named some.
    """

    def __init__(self, on_change: Callable[[R], None] | None = None) -> None:
        self._on_change, self._has_named = on_change, False
        self.result: R | None = None

    def __getstate__(self) -> dict[str, object]:
        return {"_on_change": None, "_has_named": False, "result": None}  # only the first process tells

    def note(self, result: R) -> None:
        """Keeps a result; a result without candidates is kept only if there is no other."""
        before, self.result = self.result, result if result.candidates or self.result is None else self.result
        if self.result is before or self._on_change is None:
            return
        if self._has_named and not self.result.best.causes:
            return
        self._has_named |= bool(self.result.best.causes)
        same = before is not None and before.best.causes == self.result.best.causes
        if not same or before is None or 2 * self.result.best.excess < before.best.excess:
            self._on_change(self.result)

    def clear(self) -> None:
        """Forgets the result, for a search that begins anew."""
        self.result = None


T = TypeVar("T")


class PerThreadPredictor:
    """A predictor for each thread that asks for one, since a predictor's cache can't be shared.

    create: makes a new one; it accepts the keywords of `Predictor`, such as `extra_effects` and `cache_mb`.
    end: of the search that asks for predictions; afterwards a prediction raises SearchEnded.
    """

    def __init__(self, create: Callable[..., PredictorProtocol]) -> None:
        self.create, self._local = create, threading.local()
        self._predictors: list[PredictorProtocol] = []
        self.fields_in_workers = 0
        self.end = NEVER

    def __reduce__(self) -> tuple[Any, ...]:
        return PerThreadPredictor, (self.create,)

    @property
    def fields_requested(self) -> int:
        """How many fields all threads, and other processes, have asked for; read it while no thread works."""
        return sum(one.fields_requested for one in self._predictors) + self.fields_in_workers

    @property
    def thread_fields(self) -> int:
        """How many fields this thread has asked for."""
        return self._local.predictor.fields_requested if hasattr(self._local, "predictor") else 0

    def counted(self, **options: Any) -> PredictorProtocol:
        """Another predictor, perhaps of other captures, whose fields count as well. options: of `create`."""
        self._predictors.append(self.create(**options))
        return self._predictors[-1]

    def __call__(self, indices: NDArray[np.intp], values: Values, *, grad: bool = False) -> Prediction:
        self.end.check()
        if not hasattr(self._local, "predictor"):
            self._local.predictor = self.counted()
        prediction: Prediction = self._local.predictor(indices, values, grad=grad)
        return prediction


class NeighbourVariances:
    """The noise variance (counts²) that the captures themselves suggest. Variances of the latest selections of captures
    are kept. max_bytes: of the kept variances, beside that of the latest selection.
    """

    def __init__(self, data: PreparedCaptures, max_bytes: int = 256 << 20) -> None:
        self._data, self._max_bytes = data, max_bytes
        self._variances: dict[tuple[int, ...], Images] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return NeighbourVariances, (self._data, self._max_bytes)

    @property
    def kept_bytes(self) -> int:
        """Bytes of all variances that are kept."""
        return sum(kept.nbytes for kept in self._variances.values())

    def __call__(self, indices: NDArray[np.intp]) -> Images:
        key = tuple(int(k) for k in indices)
        found = self._variances.pop(key) if key in self._variances else neighbour_variance(self._data, indices)
        while self._variances and self.kept_bytes + found.nbytes > self._max_bytes:
            self._variances.pop(next(iter(self._variances)))
        self._variances[key] = found
        return found


@dataclass(frozen=True)
class SearchContext:
    """The shared state of the stages of a search.

    data: the captures, prepared. system: the nominal bench, with known effects. effects: the candidates by id. split:
    the captures that are searched, fitted and held out. predictor: predicts captures, sampled as `sampling` says.
    left_by_samples: excess of χ²/n that samples may leave which were chosen by these captures. workers: run jobs in
    parallel. variances: of the noise, from the captures. config: settings of all stages. field_budget: after so many
    fields a search begins nothing new that takes long. prnu: standard deviation of the pixels' relative sensitivity.
    has_camera_jitter: whether the camera moves from capture to capture, so that comparisons fit its movements.
    equivalents: for each effect the others that are the same physics on this bench. unseen: effects by id that such
    captures can't tell from others, and that aren't candidates. left_out: captures that no fit uses, by index. end:
    when the search has to end. best_so_far: its best result. pace: how fast it is. missing_light: (capture,), r.m.s.
    error over mean light of predictions that lack the light from beyond modulators that were cut; None where nothing
    was cut. windows: rows and columns, in whole pictures, of the parts that these pictures show one below the other;
    none where they are whole.
    """

    data: PreparedCaptures
    system: System
    effects: dict[str, Effect]
    split: CaptureSplit
    predictor: PerThreadPredictor
    workers: WorkerPool
    variances: NeighbourVariances
    config: SearchConfig = field(default_factory=SearchConfig)
    sampling: SamplingConfig = PLAIN
    has_open_sampling: bool = False
    left_by_samples: float = 0.0
    field_budget: float = math.inf
    prnu: float = 0.0
    has_camera_jitter: bool = False
    equivalents: Mapping[str, frozenset[str]] = field(default_factory=dict)
    unseen: dict[str, Effect] = field(default_factory=dict)
    left_out: tuple[int, ...] = ()
    end: SearchEnd = NEVER
    best_so_far: BestSoFar[Any] = field(default_factory=BestSoFar)
    pace: Pace = field(default_factory=Pace)
    missing_light: NDArray[np.float64] | None = None
    windows: tuple[tuple[slice, slice], ...] = ()

    @property
    def kept(self) -> NDArray[np.intp]:
        """Indices of the captures that aren't left out."""
        return np.setdiff1d(np.arange(len(self.data.captures)), np.array(self.left_out, dtype=np.intp))

    @property
    def budget_exhausted(self) -> bool:
        """Whether the budget of fields, or the time, is nearly spent, so that nothing new is begun.

        Read only while no job runs, so that workers change no result unless the time is limited.
        """
        return self.predictor.fields_requested > self.field_budget or self.end.is_near

    @property
    def fields_left(self) -> float:
        """How many fields of the budget aren't spent; read as `budget_exhausted`."""
        return max(self.field_budget - self.predictor.fields_requested, 0.0)

    @contextmanager
    def measuring_pace(self) -> Iterator[None]:
        """Measures how long a field takes, with those that the block predicts in this process."""
        began, before = time.monotonic(), self.predictor.fields_requested
        yield
        if fields := self.predictor.fields_requested - before:
            side_by_side = min(self.workers.workers, process_cpu_count())
            self.pace.first = (time.monotonic() - began) / (fields * side_by_side)

    def telling_time_left(self, progress: ProgressCallback) -> ProgressCallback:
        """Progress whose notes say how long the search will take at most on this machine."""

        def told(done: int, total: int, note: str) -> None:
            computed = self.predictor.fields_requested
            by_fields = self.pace.seconds_for(self.fields_left, computed)
            left = min(math.inf if by_fields is None else by_fields, self.end.seconds_left)
            words = f"{note} (at most {format_duration(max(left, 1.0))} more)" if left < math.inf else note
            progress(done, total, words)

        return told

    @property
    def kept_captures(self) -> Captures:
        """The captures that aren't left out."""
        return self.data.captures.subset(self.kept) if self.left_out else self.data.captures

    @property
    def screening_exhausted(self) -> bool:
        """Whether so much of the budget is spent that no further effect is tried alone. Read as `budget_exhausted`."""
        return self.end.is_near or self.predictor.fields_requested > (_SCREENING_FACTOR * self.field_budget)

    def shared_objects(self) -> dict[str, Any]:
        """The large objects that jobs refer to, of which each worker process needs one copy."""
        effects = {f"effect {name}": effect for name, effect in (self.effects | self.unseen).items()}
        return {"data": self.data, "predictor": self.predictor, "variances": self.variances, **effects}

    def data_weighted_comparison(self, indices: NDArray[np.intp], relative_model_error: float) -> Comparison:
        """Weights from the images, for a model that is off by `relative_model_error` of the mean light."""
        light = self.data.light[indices]
        variance = add_model_error(self.variances(indices), light, relative_model_error) + self._missing_variance(
            indices, light
        )
        return Comparison(self.predictor, self.data, indices, variance)

    def tolerant_comparison(self, indices: NDArray[np.intp], error: float) -> Comparison:
        """Weights from the images that tolerate the present relative error of the model, up to a limit."""
        return self.data_weighted_comparison(indices, min(error, MAX_TOLERATED_ERROR))

    def half_tolerant_comparison(self, indices: NDArray[np.intp], error: float) -> Comparison:
        """Weights from the images that tolerate a share of the present error, for a fit that shall lower it."""
        share = _HALF_TOLERATED_ERROR
        return self.data_weighted_comparison(indices, min(share, share * error))

    def model_weighted_comparison(self, indices: NDArray[np.intp], values: Values) -> Comparison:
        """Weights from a model's prediction, frozen; movements are fitted where the camera moves."""
        shifts = self.has_camera_jitter and len(indices) > 1
        unbiased = self.data_weighted_comparison(indices, 0.0)
        expected = (unbiased.fitting_shifts() if shifts else unbiased).fit_gains(values).expected
        variance = self.data.camera.noise_variance(expected)
        if self.prnu:
            variance = variance + np.square(np.float32(self.prnu) * expected)
        variance = variance + self._missing_variance(indices, expected)
        return Comparison(self.predictor, self.data, indices, variance, fit_shifts=shifts)

    def _missing_variance(self, indices: NDArray[np.intp], light: Images) -> Images | np.float32:
        """Variance (counts²) of light from beyond cut modulators: a weak field interferes with that of a pixel."""
        if self.missing_light is None:
            return np.float32(0.0)
        positive = np.maximum(light, 0.0)
        share = np.square(self.missing_light[indices]).astype(np.float32)[:, None, None]
        return np.asarray(share * positive * positive.mean((1, 2), keepdims=True), dtype=np.float32)

    def relative_model_error(self, values: Values, indices: NDArray[np.intp] | None = None) -> float:
        """R.m.s. residual beyond the noise over the mean light; of the coarse captures when None."""
        comparison = self.data_weighted_comparison(self.split.coarse if indices is None else indices, 0.0)
        fitted = comparison.fit_gains(values)
        usable = comparison.weight > 0
        sigma = np.where(usable, 1.0 / np.where(usable, comparison.weight, 1.0), 0.0)
        excess = np.square(fitted.residual * sigma).sum((1, 2)) - np.square(sigma).sum((1, 2))
        light = np.abs(np.where(usable, comparison.light, 0.0).sum((1, 2)))
        ratio = np.maximum(excess, 0.0) * comparison.pixels_per_capture / np.maximum(light, 1e-9) ** 2
        return float(np.sqrt(ratio.mean()))

    def map_effects(
        self, work: Callable[[Effect], T], effects: Sequence[Effect], progress: ProgressCallback, note: str
    ) -> list[T]:
        """`work` of every effect, in parallel; results in the order of `effects`."""
        jobs = [partial(work, effect) for effect in effects]
        return self.run_parallel(jobs, lambda done: progress(done, len(effects), note))

    def run_parallel(self, jobs: Iterable[Callable[[], T]], on_finished: FinishedCallback | None = None) -> list[T]:
        """Results of jobs in their order; fields that other processes computed are counted."""
        counted = [partial(_run_counting_fields, self.predictor, self.end, job) for job in jobs]
        before = self.predictor.fields_requested
        finished = self.workers.run(counted, on_finished, self.end.check)
        here = self.predictor.fields_requested - before
        self.predictor.fields_in_workers += sum(fields for _, fields in finished) - here
        return [result for result, _ in finished]


def describe_work(contexts: Sequence[SearchContext]) -> str:
    """A sentence on when searches in these contexts, one after the other, begin nothing new, and how long that is
    expected to take on this machine, as far as `SearchContext.measuring_pace` has measured."""
    fields, end = sum(context.field_budget for context in contexts), contexts[-1].end
    counts = [context.field_budget if math.isfinite(fields) else 1000.0 for context in contexts]
    seconds = sum(count * (context.pace.first or 0.0) for count, context in zip(counts, contexts, strict=True))
    about = f"about {format_duration(max(seconds, 0.1))} on this machine"
    limits = [f"{fields:_.0f} fields, {about}".replace("_", " ")] if math.isfinite(fields) else []
    limits += [format_duration(end.last_begin_s)] if math.isfinite(end.time_s) else []
    if limits:
        return f"The search begins nothing new after {', or after '.join(limits)}. Most searches end sooner."
    return f"The search takes as long as it needs; 1000 fields take {about}."


def field_samples(captures: Captures, sampling: SamplingConfig) -> int:
    """Samples of a field on a modulator, in proportion to which a field takes time.

    They count with the padding that isn't the usual one. On a Fourier bench half of the points of the transforms along
    rows and columns, which take as long.
    """
    if captures.chain is not None or not captures.is_fourier:
        return sampling.padded_samples(captures) // PLAIN.samples_factor
    rows, columns = captures.levels.shape[2:]
    seen_rows, seen_columns = captures.shape
    return (columns * (rows + seen_rows) + seen_rows * (columns + seen_columns)) // 2


def equivalent_effects(effects: Mapping[str, Effect], data_properties: DataProperties) -> dict[str, frozenset[str]]:
    """For each effect, the others that such data can't tell from it; a symmetric relation."""
    pairs = {(e.id, other) for e in effects.values() for other in e.degeneracies(data_properties) if other in effects}
    return {
        name: frozenset({b for a, b in pairs if a == name} | {a for a, b in pairs if b == name}) for name in effects
    }


def _run_counting_fields(predictor: PerThreadPredictor, end: SearchEnd, job: Callable[[], T]) -> tuple[T, int]:
    """The result of a job, and how many fields it asked for. Raises SearchEnded at the end of its search."""
    outer, predictor.end, before = predictor.end, end, predictor.thread_fields
    try:
        return job(), predictor.thread_fields - before
    finally:
        predictor.end = outer  # a process outlives the search
