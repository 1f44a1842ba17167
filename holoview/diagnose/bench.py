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

from holoview.diagnose.comparison import Comparison, Prediction, Predicts, Values
from holoview.diagnose.measured import Images, Measured
from holoview.diagnose.noise import blind_variance, model_variance, with_mismatch
from holoview.diagnose.split import Split
from holoview.diagnose.team import Finished, Team
from holoview.diagnose.ways import PLAIN, Way
from holoview.effects.effect import Effect, Facts
from holoview.system import System

T = TypeVar("T")
Progress = Callable[[int, int, str], None]


class Counts(Predicts, Protocol):
    """A predictor that counts the fields that it was asked for."""

    @property
    def fields(self) -> int: ...


class PerThread:
    """A predictor for each thread that asks for one: predictors remember what they computed and can't be shared.

    make: a new one; `extra` effects may be given.
    """

    def __init__(self, make: Callable[..., Counts]) -> None:
        self.make, self._own = make, threading.local()
        self._all: list[Counts] = []
        self.elsewhere = 0

    @property
    def fields(self) -> int:
        """How many fields all of them were asked for, `elsewhere` in other processes: once all wait."""
        return sum(one.fields for one in self._all) + self.elsewhere

    @property
    def own_fields(self) -> int:
        """How many the one of this thread was asked for."""
        return self._own.predict.fields if hasattr(self._own, "predict") else 0

    def __call__(self, indices: NDArray[np.intp], values: Values, *, grad: bool = False) -> Prediction:
        if not hasattr(self._own, "predict"):
            self._own.predict = self.make()
            self._all.append(self._own.predict)
        predicted: Prediction = self._own.predict(indices, values, grad=grad)
        return predicted


@dataclass(frozen=True)
class Bench:
    """measured: the captures. effects: the candidates by id. split: which captures are for what.

    predict: predicts the captures, sampled in a `way`. team: who works.
    most_fields: after so many fields a search begins nothing new that is long. fixed_pattern: 1 σ of the pixels'
    relative sensitivity. shaking: whether the camera moves from capture to capture, so that comparisons take its
    movements out. equals: for each effect the others that are the same physics on this bench (`same_physics`).
    """

    measured: Measured
    system: System
    effects: Mapping[str, Effect]
    split: Split
    predict: PerThread
    team: Team
    way: Way = PLAIN
    most_fields: float = math.inf
    fixed_pattern: float = 0.0
    shaking: bool = False
    equals: Mapping[str, frozenset[str]] = field(default_factory=dict)
    _blind: dict[tuple[int, ...], Images] = field(default_factory=dict, repr=False)

    @property
    def is_spent(self) -> bool:
        """Whether a search has to come to its end. Asked only while no thread works, so that threads change nothing."""
        return self.predict.fields > self.most_fields

    def coarse_comparison(self, indices: NDArray[np.intp], mismatch: float) -> Comparison:
        """Weights from the pictures, for a model that is off by `mismatch` of the mean light."""
        key = tuple(int(k) for k in indices)
        if key not in self._blind:
            self._blind[key] = blind_variance(self.measured, indices)
        variance = with_mismatch(self._blind[key], self.measured.light[indices], mismatch)
        return Comparison(self.predict, self.measured, indices, variance)

    def judged_by(self, indices: NDArray[np.intp], values: Values) -> Comparison:
        """Weights from a model's prediction, then frozen; movements of a shaking camera are taken out."""
        shifts = self.shaking and len(indices) > 1
        blind = self.coarse_comparison(indices, 0.0)
        expected = (blind.with_shifts() if shifts else blind).fit(values).expected
        variance = model_variance(self.measured.camera, expected)
        if self.fixed_pattern:
            variance = variance + np.square(np.float32(self.fixed_pattern) * expected)
        return Comparison(self.predict, self.measured, indices, variance, shifts=shifts)

    def map(self, work: Callable[[Effect], T], effects: Sequence[Effect], report: Progress, note: str) -> list[T]:
        """`work` on every effect, side by side; results in the order of `effects`. Ctrl-C ends it."""
        jobs = [partial(work, one) for one in effects]
        return self.side_by_side(jobs, lambda done: report(done, len(effects), note))

    def side_by_side(self, jobs: Iterable[Callable[[], T]], finished: Finished | None = None) -> list[T]:
        """Results of jobs that the team works on; fields that were computed in other processes count too."""
        counted = [partial(self._counted, job) for job in jobs]
        before = self.predict.fields
        done = self.team.run(counted, finished)
        self.predict.elsewhere += sum(fields for _, fields in done) - (self.predict.fields - before)
        return [result for result, _ in done]

    def _counted(self, job: Callable[[], T]) -> tuple[T, int]:
        before = self.predict.own_fields
        result = job()
        return result, self.predict.own_fields - before


def same_physics(effects: Mapping[str, Effect], facts: Facts) -> dict[str, frozenset[str]]:
    """For each effect those of the others that such data can't tell from it, both ways around."""
    pairs = {(e.id, other) for e in effects.values() for other in e.equal_to(facts) if other in effects}
    return {
        name: frozenset({b for a, b in pairs if a == name} | {a for a, b in pairs if b == name}) for name in effects
    }
