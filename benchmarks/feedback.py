"""Measures how long a person waits in a real window: for an optimisation to be seen, and for a closed window's program.

    python -m benchmarks.feedback [--rounds N] [--only optimisation|ends] [--states NAME…]

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
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import count_of
from holoview.commands import cli
from holoview.commands.supervisor import supervise
from holoview.viewer.app import run
from holoview.viewer.app.app import App
from holoview.viewer.document.optimisation_job import running_optimisation

_STATE, _RIG = "HOLOVIEW_FEEDBACK_STATE", "docs/viewer-tour-rig.toml"
_POLL_S, _TICK_S, _LONGEST_S = 0.01, 0.005, 180.0
_REST_S = 8.0  # from the first image until one optimises: who looks at it first
LIMIT_S = 2.0
"""Of the end of a closed window."""


@dataclass(frozen=True)
class State:
    """A state in which a window is closed: what is done, and how long after it.

    command: done once the first image is there; "" for nothing. wait_s: from then, or without a command from the
    moment at which the window is made. for_image: whether the first image is waited for without a command too.
    arguments: of the viewer.
    """

    command: str = ""
    wait_s: float = 0.0
    for_image: bool = False
    arguments: tuple[str, ...] = ()


STATES = {
    "opened": State(),
    "preparing, 0.5 s": State(wait_s=0.5),
    "preparing, 1 s": State(wait_s=1.0),
    "preparing 16 wavelengths, 1 s": State(wait_s=1.0, arguments=("holochrome-16",)),
    "preparing 3 × 3 sources, 1.5 s": State(wait_s=1.5, arguments=("multisource-3x3",)),
    "preparing a chain, 1 s": State(wait_s=1.0, arguments=("high-contrast",)),
    "at rest, light by gap": State(wait_s=8.0, for_image=True),
    "a dialog": State("Open…", 1.0),
    "comparing": State("Simultaneous beside HoloChrome", 0.5),
    "optimising, 1 s": State("Optimise", 1.0),
    "optimising, 3 s": State("Optimise", 3.0),
    "optimising, 12 s": State("Optimise", 12.0),
    "compiling beside it, 6 s": State("Optimise", 6.0),
    "a sweep": State("sweep", 5.0),
    "a film": State("film", 5.0),
    "a rig that measures": State("Run the default plan", 2.0, arguments=("--rig", _RIG)),
}
_UNCOMPILED = "compiling beside it, 6 s"


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=count_of, default=3)
    parser.add_argument("--only", choices=("optimisation", "ends"))
    parser.add_argument("--states", nargs="+", default=list(STATES), metavar="NAME", help="of the table of ends")
    parser.add_argument("--arguments", nargs="*", default=[], help="of every viewer, such as --set shape=[24,32]")
    args = parser.parse_args()
    with _display() as display, tempfile.TemporaryDirectory() as folder:
        viewers = Viewers(display, Path(folder), tuple(args.arguments))
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

    def compile(self) -> None:
        """Has the optimiser's kernels compiled."""
        code = "from holoview.holograms.optimise.kernel_choice import choose_kernels; choose_kernels('cpu')"
        subprocess.run([sys.executable, "-c", code], env=self._environment_of(True), check=True)

    def optimise(self, is_compiled: bool) -> dict[str, float]:
        """Seconds from the start of the program to its first image, and of an optimisation's first moments."""
        with self._viewer("optimise", (), is_compiled) as (_, lines):
            return dict(json.loads(next(lines)))

    def end(self, name: str) -> float:
        """Seconds from closing the window in a state to the end of the program."""
        state = STATES[name]
        with self._viewer(name, state.arguments, name != _UNCOMPILED) as (viewer, lines):
            window = int(json.loads(next(lines))["window"])
            time.sleep(state.wait_s)
            assert viewer.poll() is None, f"{name}: the viewer ended by itself with {viewer.returncode}"
            begun = time.perf_counter()
            close_window(self._environment["DISPLAY"], window)
            code = viewer.wait(_LONGEST_S)
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
        environment = self._environment_of(is_compiled) | {_STATE: json.dumps([name, time.time()])}
        code = "from benchmarks.feedback import view; view()"
        words = ("view", *arguments, *self._arguments, "--new")
        viewer = subprocess.Popen(
            [sys.executable, "-c", code, *words], env=environment, stdout=subprocess.PIPE, text=True
        )
        try:
            assert viewer.stdout is not None
            yield viewer, iter(viewer.stdout)
        finally:
            viewer.terminate()
            viewer.wait(_LONGEST_S)


# --- in the viewer's process ------------------------------------------------------------------------------------------


def view() -> None:
    """The viewer as `holoview` starts it, in a process that another one supervises."""
    sys.exit(supervise(view_in_state, sys.argv[1:]))


def view_in_state(words: Sequence[str]) -> int:
    """Opens the viewer and brings it into the state that the environment names."""
    (name, started), open_app = json.loads(os.environ[_STATE]), run.open_app

    def open_and_act(session: Any, device: Any, canvas: Any, *more: Any, **named: Any) -> App:
        app = open_app(session, device, canvas, *more, **named)
        work = _measure_optimisation if name == "optimise" else _bring_into_state
        threading.Thread(target=work, args=(app, name, started), daemon=True).start()
        return app

    run.open_app = open_and_act
    return cli.main(words)


def _bring_into_state(app: App, name: str, started: float) -> None:
    state = STATES[name]
    if state.command or state.for_image:
        _wait(lambda: app.has_shown_image and not app.is_busy)
    if state.arguments[:1] == ("--rig",):
        _wait(lambda: app.context.opened_rig is not None and not app.context.opened_rig.is_busy)
    if state.command:
        done = threading.Event()
        app.session.call_on_owner(lambda: (_act(app, state.command), done.set()))  # type: ignore[func-returns-value]
        done.wait(_LONGEST_S)
    import glfw

    _tell({"window": glfw.get_x11_window(app.window.canvas._window)})


def _act(app: App, command: str) -> None:
    if command == "sweep":
        from holoview.viewer.document.sweep_job import start_sweep
        from holoview.viewer.document.sweeper import SweepRequest

        start_sweep(app.session, SweepRequest("gap=1mm:3mm:9", "psnr", 20))
    elif command == "film":
        from holoview.viewer.document.optimisation_job import start_live_optimisation

        start_live_optimisation(app.session, "assets")
    else:
        app.context.commands.run(command)


def _measure_optimisation(app: App, name: str, started: float) -> None:
    """Measures from the start to the first iteration, and for how long the window stands still at rest."""
    _wait(lambda: app.has_shown_image)
    found = {"start of the program to the first image": time.time() - started}
    _wait(lambda: not app.is_busy)
    found["longest time without a turn of the window's loop, at rest"] = _longest_pause(app, _REST_S)
    begun = time.perf_counter()
    app.session.call_on_owner(lambda: app.context.commands.run("Optimise"))
    _wait(lambda: running_optimisation(app.session) is not None)
    job = running_optimisation(app.session)
    assert job is not None
    _wait(lambda: job.note != "building the target" and job.note != "")
    found["Ctrl+Enter to the target"] = time.perf_counter() - begun
    _wait(lambda: job.latest is not None)
    found["Ctrl+Enter to the first iteration"] = time.perf_counter() - begun
    _wait(lambda: app.session.preview_document is not None and not app.context.side_renderers.is_busy)
    found["Ctrl+Enter to its picture in full"] = time.perf_counter() - begun
    _tell(found)


def _longest_pause(app: App, seconds: float) -> float:
    """Asks the window's loop for its turn again and again, for some seconds; returns the longest time it took."""
    longest, until = 0.0, time.perf_counter() + seconds
    while time.perf_counter() < until:
        turn, asked = threading.Event(), time.perf_counter()
        app.session.call_on_owner(turn.set)
        turn.wait(_LONGEST_S)
        longest = max(longest, time.perf_counter() - asked)
        time.sleep(_TICK_S)
    return longest


def _wait(is_so: Callable[[], bool]) -> None:
    until = time.monotonic() + _LONGEST_S
    while not is_so():
        assert time.monotonic() < until, "the viewer took too long"
        time.sleep(_POLL_S)


def _tell(facts: dict[str, Any]) -> None:
    print(json.dumps(facts), flush=True)


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
