"""Times from the start of a process to its first image: of the viewer, and of `holoview render` by both backends.

Each job is a command in a process of its own. "Cold" is with empty caches of holoview (declarations of wgpu's library,
FFT strategies) and of Mesa's drivers (compiled shaders); caches of other drivers aren't emptied. "Warm" is after the
same command. The viewer draws off screen and reads its frames back; its first image is the quick one where the adapter
is slow. The commands run in turn, so that other load on the machine slows all of them alike.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from holoview.benchmark.frame_benchmark import Criterion
from holoview.benchmark.timing import JobTimings
from holoview.model import preset
from holoview.model.system import System

COLD, WARM = "first image of the viewer, cold caches", "first image of the viewer, warm caches"
RENDER_COLD, RENDER_WARM = "holoview render, cold caches", "holoview render, warm caches"
RENDER_TORCH = "holoview render --backend torch"
_LIMITS_S, _GOALS_S = {COLD: 3.0, WARM: 1.5}, {COLD: 2.0, WARM: 1.0}
_CACHE_VARIABLES = ("XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR", "LOCALAPPDATA")
_VIEW = ("view", "bench.toml", "--new", "--offscreen", "--until-image")
_RENDER = ("render", "bench.toml", "--random", "0", "--output", "image.png")


@dataclass(frozen=True)
class _Command:
    """Arguments of holoview, whether its caches are warm, and whether it is timed until its first line or its end."""

    arguments: tuple[str, ...]
    is_warm: bool
    until_line: bool = False


def first_image_timings(system: System, adapter: str | None = None, rounds: int = 3) -> dict[str, JobTimings]:
    """Wall and processor time (s) of each job, `rounds` times; the processor time is that until the process has ended.

    system: the bench that is shown at one plane. adapter: a part of the name of the WebGPU adapter.
    Raises RuntimeError with what a command printed if it fails.
    """
    on = () if adapter is None else ("--adapter", adapter)
    commands = {
        COLD: _Command((*_VIEW, *on), is_warm=False, until_line=True),
        WARM: _Command((*_VIEW, *on), is_warm=True, until_line=True),
        RENDER_COLD: _Command((*_RENDER, "--backend", "wgpu", *on), is_warm=False),
        RENDER_WARM: _Command((*_RENDER, "--backend", "wgpu", *on), is_warm=True),
        RENDER_TORCH: _Command((*_RENDER, "--backend", "torch"), is_warm=True),
    }
    return _time_commands(system, commands, rounds)


def first_image_criteria(timings: dict[str, JobTimings]) -> list[Criterion]:
    """The medians of the viewer's first image, with their limits."""
    return [
        Criterion(name, timings[name].median_ms / 1e3, _LIMITS_S[name], _GOALS_S[name], "s")
        for name in (COLD, WARM)
        if name in timings
    ]


def first_image_criterion(system: System, adapter: str | None = None) -> Criterion:
    """The time to the viewer's first image with cold caches, once, with its limit."""
    on = () if adapter is None else ("--adapter", adapter)
    command = _Command((*_VIEW, *on), is_warm=False, until_line=True)
    return first_image_criteria(_time_commands(system, {COLD: command}, 1))[0]


def _time_commands(system: System, commands: dict[str, _Command], rounds: int) -> dict[str, JobTimings]:
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in commands}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "bench.toml").write_text(preset.dumps(system), encoding="utf-8")
        for command in commands.values():
            if command.is_warm:
                _run(command, folder, folder / "warm")
        for number in range(rounds):
            for job, command in commands.items():
                caches = folder / ("warm" if command.is_warm else f"cold {number} {job}")
                samples[job].append(_run(command, folder, caches))
    return {job: JobTimings(*zip(*pairs, strict=True)) for job, pairs in samples.items()}


def _run(command: _Command, folder: Path, caches: Path) -> tuple[float, float]:
    """Wall and processor time (s) of a command that runs in `folder`, with its caches in another."""
    caches.mkdir(exist_ok=True)
    environment = os.environ | dict.fromkeys(_CACHE_VARIABLES, str(caches))
    words: Sequence[str] = (sys.executable, "-m", "holoview", *command.arguments)
    cpu_start, start = _cpu_s_of_children(), time.perf_counter()
    with (folder / "errors.txt").open("w+", encoding="utf-8", errors="replace") as errors:
        process = subprocess.Popen(
            words, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=errors, text=True, encoding="utf-8"
        )
        with process:
            assert process.stdout is not None
            line = process.stdout.readline()
            until_line_s = time.perf_counter() - start
            process.stdout.read()
        seconds = until_line_s if command.until_line else time.perf_counter() - start
        if process.returncode or not line:
            errors.seek(0)
            raise RuntimeError(f"holoview {' '.join(command.arguments)}: {errors.read().strip()}")
    return seconds, _cpu_s_of_children() - cpu_start


def _cpu_s_of_children() -> float:
    """Processor time (s) of all processes that this one has started and waited for; 0 where that isn't counted."""
    times = os.times()
    return float(times.children_user + times.children_system)
