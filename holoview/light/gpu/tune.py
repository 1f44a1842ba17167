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

import contextlib
import json
import math
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Literal, cast

from holoview.light.gpu.adapter import AdapterInfo
from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import STRATEGIES, Strategy, TransformShader, supported_strategies
from holoview.light.gpu.shader import ShaderError
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import cache_dir
from holoview.util.processes import environment_of_python

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

    `tuning` holds the times that are known so far. Call all methods in the thread that uses the device. The helper
    ends with `close` or with the program. Raises UserError for a size that can't be transformed.
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


# --- the store of measured times --------------------------------------------------------------------------------------

# The file in the user's cache folder holds an entry for each adapter, driver, version of wgpu and size. It is only a
# cache: entries that can't be read or are invalid are ignored, and so is a failure to write.


FORMAT = 1
"""Version of the entries; to be increased when shaders become faster or slower, or the layout of the file changes."""
_FILE = "fft-strategies.json"


@dataclass(frozen=True)
class TuningResult:
    """Seconds of a forward plus an inverse FFT with each strategy, and seconds to compile both.

    `refused` holds the reason for each strategy that wasn't compiled in time, failed, or gave wrong results.
    """

    seconds: Mapping[Strategy, float]
    compile_seconds: Mapping[Strategy, float]
    refused: Mapping[Strategy, str]

    @property
    def best(self) -> Strategy:
        """The fastest strategy that isn't refused."""
        accepted = {s: t for s, t in self.seconds.items() if s not in self.refused}
        return min(accepted, key=lambda s: accepted[s]) if accepted else "passes"

    def without(self, strategy: Strategy, reason: str) -> TuningResult:
        """The same result with one more strategy refused."""
        return TuningResult(self.seconds, self.compile_seconds, {**self.refused, strategy: reason})

    def with_answer(self, answer: Mapping[str, Any]) -> TuningResult:
        """The same result with an answer of the helper added."""
        strategy = answer["strategy"]
        if "refused" in answer:
            return self.without(strategy, answer["refused"])
        seconds, compile_seconds = (
            {**times, strategy: answer[name]} if name in answer else times
            for name, times in (("seconds", self.seconds), ("compile_seconds", self.compile_seconds))
        )
        return TuningResult(seconds, compile_seconds, self.refused)


class TuningStore:
    """Tuning results in a file in `folder`, by default `cache_dir()`."""

    def __init__(self, folder: Path | None = None) -> None:
        self.path = (cache_dir() if folder is None else folder) / _FILE

    def load(self, info: AdapterInfo, shape: tuple[int, int]) -> TuningResult | None:
        """The result for an adapter and a shape (ny, nx), or None."""
        return _parse_entry(self._entries().get(_key(info, shape)))

    def save(self, info: AdapterInfo, shape: tuple[int, int], tuning: TuningResult) -> None:
        """Store a result if possible."""
        entry = {
            "seconds": dict(tuning.seconds),
            "compile_seconds": dict(tuning.compile_seconds),
            "refused": dict(tuning.refused),
        }
        entries = {**self._entries(), _key(info, shape): entry}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_file(self.path, json.dumps(entries, indent=1, sort_keys=True), is_durable=False)
        except (OSError, UserError):
            return  # the folder isn't writable or the disk is full: the next run measures again

    def _entries(self) -> dict[str, Any]:
        try:
            entries = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        return entries if isinstance(entries, dict) else {}


def _key(info: AdapterInfo, shape: tuple[int, int]) -> str:
    """Key of an entry: everything that the times depend on."""
    return json.dumps([FORMAT, info.name, info.backend, info.driver, version("wgpu"), *shape])


def _parse_entry(entry: object) -> TuningResult | None:
    """A result from the JSON of an entry; None if it is invalid."""
    if not isinstance(entry, dict):
        return None
    seconds, compiled, refused = (entry.get(name) for name in ("seconds", "compile_seconds", "refused"))
    if not (_is_times(seconds) and _is_times(compiled) and _is_by_strategy(refused)):
        return None
    if not all(isinstance(reason, str) for reason in cast("dict[str, Any]", refused).values()):
        return None
    return TuningResult(
        cast("dict[Strategy, float]", seconds),
        cast("dict[Strategy, float]", compiled),
        cast("dict[Strategy, str]", refused),
    )


def _is_times(values: object) -> bool:
    return _is_by_strategy(values) and all(
        isinstance(t, int | float) and math.isfinite(t) and t >= 0 for t in cast("dict[str, Any]", values).values()
    )


def _is_by_strategy(values: object) -> bool:
    return isinstance(values, dict) and set(values) <= set(STRATEGIES)


# --- the helper process -----------------------------------------------------------------------------------------------


WORKER_ARGUMENTS = ("-m", "holoview.light.gpu.tune_worker")
"""Arguments of the Python interpreter that start the helper."""
_JOIN_TIMEOUT_S = 2.0
Message = dict[str, Any]
"""A line of JSON; `tune_worker` states the protocol."""


class TuningProcess:
    """Runs `tune_worker` on the adapter of a name, for at most `budget_s` seconds of CPU time.

    A thread collects the answers, so that `next_answer` never waits. arguments: of the Python interpreter.
    """

    def __init__(self, adapter: str, budget_s: float, arguments: Sequence[str] = WORKER_ARGUMENTS) -> None:
        self._answers: SimpleQueue[Message] = SimpleQueue()
        self._process = subprocess.Popen(
            [sys.executable, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            env=environment_of_python(),
        )
        self._reader = threading.Thread(target=_collect, args=(self._process, self._answers), daemon=True)
        self._reader.start()
        self._kill = weakref.finalize(self, _kill, self._process, self._reader)
        self.send({"adapter": adapter, "budget_s": budget_s})

    @property
    def has_ended(self) -> bool:
        """Whether the process has exited and all its answers have been taken."""
        return not self._reader.is_alive() and self._process.poll() is not None and self._answers.empty()

    @property
    def hit_time_limit(self) -> bool:
        """Whether the operating system ended the process because it used up its CPU time."""
        return sys.platform != "win32" and self._process.poll() in (-signal.SIGXCPU, -signal.SIGKILL)

    def send(self, request: Message) -> None:
        """Send a request; has no effect if the process has exited."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError, ValueError):
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()

    def next_answer(self) -> Message | None:
        """The next answer, or None if none has arrived yet."""
        with contextlib.suppress(Empty):
            return self._answers.get_nowait()
        return None

    def close(self) -> None:
        """Kill the process."""
        self._kill()


def _collect(process: subprocess.Popen[str], answers: SimpleQueue[Message]) -> None:
    """Put the answers into the queue until the process closes its output."""
    assert process.stdout is not None
    with contextlib.suppress(OSError, ValueError):
        for line in process.stdout:
            with contextlib.suppress(json.JSONDecodeError):
                answers.put(json.loads(line))


def _kill(process: subprocess.Popen[str], reader: threading.Thread) -> None:
    assert process.stdin is not None and process.stdout is not None
    with contextlib.suppress(OSError):
        process.kill()
    process.wait()
    reader.join(_JOIN_TIMEOUT_S)
    for pipe in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):
            pipe.close()
