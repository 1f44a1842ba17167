"""The helper process of `tune.py`: compiles, checks and times transforms, on a device of its own.

On a driver that runs shaders on the processor, a shader is compiled when it first runs, which holds up all that its
device was given to do: a thread would not help. A process of its own also ends when it has to, whatever the driver
does. What it leaves behind is the driver's cache of compiled shaders on disk.

It reads a line of JSON for each thing to do and answers each with lines of JSON:

    {"do": "time", "strategies": […], "shape": [ny, nx]}                → {"strategy", "compile_seconds"} of each, then
                                                                        {"strategy", "seconds"}, or … "refused": reason
    {"do": "compile", "shaders": [{"label", "text", "constants"}, …]}   → {"compile_seconds"}

The first line is {"adapter": name, "budget_s": processor time after which the operating system ends the process, where
it can}. Nothing more to read means that all is done.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

if sys.platform != "win32":
    import resource

from holoview.gpu.device import Buffer, Device, open_device
from holoview.gpu.fft import FftPlan
from holoview.gpu.line_fft import Strategy, TransformShader
from holoview.gpu.precompile import precompile
from holoview.gpu.recorder import CommandRecorder
from holoview.gpu.shader import ShaderError, ShaderSource
from holoview.util.errors import UserError

LARGEST_ERROR = 7e-7
"""Relative L2 of a forward FFT, against float64: a strategy that a driver makes wrong isn't offered."""
_ROUNDS, _PAIRS = 5, 4
_NICENESS = 5


def main() -> int:
    """Answers what it is asked on standard input."""
    lines = iter(sys.stdin)
    settings = json.loads(next(lines))
    _limit_cpu_time(settings["budget_s"])
    device = open_device(settings["adapter"])
    for line in lines:
        request = json.loads(line)
        if request["do"] == "time":
            _time_strategies(device, request["strategies"], (request["shape"][0], request["shape"][1]))
        else:
            _compile(device, request["shaders"])
    return 0


def _limit_cpu_time(budget_s: float) -> None:
    """Give way to other programs, and end after so much processor time, where the system knows such things."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError, ValueError):
            os.nice(_NICENESS)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(budget_s), math.ceil(budget_s) + 1))


def _time_strategies(device: Device, strategies: Sequence[Strategy], shape: tuple[int, int]) -> None:
    """Compiles, checks and times strategies, and says of each what came out."""
    plans: dict[Strategy, tuple[FftPlan, Buffer]] = {}
    field = _field(shape)
    expected = np.fft.fft2(field.astype(np.complex128))
    for strategy in strategies:
        start = time.perf_counter()
        try:
            plan = FftPlan(device, shape, strategy=strategy)
            buffer = device.upload(plan.pack(field), strategy)
            spectrum = _transformed(device, plan, buffer)
        except (UserError, ShaderError) as error:
            _send(strategy=strategy, refused=str(error))
            continue
        _send(strategy=strategy, compile_seconds=time.perf_counter() - start)
        wrong = float(np.linalg.norm(spectrum - expected) / np.linalg.norm(expected))
        if wrong <= LARGEST_ERROR:
            plans[strategy] = plan, buffer
        else:
            _send(strategy=strategy, refused=f"wrong by {wrong:.1e} (relative L2)")
    for strategy, seconds in _seconds(device, plans).items():
        _send(strategy=strategy, seconds=seconds)


def _transformed(device: Device, plan: FftPlan, buffer: Buffer) -> NDArray[np.complexfloating]:
    """The spectrum in natural order; `buffer` holds the field again, and both directions are compiled."""
    recorder = CommandRecorder(device)
    plan.forward(recorder, buffer)
    recorder.submit()
    spectrum = plan.natural_order(plan.download(buffer))[0]
    recorder = CommandRecorder(device)
    plan.inverse(recorder, buffer)
    recorder.submit(wait=True)
    return spectrum


def _seconds(device: Device, plans: dict[Strategy, tuple[FftPlan, Buffer]]) -> dict[Strategy, float]:
    """Least time of a forward and an inverse FFT; strategies take turns, so that a busy machine slows all alike."""
    taken: dict[Strategy, list[float]] = {strategy: [] for strategy in plans}
    for _ in range(_ROUNDS):
        for strategy, (plan, buffer) in plans.items():
            recorder = CommandRecorder(device)
            for _ in range(_PAIRS):
                plan.forward(recorder, buffer)
                plan.inverse(recorder, buffer)
            start = time.perf_counter()
            recorder.submit(wait=True)
            taken[strategy].append((time.perf_counter() - start) / _PAIRS)
    return {strategy: min(times) for strategy, times in taken.items()}


def _compile(device: Device, shaders: Sequence[dict[str, Any]]) -> None:
    """Compiles shaders, and waits until they have run."""
    start = time.perf_counter()
    sources = (ShaderSource(shader["label"], shader["text"], ((shader["label"], 0),)) for shader in shaders)
    precompile(
        device,
        [TransformShader(s, given["constants"], lambda lines: 1) for s, given in zip(sources, shaders, strict=True)],
    )
    device.wait()
    _send(compile_seconds=time.perf_counter() - start)


def _field(shape: tuple[int, int]) -> NDArray[np.complex64]:
    parts = np.random.default_rng(0).standard_normal((2, *shape))
    field: NDArray[np.complex64] = (parts[0] + 1j * parts[1]).astype(np.complex64)
    return field


def _send(**values: object) -> None:
    print(json.dumps(values), flush=True)


if __name__ == "__main__":
    sys.exit(main())
