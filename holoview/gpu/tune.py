"""Finds the fastest FFT strategy of a device in the background, without delaying the first frame.

The first frame uses "passes", which compiles fast. Meanwhile

    1. a helper process compiles, checks and times the strategies, unless the store has their times from an earlier run,
    2. the helper compiles the caller's shaders for the fastest one, so that they are in the driver's cache on disk,
    3. a thread creates the pipelines of these shaders on the caller's device, which is fast by then.

After this, the caller changes to that strategy. A process is needed because some drivers, lavapipe for example, compile
a shader when it first runs, for seconds, and block all other work of the device meanwhile; a thread would not help.

    tuner = FftTuner(device, shape, shaders=lambda strategy: [… the shaders of the caller's transforms …])
    … render with tuner.current …
    if tuner.poll():       # called regularly: whether `current` has changed
        … create the transforms for tuner.current: their pipelines are compiled …
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
"""Default limit of the helper's CPU time."""
_MAX_SLOWDOWN = 5.0
"""Limit of the helper's wall time, as a multiple of its CPU time: other programs may use the CPU too."""
_INSTANT_S = 0.3
"""A strategy that compiles within this time is used without preparing it in the background."""
_POLL_INTERVAL_S = 0.02
_TOO_SLOW, _FAILED = "too slow to compile", "the driver failed"


class FftTuner:
    """Chooses the strategy for fields of `shape` (ny, nx) on a device: one from the start, maybe a faster one later.

    shaders: returns all shaders that the caller runs with a strategy; they are compiled before `current` becomes it.
    store: where measured times are cached. remeasure: ignore cached times. budget_s: limit of the helper's CPU time,
    and a fifth of the limit of its wall time; a strategy that isn't compiled within it is refused, in later runs too.

    `tuning` is what is known so far. Call all methods in the thread that uses the device. The helper ends with `close`
    or with the program. Raises UserError for a size that can't be transformed.
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
        self._store = TuningStore() if store is None else store
        self._supported = supported_strategies(device, shape)
        self._budget_s, self._deadline = budget_s, time.monotonic() + _MAX_SLOWDOWN * budget_s
        self._current: Strategy = "passes"
        self._next: Strategy | None = None  # the fastest strategy, while its shaders are being compiled
        self._pending_shaders: list[TransformShader] = []
        self._helper: TuningProcess | None = None
        self._compiler: _PipelineThread | None = None
        cached = None if remeasure else self._store.load(device.info, shape)
        self.tuning = TuningResult({}, {}, {}) if cached is None else cached
        self._start()

    @property
    def current(self) -> Strategy:
        """The strategy to use now."""
        return self._current

    @property
    def is_settled(self) -> bool:
        """Whether `current` is final."""
        return self._helper is None and self._compiler is None

    def poll(self) -> bool:
        """Process the helper's answers, without waiting, and return whether `current` has changed."""
        before = self._current
        while self._helper is not None and (answer := self._helper.next_answer()) is not None:
            self._handle_answer(answer)
        if self._helper is not None and (self._helper.has_ended or time.monotonic() > self._deadline):
            self._give_up(_FAILED if self._helper.has_ended and not self._helper.hit_time_limit else _TOO_SLOW)
        if self._compiler is not None and not self._compiler.is_alive():
            self._switch(self._compiler)
        return self._current != before

    def wait(self) -> Strategy:
        """Wait until `current` is final, and return it."""
        while not self.is_settled:
            self.poll()
            time.sleep(_POLL_INTERVAL_S)
        return self._current

    def close(self) -> None:
        """Stop the search; `current` stays."""
        if self._helper is not None:
            self._helper.close()
            self._helper = None
        if self._compiler is not None:
            self._compiler.join()
            self._compiler = None

    def __enter__(self) -> FftTuner:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # --- the steps of the search ------------------------------------------------------------------------------------

    @property
    def _untested(self) -> list[Strategy]:
        """Supported strategies that are neither timed nor refused."""
        tested = {*self.tuning.seconds, *self.tuning.refused}
        return [strategy for strategy in self._supported if strategy not in tested]

    def _start(self) -> None:
        """Start timing the strategies, or continue with the cached times."""
        if not [strategy for strategy in self._untested if strategy != "passes"]:
            self._prepare_fastest()
            return
        candidates = [strategy for strategy in self._supported if strategy not in self.tuning.refused]
        self.tuning = TuningResult({}, {}, self.tuning.refused)
        self._helper = TuningProcess(self._device.info.name, self._budget_s)
        self._helper.send({"do": "time", "strategies": candidates, "shape": self._shape})

    def _handle_answer(self, answer: Message) -> None:
        """Process one answer of the helper."""
        if self._next is not None:
            self._create_pipelines()
            return
        self.tuning = self.tuning.with_answer(answer)
        if not self._untested:
            self._store.save(self._device.info, self._shape, self.tuning)
            self._prepare_fastest()

    def _prepare_fastest(self) -> None:
        """Use the fastest strategy if it compiles instantly, else let the helper compile its shaders."""
        best = self.tuning.best
        if best == self._current or best not in self._supported:
            self.close()
        elif _compiles_instantly(self._device, self.tuning, best):
            self._current = best
            self.close()
        else:
            self._next, self._pending_shaders = best, list(self._shaders(best))
            self._helper = self._helper or TuningProcess(self._device.info.name, self._budget_s)
            self._helper.send({"do": "compile", "shaders": [_as_message(shader) for shader in self._pending_shaders]})

    def _create_pipelines(self) -> None:
        """Create the pipelines on this device, since the driver's cache on disk holds all shaders now."""
        if self._helper is not None:
            self._helper.close()
            self._helper = None
        self._compiler = _PipelineThread(self._device, self._pending_shaders)
        self._compiler.start()

    def _switch(self, compiler: _PipelineThread) -> None:
        """Use the next strategy if all its pipelines were created."""
        assert self._next is not None
        self._compiler = None
        if compiler.has_failed:
            self._refuse(self._next, _FAILED)
        else:
            self._current = self._next

    def _give_up(self, reason: str) -> None:
        """Stay with `current`, and refuse the strategy that the helper was compiling."""
        uncompiled = [s for s in self._untested if s not in self.tuning.compile_seconds]
        compiling = self._next or next(iter(uncompiled), None)
        if compiling is not None and compiling != "passes":
            self._refuse(compiling, reason)
        self.close()

    def _refuse(self, strategy: Strategy, reason: str) -> None:
        self.tuning = self.tuning.without(strategy, reason)
        self._store.save(self._device.info, self._shape, self.tuning)


class _PipelineThread(threading.Thread):
    """Creates pipelines, which the device caches. Not a daemon: a program mustn't end during a native call."""

    def __init__(self, device: Device, shaders: Iterable[TransformShader]) -> None:
        super().__init__(name="pipelines")
        self._device, self._shaders = device, shaders
        self.has_failed = False

    def run(self) -> None:
        """Create all pipelines."""
        try:
            for shader in self._shaders:
                self._device.pipeline(shader.source, shader.constants)
        except (ShaderError, UserError):
            self.has_failed = True


def remembered_strategy(device: Device, shape: tuple[int, int], store: TuningStore | None = None) -> Strategy:
    """The fastest strategy in the store for fields of `shape` if it compiles instantly, else "passes"."""
    cached = None if device.info.is_cpu else (TuningStore() if store is None else store).load(device.info, shape)
    if (
        cached is None
        or cached.best not in supported_strategies(device, shape)
        or not _compiles_instantly(device, cached, cached.best)
    ):
        return "passes"
    return cached.best


def _compiles_instantly(device: Device, tuning: TuningResult, strategy: Strategy) -> bool:
    """Whether the compile time is negligible.

    Never true for a CPU adapter, whose measured time may only have been short because the driver's cache was warm.
    """
    return tuning.compile_seconds.get(strategy, _INSTANT_S) < _INSTANT_S and not device.info.is_cpu


def _as_message(shader: TransformShader) -> Message:
    """A shader as the helper's request contains it."""
    return {"label": shader.source.label, "text": shader.source.text, "constants": dict(shader.constants)}
