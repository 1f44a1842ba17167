"""Choosing the strategy of transforms on a device without making anybody wait.

The first frame is made by "passes", which compile at once. Meanwhile

    1. a helper process compiles, checks and times the strategies, unless that is remembered from an earlier start,
    2. the helper compiles the caller's shaders for the fastest one, so that the driver's cache on disk holds them,
    3. a thread builds these shaders' pipelines on the caller's device, which is quick by now,

and from then on that strategy is the one to use. A process is needed because lavapipe, for one, compiles a shader when
it first runs and lets all else that its device was given to do wait (seconds); a thread alone would not help.

    choice = FftChoice(device, shape, shaders=lambda strategy: …stages of my transforms…)
    … make frames by choice.current …
    if choice.poll():      # now and then: whether `current` has just become another
        … build the transforms anew, by choice.current: their pipelines are there …
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Literal

from holoview.gpu.device import Device
from holoview.gpu.line_fft import Strategy, TransformShader, supported_strategies
from holoview.gpu.shader import ShaderError
from holoview.gpu.tune_process import Message, TuningProcess
from holoview.gpu.tune_store import TuningResult, TuningStore
from holoview.util.errors import UserError

__all__ = ["BUDGET_S", "FftTuner", "StrategyOption", "TuningResult", "TuningStore", "remembered_strategy"]

StrategyOption = Strategy | Literal["auto"]
"""A named strategy, or "auto" for the fastest one."""

BUDGET_S = 120.0
"""Processor time that the helper may take in all: more isn't worth the energy."""
_SLOWDOWN = 5.0
"""How much longer that may take by the clock, on a busy machine."""
_AT_ONCE_S = 0.3
_PAUSE_S = 0.02
_LATE, _FAILED = "too slow to compile", "the driver failed"


class FftTuner:
    """The strategy to use for fields of `shape` (ny, nx) on a device: one from the start, and maybe a faster one later.

    shaders: all stages that the caller runs with a strategy; they are compiled before `current` becomes it.
    memory: where timings are kept. anew: measure even where a timing is remembered. budget_s: processor time of the
    helper, or a fifth of its time by the clock; a strategy that isn't compiled by then is refused from then on.

    `tuning` is what is known so far. All methods are to be called in the thread that uses the device. The helper ends
    with `close` or with the program. Raises UserError for a size that can't be transformed.
    """

    def __init__(
        self,
        device: Device,
        shape: tuple[int, int],
        shaders: Callable[[Strategy], Iterable[TransformShader]] = lambda strategy: (),
        *,
        store: TuningStore | None = None,
        remeasure: bool = False,
        budget_s: float = BUDGET_S,
    ) -> None:
        self._device, self._shape, self._shaders = device, shape, shaders
        self._memory = TuningStore() if store is None else store
        self._offered = supported_strategies(device, shape)
        self._budget_s, self._until = budget_s, time.monotonic() + _SLOWDOWN * budget_s
        self._current: Strategy = "passes"
        self._coming: Strategy | None = None
        self._stages: list[TransformShader] = []
        self._helper: TuningProcess | None = None
        self._builder: _Builder | None = None
        known = None if remeasure else self._memory.load(device.info, shape)
        self.tuning = TuningResult({}, {}, {}) if known is None else known
        self._begin()

    @property
    def current(self) -> Strategy:
        """The strategy to use now."""
        return self._current

    @property
    def is_settled(self) -> bool:
        """Whether `current` will stay."""
        return self._helper is None and self._builder is None

    def poll(self) -> bool:
        """Look how far the helper is, without waiting for it; whether `current` has changed."""
        before = self._current
        while self._helper is not None and (answer := self._helper.next_answer()) is not None:
            self._handle_answer(answer)
        if self._helper is not None and (self._helper.has_ended or time.monotonic() > self._until):
            self._give_up(_FAILED if self._helper.has_ended and not self._helper.hit_time_limit else _LATE)
        if self._builder is not None and not self._builder.is_alive():
            self._switch(self._builder)
        return self._current != before

    def wait(self) -> Strategy:
        """`current`, once it will stay."""
        while not self.is_settled:
            self.poll()
            time.sleep(_PAUSE_S)
        return self._current

    def close(self) -> None:
        """End the helper. `current` stays."""
        if self._helper is not None:
            self._helper.close()
            self._helper = None
        if self._builder is not None:
            self._builder.join()
            self._builder = None

    def __enter__(self) -> FftTuner:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # --- from one step to the next ----------------------------------------------------------------------------------

    @property
    def _unknown(self) -> list[Strategy]:
        """Strategies on offer that are neither timed nor refused."""
        known = {*self.tuning.seconds, *self.tuning.refused}
        return [strategy for strategy in self._offered if strategy not in known]

    def _begin(self) -> None:
        """Have the strategies timed, or go on with what is remembered of them."""
        if not [strategy for strategy in self._unknown if strategy != "passes"]:
            self._prepare_fastest()
            return
        offered = [strategy for strategy in self._offered if strategy not in self.tuning.refused]
        self.tuning = TuningResult({}, {}, self.tuning.refused)
        self._helper = TuningProcess(self._device.info.name, self._budget_s)
        self._helper.send({"do": "time", "strategies": offered, "shape": self._shape})

    def _handle_answer(self, answer: Message) -> None:
        """Make use of an answer of the helper."""
        if self._coming is not None:
            self._build()
            return
        self.tuning = self.tuning.with_answer(answer)
        if not self._unknown:
            self._memory.save(self._device.info, self._shape, self.tuning)
            self._prepare_fastest()

    def _prepare_fastest(self) -> None:
        """Make the fastest strategy ready, if it isn't the one that is in use."""
        best = self.tuning.best
        if best == self._current or best not in self._offered:
            self.close()
        elif _compiles_at_once(self._device, self.tuning, best):
            self._current = best
            self.close()
        else:
            self._coming, self._stages = best, list(self._shaders(best))
            self._helper = self._helper or TuningProcess(self._device.info.name, self._budget_s)
            self._helper.send({"do": "compile", "shaders": [_described(stage) for stage in self._stages]})

    def _build(self) -> None:
        """The driver has all shaders on disk: make pipelines of them here."""
        if self._helper is not None:
            self._helper.close()
            self._helper = None
        self._builder = _Builder(self._device, self._stages)
        self._builder.start()

    def _switch(self, builder: _Builder) -> None:
        assert self._coming is not None
        self._builder = None
        if builder.has_failed:
            self._refuse(self._coming, _FAILED)
        else:
            self._current = self._coming

    def _give_up(self, reason: str) -> None:
        """Stay with `current`, and don't try again what the helper didn't get done."""
        waiting = [s for s in self._unknown if s not in self.tuning.compile_seconds]
        doing = self._coming or next(iter(waiting), None)
        if doing is not None and doing != "passes":
            self._refuse(doing, reason)
        self.close()

    def _refuse(self, strategy: Strategy, reason: str) -> None:
        self.tuning = self.tuning.without(strategy, reason)
        self._memory.save(self._device.info, self._shape, self.tuning)


class _Builder(threading.Thread):
    """Builds pipelines, which a device keeps. Not a daemon: a program mustn't end in the middle of a native call."""

    def __init__(self, device: Device, stages: Iterable[TransformShader]) -> None:
        super().__init__(name="pipelines")
        self._device, self._stages = device, stages
        self.has_failed = False

    def run(self) -> None:
        """Build them all."""
        try:
            for stage in self._stages:
                self._device.pipeline(stage.source, stage.constants)
        except (ShaderError, UserError):
            self.has_failed = True


def remembered_strategy(device: Device, shape: tuple[int, int], store: TuningStore | None = None) -> Strategy:
    """The fastest strategy for fields of `shape` that is known to need no waiting; "passes" where none is known."""
    known = None if device.info.is_cpu else (TuningStore() if store is None else store).load(device.info, shape)
    if (
        known is None
        or known.best not in supported_strategies(device, shape)
        or not _compiles_at_once(device, known, known.best)
    ):
        return "passes"
    return known.best


def _compiles_at_once(device: Device, tuning: TuningResult, strategy: Strategy) -> bool:
    """Whether compiling takes no time that counts.

    Where shaders run on the processor, it may only have been fast because the driver's cache held them.
    """
    return tuning.compile_seconds.get(strategy, _AT_ONCE_S) < _AT_ONCE_S and not device.info.is_cpu


def _described(stage: TransformShader) -> Message:
    """A stage for the helper."""
    return {"label": stage.source.label, "text": stage.source.text, "constants": dict(stage.constants)}
