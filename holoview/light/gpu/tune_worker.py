"""The helper process of `tune`: compiles, checks and times FFTs on a device of its own.

A driver that executes shaders on the CPU compiles a shader when it first runs and blocks all other work of its device
meanwhile. A separate process avoids this, and can be killed whatever the driver does. Its compiled shaders stay in the
driver's cache on disk.

Each request on standard input is a line of JSON, answered by lines of JSON:

    {"do": "time", "strategies": […], "shape": [ny, nx]}                → {"strategy", "compile_seconds"} of each, then
                                                                        {"strategy", "seconds"}, or … "refused": reason
    {"do": "compile", "shaders": [{"label", "text", "constants"}, …]}   → {"compile_seconds"}

The first line is {"adapter": name, "budget_s": CPU time after which the operating system ends the process, if it can}.
The process exits at the end of its input.
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

from holoview.light.gpu.device import Buffer, Device, open_device
from holoview.light.gpu.fft import FftPlan
from holoview.light.gpu.line_fft import Strategy, TransformShader, precompile
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.gpu.shader import ShaderError, ShaderSource
from holoview.util.errors import UserError

LARGEST_ERROR = 7e-7
"""Relative L2 error of a forward FFT against float64, above which a strategy is refused."""
_ROUNDS, _PAIRS_PER_ROUND = 5, 4
_NICENESS = 5


def main() -> int:
    """Process the requests on standard input."""
    lines = iter(sys.stdin)
    settings = json.loads(next(lines))
    limit_cpu_time(settings["budget_s"])
    device = open_device(settings["adapter"])
    for line in lines:
        request = json.loads(line)
        if request["do"] == "time":
            time_strategies(device, request["strategies"], (request["shape"][0], request["shape"][1]))
        else:
            compile_shaders(device, request["shaders"])
    return 0


def limit_cpu_time(budget_s: float) -> None:
    """Lower the priority and limit the CPU time of this process, in seconds; no effect on Windows."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError, ValueError):
            os.nice(_NICENESS)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(budget_s), math.ceil(budget_s) + 1))


def time_strategies(device: Device, strategies: Sequence[Strategy], shape: tuple[int, int]) -> None:
    """Compile, check and time strategies for fields of `shape` (ny, nx), and answer for each."""
    plans: dict[Strategy, tuple[FftPlan, Buffer]] = {}
    field = _random_field(shape)
    expected = np.fft.fft2(field.astype(np.complex128))
    for strategy in strategies:
        start = time.perf_counter()
        try:
            plan = FftPlan(device, shape, strategy=strategy)
            buffer = device.upload(plan.pack(field), strategy)
            spectrum = _forward_and_back(device, plan, buffer)
        except (UserError, ShaderError) as error:
            _send(strategy=strategy, refused=str(error))
            continue
        _send(strategy=strategy, compile_seconds=time.perf_counter() - start)
        relative_error = float(np.linalg.norm(spectrum - expected) / np.linalg.norm(expected))
        if relative_error <= LARGEST_ERROR:
            plans[strategy] = plan, buffer
        else:
            _send(strategy=strategy, refused=f"wrong by {relative_error:.1e} (relative L2)")
    for strategy, seconds in _measure(device, plans).items():
        _send(strategy=strategy, seconds=seconds)


def _forward_and_back(device: Device, plan: FftPlan, buffer: Buffer) -> NDArray[np.complexfloating]:
    """The spectrum in natural order. Compiles both directions; `buffer` holds the field again afterwards."""
    recorder = CommandRecorder(device)
    plan.forward(recorder, buffer)
    recorder.submit()
    spectrum = plan.natural_order(plan.download(buffer))[0]
    recorder = CommandRecorder(device)
    plan.inverse(recorder, buffer)
    recorder.submit(wait=True)
    return spectrum


def _measure(device: Device, plans: dict[Strategy, tuple[FftPlan, Buffer]]) -> dict[Strategy, float]:
    """Least time (s) of a forward plus an inverse FFT; strategies alternate, so that other load slows all alike."""
    samples: dict[Strategy, list[float]] = {strategy: [] for strategy in plans}
    for _ in range(_ROUNDS):
        for strategy, (plan, buffer) in plans.items():
            recorder = CommandRecorder(device)
            for _ in range(_PAIRS_PER_ROUND):
                plan.forward(recorder, buffer)
                plan.inverse(recorder, buffer)
            start = time.perf_counter()
            recorder.submit(wait=True)
            samples[strategy].append((time.perf_counter() - start) / _PAIRS_PER_ROUND)
    return {strategy: min(seconds) for strategy, seconds in samples.items()}


def compile_shaders(device: Device, shaders: Sequence[dict[str, Any]]) -> None:
    """Compile shaders, run each once, and answer when they have run."""
    start = time.perf_counter()
    sources = [ShaderSource(shader["label"], shader["text"], ((shader["label"], 0),)) for shader in shaders]
    pairs = zip(sources, shaders, strict=True)
    precompile(device, [TransformShader(source, shader["constants"], lambda lines: 1) for source, shader in pairs])
    device.wait()
    _send(compile_seconds=time.perf_counter() - start)


def _random_field(shape: tuple[int, int]) -> NDArray[np.complex64]:
    parts = np.random.default_rng(0).standard_normal((2, *shape))
    field: NDArray[np.complex64] = (parts[0] + 1j * parts[1]).astype(np.complex64)
    return field


def _send(**values: object) -> None:
    print(json.dumps(values), flush=True)


if __name__ == "__main__":
    sys.exit(main())
