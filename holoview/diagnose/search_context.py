"""What a diagnosis works with: the captures, the nominal bench, the effects, predictors, and the split."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.captures.noise_model import add_model_error, neighbour_variance
from holoview.captures.prepared_captures import Images, PreparedCaptures
from holoview.diagnose.capture_split import CaptureSplit
from holoview.diagnose.comparison import Comparison, Prediction, PredictorProtocol, Values
from holoview.diagnose.sampling_config import PLAIN, SamplingConfig
from holoview.diagnose.worker_pool import FinishedCallback, WorkerPool
from holoview.model.effects.effect import DataProperties, Effect
from holoview.model.system import System
from holoview.util.progress import ProgressCallback

T = TypeVar("T")


class CountingPredictor(PredictorProtocol, Protocol):
    """A predictor that counts the fields that it was asked for."""

    @property
    def fields_requested(self) -> int: ...


class PerThreadPredictor:
    """A predictor for each thread that asks for one: predictors remember what they computed and can't be shared.

    make: a new one; `extra` effects may be given.
    """

    def __init__(self, create: Callable[..., CountingPredictor]) -> None:
        self.create, self._own = create, threading.local()
        self._all: list[CountingPredictor] = []
        self.fields_in_workers = 0

    @property
    def fields_requested(self) -> int:
        """How many fields all of them were asked for, `elsewhere` in other processes: once all wait."""
        return sum(one.fields_requested for one in self._all) + self.fields_in_workers

    @property
    def thread_fields(self) -> int:
        """How many the one of this thread was asked for."""
        return self._own.predict.fields_requested if hasattr(self._own, "predict") else 0

    def __call__(self, indices: NDArray[np.intp], values: Values, *, grad: bool = False) -> Prediction:
        if not hasattr(self._own, "predict"):
            self._own.predict = self.create()
            self._all.append(self._own.predict)
        predicted: Prediction = self._own.predict(indices, values, grad=grad)
        return predicted


@dataclass(frozen=True)
class SearchContext:
    """measured: the captures. effects: the candidates by id. split: which captures are for what.

    predict: predicts the captures, sampled in a `way`. team: who works.
    most_fields: after so many fields a search begins nothing new that is long. fixed_pattern: 1 σ of the pixels'
    relative sensitivity. shaking: whether the camera moves from capture to capture, so that comparisons take its
    movements out. equals: for each effect the others that are the same physics on this bench (`same_physics`).
    """

    data: PreparedCaptures
    system: System
    effects: Mapping[str, Effect]
    split: CaptureSplit
    predictor: PerThreadPredictor
    workers: WorkerPool
    sampling: SamplingConfig = PLAIN
    field_budget: float = math.inf
    prnu: float = 0.0
    has_camera_jitter: bool = False
    equivalents: Mapping[str, frozenset[str]] = field(default_factory=dict)
    _data_variances: dict[tuple[int, ...], Images] = field(default_factory=dict, repr=False)

    @property
    def budget_exhausted(self) -> bool:
        """Whether a search has to come to its end. Asked only while no thread works, so that threads change nothing."""
        return self.predictor.fields_requested > self.field_budget

    def data_weighted_comparison(self, indices: NDArray[np.intp], relative_model_error: float) -> Comparison:
        """Weights from the pictures, for a model that is off by `mismatch` of the mean light."""
        key = tuple(int(k) for k in indices)
        if key not in self._data_variances:
            self._data_variances[key] = neighbour_variance(self.data, indices)
        variance = add_model_error(self._data_variances[key], self.data.light[indices], relative_model_error)
        return Comparison(self.predictor, self.data, indices, variance)

    def model_weighted_comparison(self, indices: NDArray[np.intp], values: Values) -> Comparison:
        """Weights from a model's prediction, then frozen; movements of a shaking camera are taken out."""
        shifts = self.has_camera_jitter and len(indices) > 1
        blind = self.data_weighted_comparison(indices, 0.0)
        expected = (blind.fitting_shifts() if shifts else blind).fit_gains(values).expected
        variance = self.data.camera.noise_variance(expected)
        if self.prnu:
            variance = variance + np.square(np.float32(self.prnu) * expected)
        return Comparison(self.predictor, self.data, indices, variance, fit_shifts=shifts)

    def map_effects(
        self, work: Callable[[Effect], T], effects: Sequence[Effect], progress: ProgressCallback, note: str
    ) -> list[T]:
        """`work` on every effect, side by side; results in the order of `effects`. Ctrl-C ends it."""
        jobs = [partial(work, one) for one in effects]
        return self.run_parallel(jobs, lambda done: progress(done, len(effects), note))

    def run_parallel(self, jobs: Iterable[Callable[[], T]], on_finished: FinishedCallback | None = None) -> list[T]:
        """Results of jobs that the team works on; fields that were computed in other processes count too."""
        counted = [partial(self._run_counting_fields, job) for job in jobs]
        before = self.predictor.fields_requested
        done = self.workers.run(counted, on_finished)
        self.predictor.fields_in_workers += sum(fields for _, fields in done) - (
            self.predictor.fields_requested - before
        )
        return [result for result, _ in done]

    def _run_counting_fields(self, job: Callable[[], T]) -> tuple[T, int]:
        before = self.predictor.thread_fields
        result = job()
        return result, self.predictor.thread_fields - before


def equivalent_effects(effects: Mapping[str, Effect], data_properties: DataProperties) -> dict[str, frozenset[str]]:
    """For each effect those of the others that such data can't tell from it, both ways around."""
    pairs = {(e.id, other) for e in effects.values() for other in e.degeneracies(data_properties) if other in effects}
    return {
        name: frozenset({b for a, b in pairs if a == name} | {a for a, b in pairs if b == name}) for name in effects
    }
