"""Measures how long a person waits in a real window: for an optimisation to be seen, and for a closed window's program.

    python -m benchmarks.feedback [--rounds N] [--only optimisation|ends] [--states NAME…] [--shape WxH]

Needs a screen, or Xvfb for one that nobody sees. Each row is a viewer of its own, started as `holoview view` starts it,
with folders of its own; the window is closed as a window manager closes it. "Not compiled" begins with an empty cache.
Close everything else: times are those of a clock.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from benchmarks.common import count_of, shape_of
from benchmarks.feedback_viewer import LONGEST_S, OPTIMISATION, STATE, STATES, UNCOMPILED

LIMIT_S = 2.0
"""Of the end of a closed window."""


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=count_of, default=3)
    parser.add_argument("--only", choices=("optimisation", "ends"))
    parser.add_argument("--states", nargs="+", default=list(STATES), metavar="NAME", help="of the table of ends")
    parser.add_argument("--shape", type=shape_of, help="of the modulators, x by y, instead of the presets'")
    args = parser.parse_args()
    with _display() as display, tempfile.TemporaryDirectory() as folder:
        arguments = () if args.shape is None else ("--set", f"shape={list(args.shape)}")
        viewers = Viewers(display, Path(folder), arguments)
        if args.only != "ends":
            _print_optimisation(viewers, args.rounds)
        if args.only != "optimisation":
            _print_ends(viewers, args.rounds, args.states)


def _print_optimisation(viewers: Viewers, rounds: int) -> None:
    print("| seconds | median | worst |\n| --- | ---: | ---: |")
    for name, is_compiled in (("compiled", True), ("not compiled", False)):
        if is_compiled:
            viewers.compile()
        found = [viewers.optimise(is_compiled) for _ in range(rounds)]
        for key in found[0]:
            values = [one[key] for one in found]
            print(f"| {name}: {key} | {statistics.median(values):.2f} | {max(values):.2f} |", flush=True)


def _print_ends(viewers: Viewers, rounds: int, states: Sequence[str]) -> None:
    print(f"| closed while | median s | worst s | above {LIMIT_S:g} s |\n| --- | ---: | ---: | ---: |")
    viewers.compile()
    for name in states:
        values = [viewers.end(name) for _ in range(rounds)]
        late = sum(value > LIMIT_S for value in values)
        print(f"| {name} | {statistics.median(values):.2f} | {max(values):.2f} | {late} of {rounds} |", flush=True)


class Viewers:
    """Starts viewers on a display, each with a state of its own and one cache, which `compile` fills."""

    def __init__(self, display: str, folder: Path, arguments: tuple[str, ...]) -> None:
        self._folder, self._arguments = folder, arguments
        self._environment = os.environ | {"DISPLAY": display}
        self._environment.pop("WAYLAND_DISPLAY", None)
        self._environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed program has its bytecode

    def compile(self) -> None:
        """Has the optimiser's kernels compiled."""
        code = "from holoview.holograms.optimise.kernel_choice import choose_kernels; choose_kernels('cpu')"
        subprocess.run([sys.executable, "-c", code], env=self._environment_of(True), check=True)

    def optimise(self, is_compiled: bool) -> dict[str, float]:
        """Seconds from the start of the program to its first image, and of an optimisation's first moments."""
        with self._viewer(OPTIMISATION, (), is_compiled) as (_, lines):
            return _told(lines)

    def end(self, name: str) -> float:
        """Seconds from closing the window in a state to the end of the program."""
        state = STATES[name]
        with self._viewer(name, state.arguments, name != UNCOMPILED) as (viewer, lines):
            window = int(_told(lines)["window"])
            time.sleep(state.wait_s)
            assert viewer.poll() is None, f"{name}: the viewer ended by itself with {viewer.returncode}"
            begun = time.perf_counter()
            close_window(self._environment["DISPLAY"], window)
            code = viewer.wait(LONGEST_S)
            assert code == 0, f"{name}: exit code {code}"
            return time.perf_counter() - begun

    def _environment_of(self, is_compiled: bool) -> dict[str, str]:
        cache = self._folder / ("cache" if is_compiled else f"cache-{time.monotonic_ns()}")
        return self._environment | {"XDG_CACHE_HOME": str(cache), "XDG_STATE_HOME": str(self._folder / "state")}

    @contextmanager
    def _viewer(
        self, name: str, arguments: Sequence[str], is_compiled: bool
    ) -> Iterator[tuple[subprocess.Popen[str], Iterator[str]]]:
        """A viewer that is brought into a state, and the lines that it prints."""
        shutil.rmtree(self._folder / "state", ignore_errors=True)
        environment = self._environment_of(is_compiled) | {STATE: json.dumps([name, time.time()])}
        code = "from benchmarks.feedback_viewer import view; view()"
        words = ("view", *arguments, *self._arguments, "--new")
        viewer = subprocess.Popen(
            [sys.executable, "-c", code, *words], env=environment, stdout=subprocess.PIPE, text=True
        )
        try:
            assert viewer.stdout is not None
            yield viewer, iter(viewer.stdout)
        finally:
            viewer.terminate()
            viewer.wait(LONGEST_S)


def _told(lines: Iterator[str]) -> dict[str, float]:
    """What a viewer says next. Ends the program if the viewer ended, which has said why."""
    line = next(lines, None)
    if line is None:
        raise SystemExit("a viewer ended before it said what was asked for")
    return dict(json.loads(line))


# --- the screen -------------------------------------------------------------------------------------------------------


@contextmanager
def _display() -> Iterator[str]:
    """The user's display, or a virtual one where Xvfb is installed: its windows can't be seen, and hide nothing."""
    if shutil.which("Xvfb") is None:
        yield os.environ["DISPLAY"]
        return
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-noreset", "-displayfd", str(write), "-screen", "0", "1280x800x24"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        with os.fdopen(read) as number:
            yield f":{number.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


class _ClientMessage(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("window", ctypes.c_ulong),
        ("message_type", ctypes.c_ulong),
        ("format", ctypes.c_int),
        ("data", ctypes.c_long * 5),
    )


class _Event(ctypes.Union):
    _fields_ = (("message", _ClientMessage), ("pad", ctypes.c_long * 24))


def close_window(display: str, window: int) -> None:
    """Sends a window what a window manager sends when its user closes it (WM_DELETE_WINDOW)."""
    x = ctypes.CDLL("libX11.so.6")
    x.XOpenDisplay.restype, x.XInternAtom.restype = ctypes.c_void_p, ctypes.c_ulong
    opened = ctypes.c_void_p(x.XOpenDisplay(display.encode()))
    names = [x.XInternAtom(opened, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW")]
    event = _Event()
    event.message.type, event.message.window, event.message.format = 33, window, 32  # ClientMessage
    event.message.message_type, event.message.data[0] = names
    x.XSendEvent(opened, ctypes.c_ulong(window), 0, ctypes.c_long(0), ctypes.byref(event))
    x.XCloseDisplay(opened)


if __name__ == "__main__":
    main()
