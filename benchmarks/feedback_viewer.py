"""A viewer that is brought into a state and measured from inside, for `benchmarks.feedback`, which starts it.

The process that supervises the viewer imports this too, and ends as fast as it does for `holoview view`: so what only
the viewer's own process needs is imported within functions.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from holoview.commands.supervisor import supervise

if TYPE_CHECKING:
    from holoview.viewer.app.app import App

STATE = "HOLOVIEW_FEEDBACK_STATE"
"""The environment's variable with the name of the state, and when the program was started."""
OPTIMISATION = "an optimisation"
"""The name of what isn't a state, but measured."""
LONGEST_S = 180.0
_RIG = "docs/viewer-tour-rig.toml"
_POLL_S, _TICK_S = 0.01, 0.005
_REST_S = 8.0  # from the first image until one optimises: who looks at it first
_ENDLESS = 100_000  # iterations: an optimisation that ends before it is looked at can't be measured


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
UNCOMPILED = "compiling beside it, 6 s"


def view() -> None:
    """The viewer as `holoview` starts it, in a process that another one supervises."""
    sys.exit(supervise(view_in_state, sys.argv[1:]))


def view_in_state(words: Sequence[str]) -> int:
    """Opens the viewer and brings it into the state that the environment names."""
    from holoview.commands import cli
    from holoview.viewer.app import run

    (name, started), open_app = json.loads(os.environ[STATE]), run.open_app

    def open_and_act(session: Any, device: Any, canvas: Any, *more: Any, **named: Any) -> App:
        app = open_app(session, device, canvas, *more, **named)
        threading.Thread(target=_work, args=(app, name, started), daemon=True).start()
        return app

    run.open_app = open_and_act
    return cli.main(words)


def _work(app: App, name: str, started: float) -> None:
    """What is measured or done; the viewer ends at once where it fails, or who started it would wait for its lines."""
    try:
        if name == OPTIMISATION:
            _measure_optimisation(app, started)
        else:
            _bring_into_state(app, STATES[name])
    except BaseException:
        traceback.print_exc()
        os._exit(1)


def _bring_into_state(app: App, state: State) -> None:
    if state.command or state.for_image:
        _wait(lambda: app.has_shown_image and not app.is_busy)
    if state.arguments[:1] == ("--rig",):
        _wait(lambda: app.context.opened_rig is not None and not app.context.opened_rig.is_busy)
    if state.command:
        done = threading.Event()
        app.session.call_on_owner(lambda: (_act(app, state.command), done.set()))  # type: ignore[func-returns-value]
        done.wait(LONGEST_S)
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


def _measure_optimisation(app: App, started: float) -> None:
    """Measures from the start to an optimisation's first picture, and for how long the window stands still at rest."""
    from holoview.viewer.document.optimisation_job import running_optimisation

    _wait(lambda: app.has_shown_image)
    found = {"start of the program to the first image": time.time() - started}
    _wait(lambda: not app.is_busy)
    found["longest time without a turn of the window's loop, at rest"] = _longest_pause(app, _REST_S)
    choices = replace(app.session.optimisation_choices, iterations=_ENDLESS)
    app.session.call_on_owner(lambda: app.session.choose_optimisation(choices))
    begun, worked = time.perf_counter(), time.process_time()
    app.session.call_on_owner(lambda: app.context.commands.run("Optimise"))
    _wait(lambda: running_optimisation(app.session) is not None)
    job = running_optimisation(app.session)
    assert job is not None
    _wait(lambda: job.note != "building the target" and job.note != "")
    found["Ctrl+Enter to the target"] = time.perf_counter() - begun
    _wait(lambda: job.latest is not None)
    found["Ctrl+Enter to the first iteration"] = time.perf_counter() - begun
    found["the same, processor time"] = time.process_time() - worked
    _wait(lambda: app.session.preview_document is not None and app.context.side_renderers.now.follows)
    found["Ctrl+Enter to its first picture"] = time.perf_counter() - begun
    _tell(found)


def _longest_pause(app: App, seconds: float) -> float:
    """Asks the window's loop for its turn again and again, for some seconds; returns the longest time it took."""
    longest, until = 0.0, time.perf_counter() + seconds
    while time.perf_counter() < until:
        turn, asked = threading.Event(), time.perf_counter()
        app.session.call_on_owner(turn.set)
        turn.wait(LONGEST_S)
        longest = max(longest, time.perf_counter() - asked)
        time.sleep(_TICK_S)
    return longest


def _wait(is_so: Callable[[], bool]) -> None:
    until = time.monotonic() + LONGEST_S
    while not is_so():
        assert time.monotonic() < until, "the viewer took too long"
        time.sleep(_POLL_S)


def _tell(facts: dict[str, Any]) -> None:
    print(json.dumps(facts), flush=True)
