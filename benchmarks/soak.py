"""Has a served viewer used at random for a long time, and looks whether memory, handles or the time of a frame grow.

    python -m benchmarks.soak --minutes 60
    python -m benchmarks.soak --minutes 60 --look

A process serves the viewer; this one plays the browser: it moves, clicks, drags, turns the wheel, presses keys, types,
changes the size of the window, and closes the connection and opens it again. Without --look it doesn't touch what
opens and writes files: the bar of menus, and keys with Ctrl other than undo, redo and the optimisation. The processor
time of a frame is that of the whole process, and so is little changed by other programs. At last the viewer gets a
Ctrl-C while a page is connected.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.gui.served import Served, browser_cookie, serving
from tests.patience import PATIENCE_S

_KEYS = [*"abcdefghijklmnopqrstuvwxyz0123456789?+-", "Escape", "Enter", "Tab", "F1", "Delete", " "]
_KEYS += ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "PageUp", "PageDown", "Home", "End"]
_SIZES = ((640, 400), (900, 600), (1280, 720), (320, 240))
_MENU_PX = 40  # of the bar of menus
_EVERY_S = 30.0
_FRAME_WAIT_S = 0.3
_MB = 1e6


@dataclass(frozen=True)
class Sample:
    """What the serving process takes after some seconds: bytes of memory, handles, threads; frames and their time."""

    seconds: float
    memory: int
    handles: int
    threads: int
    frames: int
    cpu_s: float

    @property
    def line(self) -> str:
        """As a row of the table."""
        frame_ms = 1e3 * self.cpu_s / max(self.frames, 1)
        figures = f"{self.memory / _MB:>10.0f} {self.handles:>8} {self.threads:>8}"
        return f"{self.seconds / 60:>7.1f} {figures} {self.frames:>8} {frame_ms:>10.0f}"


class RandomUser:
    """A page that does something at random. is_free: whether it may click and press everything."""

    def __init__(self, browser: ClientConnection, rng: random.Random, is_free: bool) -> None:
        self._browser, self._rng, self._is_free = browser, rng, is_free
        self.frames, self._size = 0, _SIZES[0]
        self._resize(_SIZES[0])

    def act(self) -> None:
        """Does one thing, and takes the frames that it makes."""
        choice = self._rng.random()
        if choice < 0.35:
            self._pointer("pointer_move", self._point())
        elif choice < 0.6:
            self._click()
        elif choice < 0.75:
            self._drag()
        elif choice < 0.85:
            x, y = self._point()
            self._send("wheel", x=x, y=y, dx=0.0, dy=self._rng.choice((-100.0, 100.0)), buttons=[], modifiers=[])
        elif choice < 0.98:
            self._press()
        else:
            self._resize(self._rng.choice(_SIZES))
        self._take_frames()

    def _click(self) -> None:
        place, button = self._point(), self._rng.choice((1, 1, 1, 1, 2, 3))
        for kind in ("pointer_move", "pointer_down", "pointer_up"):
            self._pointer(kind, place, button)

    def _drag(self) -> None:
        self._pointer("pointer_down", self._point(), 1)
        for _ in range(5):
            self._pointer("pointer_move", self._point(), 1)
        self._pointer("pointer_up", self._point(), 1)

    def _press(self) -> None:
        is_control = self._rng.random() < 0.3
        keys = _KEYS if self._is_free or not is_control else ["z", "y", "Enter"]
        key = self._rng.choice([key for key in keys if not (is_control and key == "q")])
        modifiers = ["Control"] if is_control else []
        for modifier in modifiers:
            self._send("key_down", key=modifier, modifiers=[])
        self._send("key_down", key=key, modifiers=modifiers)
        if len(key) == 1 and not is_control:
            self._send("char", data=key, is_composing=False, input_type="insertText")
        self._send("key_up", key=key, modifiers=modifiers)
        for modifier in modifiers:
            self._send("key_up", key=modifier, modifiers=[])

    def _point(self) -> tuple[float, float]:
        width, height = self._size
        return self._rng.uniform(0, width), self._rng.uniform(0 if self._is_free else _MENU_PX, height)

    def _pointer(self, kind: str, place: tuple[float, float], button: int = 0) -> None:
        x, y = place
        buttons = [button] if button and kind != "pointer_up" else []
        self._send(kind, x=x, y=y, button=button, buttons=buttons, modifiers=[], ntouches=0, touches={})

    def _resize(self, size: tuple[int, int]) -> None:
        width, height = self._size = size
        self._send("resize", width=width, height=height, pwidth=width, pheight=height, ratio=1.0)

    def _send(self, kind: str, **details: Any) -> None:
        self._browser.send(json.dumps({"type": kind, "timestamp": 0.0, **details}))

    def _take_frames(self) -> None:
        """Takes frames, and says that they were shown, until none comes for a moment."""
        while True:
            try:
                message = self._browser.recv(timeout=_FRAME_WAIT_S)
            except TimeoutError:
                return
            if isinstance(message, str) and (table := json.loads(message)).get("type") == "framebufferdata":
                self._browser.recv(timeout=60.0)
                self.frames += 1
                shown = {"index": table["index"], "timestamp": table["timestamp"], "localtime": 0.0}
                self._browser.send(json.dumps({"type": "_framefeedback", **shown}))
                if self.frames % 20 == 0:
                    return


def soak(served: Served, minutes: float, rng: random.Random, is_free: bool) -> list[Sample]:
    """Uses a viewer for some minutes; a row is printed each half a minute."""
    cookie = {"Cookie": browser_cookie(served.address, served.token)}
    process, began = psutil.Process(served.process.pid), time.monotonic()
    viewer = max([process, *process.children(recursive=True)], key=lambda one: one.memory_info().rss)
    samples: list[Sample] = []
    cpu_s, due, frames = _cpu_s(viewer), began + _EVERY_S, 0
    while time.monotonic() - began < 60 * minutes:
        with connect(f"ws://{served.address}/", additional_headers=cookie, max_size=None) as browser:
            user = RandomUser(browser, rng, is_free)
            reconnect_at = time.monotonic() + rng.uniform(60, 240)
            try:
                while time.monotonic() < min(reconnect_at, began + 60 * minutes):
                    user.act()
                    if time.monotonic() > due:
                        sample = _sample(viewer, began, frames + user.frames, _cpu_s(viewer) - cpu_s)
                        print(sample.line, flush=True)
                        samples.append(sample)
                        cpu_s, due, frames = _cpu_s(viewer), due + _EVERY_S, -user.frames
            except ConnectionClosed as error:
                print(f"the connection was closed: {error}", flush=True)
            frames += user.frames
    return samples or [_sample(viewer, began, frames, _cpu_s(viewer) - cpu_s)]


def _sample(viewer: psutil.Process, began: float, frames: int, cpu_s: float) -> Sample:
    memory = viewer.memory_info().rss
    return Sample(time.monotonic() - began, memory, viewer.num_fds(), viewer.num_threads(), frames, cpu_s)


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def end_s(served: Served) -> float:
    """Seconds from Ctrl-C until the viewer has ended, with a page that is connected."""
    cookie = {"Cookie": browser_cookie(served.address, served.token)}
    with connect(f"ws://{served.address}/", additional_headers=cookie, max_size=None) as browser:
        RandomUser(browser, random.Random(), False)
        time.sleep(1.0)
        began = time.monotonic()
        served.process.send_signal(signal.SIGINT)
        served.process.wait(PATIENCE_S)
        return time.monotonic() - began


def summary(samples: list[Sample]) -> str:
    """Medians of each quarter of the time."""
    count = len(samples)
    lines = [f"{'quarter':<8} {'memory MB':>10} {'handles':>8} {'threads':>8} {'ms a frame':>11}"]
    for number, name in enumerate(("first", "second", "third", "last")):
        part = samples[number * count // 4 : (number + 1) * count // 4] or samples
        memory, handles, threads = (median(getattr(s, key) for s in part) for key in ("memory", "handles", "threads"))
        frame_ms = 1e3 * sum(s.cpu_s for s in part) / max(sum(s.frames for s in part), 1)
        lines.append(f"{name:<8} {memory / _MB:>10.0f} {handles:>8.0f} {threads:>8.0f} {frame_ms:>11.0f}")
    return "\n".join(lines)


def main() -> None:
    """Prints a row each half a minute, a comparison of the quarters, and how long the viewer took to end."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--look", action="store_true", help="serve it to look at, and touch everything")
    args = parser.parse_args()
    print(f"{'minutes':>7} {'memory MB':>10} {'handles':>8} {'threads':>8} {'frames':>8} {'ms a frame':>10}")
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), *(["--look"] if args.look else [])) as served:
        print(summary(soak(served, args.minutes, random.Random(args.seed), args.look)), flush=True)
        print(f"ended {end_s(served):.1f} s after Ctrl-C", flush=True)


if __name__ == "__main__":
    main()
