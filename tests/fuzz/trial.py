"""Runs the command line on one input in a child process with limits of time and memory, and judges how it ended.

The child is forked from a process that has imported everything already, so that a case takes as long as its work.
"""

from __future__ import annotations

import json
import math
import os
import random
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from io import TextIOWrapper
from pathlib import Path
from typing import Any, cast

import numpy as np
import psutil

VERDICTS = ("clear", "worked", "traceback", "hang", "signal", "memory", "not finite", "other")
"""How a case may end. "clear": refused in one line; "worked": accepted, and what came out is finite."""

ACCEPTABLE = ("clear", "worked")
_PRELOADED = (
    *(
        "holoview.commands.cli",
        "holoview.light.engine.torch_executor",
        "holoview.light.optics.frame_inputs",
        "holoview.viewer.document.archive",
    ),
    *("holoview.light.model.effects.learned_maps", "holoview.holograms.hologram", "holoview.evidence.study.runner"),
    *(
        f"holoview.holograms.files.readers.{name}"
        for name in ("exr_file", "hdf5_file", "matlab5", "numpy_file", "openholo")
    ),
    *(
        "holoview.holograms.fields.reading",
        "holoview.holograms.files.readers.picture_file",
        "holoview.holograms.files.readers.tiff_file",
    ),
    *(
        "holoview.bench.rig.virtual.server",
        "holoview.bench.diagnose.pipeline",
        "holoview.holograms.fields.exchange",
        "scipy.io",
    ),
    *(f"holoview.commands.{name}" for name in ("info", "render", "optimise", "captures", "calibrate", "diagnose")),
    *(f"holoview.commands.{name}" for name in ("rig", "measure", "contrast", "compare")),
)
_POLL_S = 0.01


@dataclass(frozen=True)
class Limits:
    """Wall and processor time (s) that a case may take, and memory and address space (bytes) beyond those of the
    process that forks it.
    """

    wall_s: float = 180.0
    cpu_s: int = 20
    memory: int = 1_400_000_000
    address_space: int = 4 << 30


@dataclass(frozen=True)
class Case:
    """An input of a family.

    prepare: writes its files into an empty folder. arguments: of the command line, which runs in that folder.
    call: what runs instead of the command line; it raises UserError for what it refuses.
    """

    family: str
    name: str
    prepare: Callable[[Path], None]
    arguments: tuple[str, ...] = ()
    call: Callable[[], object] | None = None


@dataclass(frozen=True)
class Outcome:
    """How a case ended: one of VERDICTS, the exit code, what was printed to stderr, and the memory it took (bytes)."""

    verdict: str
    code: int
    errors: str
    peak: int
    seconds: float


def preload() -> None:
    """Imports what cases need, with one thread: a process with several can't be forked safely."""
    import torch

    torch.set_num_threads(1)
    os.sched_setaffinity(0, {random.choice(sorted(os.sched_getaffinity(0)))})  # so that holoview takes one too
    for name in _PRELOADED:
        import_module(name)


def run_case(case: Case, folder: Path, limits: Limits) -> Outcome:
    """Prepares and runs a case in an empty folder."""
    case.prepare(folder)
    before = set(folder.rglob("*"))
    started, base = time.monotonic(), psutil.Process().memory_info().rss
    child = os.fork()
    if child == 0:
        _run_in_child(case, folder, limits, before)
    verdict, status, peak = _wait(child, started, base, limits)
    errors = (folder / ".stderr").read_text(encoding="utf-8", errors="replace")
    code = os.waitstatus_to_exitcode(status)
    verdict = verdict or _judge(code, errors)
    if verdict in ACCEPTABLE and peak > limits.memory:
        verdict = "memory"
    return Outcome(verdict, code, errors, peak, time.monotonic() - started)


def _wait(child: int, started: float, base: int, limits: Limits) -> tuple[str, int, int]:
    """Waits for a child, killing it at its limits: "hang", "memory" or "", the status and the peak of its memory."""
    verdict, process = "", psutil.Process(child)
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            peak = max(usage.ru_maxrss * 1024 - base, 0)
            return verdict or ("hang" if status == signal.SIGXCPU else ""), status, peak
        if not verdict:
            if time.monotonic() - started > limits.wall_s:
                verdict = "hang"
            elif process.memory_info().rss - base > limits.memory:
                verdict = "memory"
            if verdict:
                os.kill(child, signal.SIGKILL)
        time.sleep(_POLL_S)


def _run_in_child(case: Case, folder: Path, limits: Limits, before: set[Path]) -> None:
    """Runs the case with its streams in files, and ends this process with its exit code."""
    code = 70
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (limits.cpu_s, limits.cpu_s + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        space = psutil.Process().memory_info().vms + limits.address_space
        resource.setrlimit(resource.RLIMIT_AS, (space, space))
        os.chdir(folder)
        for number, name in ((1, ".stdout"), (2, ".stderr")):
            file = os.open(folder / name, os.O_CREAT | os.O_WRONLY, 0o600)
            os.dup2(file, number)
        sys.stdout.flush()
        for stream in (sys.stdout, sys.stderr):
            cast(TextIOWrapper, stream).reconfigure(encoding="utf-8", errors="backslashreplace")
        code = _call(case)
        sys.stdout.flush()
        if code == 0 and (wrong := _not_finite(folder, before)):
            print(f"NOT FINITE {wrong}", file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def _call(case: Case) -> int:
    from holoview.commands.cli import main
    from holoview.util.errors import UserError

    if case.call is None:
        return main(list(case.arguments))
    try:
        case.call()
    except UserError as error:
        print(f"holoview: {error}".replace("\n", " "), file=sys.stderr)
        return 2
    return 0


def _judge(code: int, errors: str) -> str:
    """The verdict on a case that ended by itself."""
    lines = [line for line in errors.splitlines() if line.strip()]
    if "Traceback (most recent call last)" in errors:
        return "traceback"
    if code < 0:
        return "signal"
    if code == 0:
        return "not finite" if any(line.startswith("NOT FINITE") for line in lines) else "worked"
    messages = [line for line in lines if line.startswith("holoview: ")]
    return "clear" if code == 2 and len(messages) == 1 and lines[-1] == messages[0] else "other"


def _not_finite(folder: Path, before: set[Path]) -> str:
    """What among the output isn't finite, in words; empty when all is."""
    text = (folder / ".stdout").read_text(encoding="utf-8", errors="replace")
    if text.startswith(("{", "[")):
        try:
            json.loads(text, parse_constant=_refuse_constant)
        except ValueError as error:
            return f"stdout: {error}"
    for path in set(folder.rglob("*.safetensors")) - before:
        from safetensors.numpy import load_file

        for name, array in load_file(path).items():
            if array.dtype.kind == "f" and not np.isfinite(array).all() and not _may_be_infinite(name):
                return f"{path.name}: {name}"
    return ""


def _may_be_infinite(name: str) -> bool:
    return name == "mismatch"  # of a calibration's checkpoint: infinite for captures that it hasn't seen yet


def _refuse_constant(text: str) -> Any:
    raise ValueError(f"{text} isn't JSON; expected a number other than {math.nan}")
