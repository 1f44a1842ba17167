"""How long a served viewer takes until it shows its work again after its graphics device was lost.

    python -m benchmarks.device_loss --runs 10
    python -m benchmarks.device_loss --runs 10 --shape 768 1024
    python -m benchmarks.device_loss --runs 5 --optimise

The loss is simulated: a thread destroys the device, which then refuses whatever is asked of it, as one does whose
driver was reset. The viewer notices that when it draws next, ends, and is started again with the work by the process
that supervises it. A row has the seconds from the loss until the new process can be connected to, until it has sent a
picture of the window, and until the hologram in it is as it was before (with --optimise: is seen), and the processor
seconds of the new process until then. A change that was made before has to be there, and with --optimise the
optimisation has to come to its end.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from benchmarks.common import count_of
from benchmarks.lossy_viewer import LOSE
from holoview.viewer.document.session_store import SessionStore
from tests.gui.served import Served, browser_cookie, next_frame, serving
from tests.patience import PATIENCE_S

_PROGRAM = ("-m", "benchmarks.lossy_viewer")
_SIZE = (900, 600)
_MIDDLE = (slice(200, 400), slice(300, 550))  # of the window: inside the image, beside notifications
_SAME, _SEEN = 4.0, 10.0  # levels of 8 bits: mean difference of pictures that are alike, deviation of a picture
_BLOCK = 4  # pixels along a side, whose means are compared
_STILL_FRAMES, _STILL_S = 8, 5.0  # pictures alike for so long; a quick image is still, too, until the full one is there
_REST_S = 0.3  # without a picture, after which the pointer is moved


@dataclass(frozen=True)
class Recovery:
    """Seconds after a loss, as the columns say."""

    connected: float
    window: float
    picture: float
    processor: float


class Page:
    """A page of a browser, which shows what the viewer draws."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        width, height = _SIZE
        self.send("resize", width=width, height=height, pwidth=width, pheight=height, ratio=1.0)

    def send(self, kind: str, **details: Any) -> None:
        """Sends an event."""
        self._connection.send(json.dumps({"type": kind, "timestamp": 0.0, **details}))

    def press(self, key: str, *modifiers: str) -> None:
        """Presses a key and takes it up again."""
        for pressed in (*modifiers, key):
            self.send("key_down", key=pressed, modifiers=list(modifiers))
        self.picture()
        for pressed in (key, *modifiers):
            self.send("key_up", key=pressed, modifiers=list(modifiers))

    def point(self, place: float) -> None:
        """Moves the pointer, after which the viewer draws."""
        self.send("pointer_move", x=place, y=590.0, button=0, buttons=[], modifiers=[], ntouches=0, touches={})

    def picture(self, timeout_s: float = PATIENCE_S) -> NDArray[np.int_]:
        """The next picture of the window (y, x, 3). Raises TimeoutError."""
        return next_frame(self._connection, timeout_s)

    def wait_for(self, is_right: Callable[[NDArray[np.int_]], bool]) -> NDArray[np.int_]:
        """The first picture (y, x, 3) that is right, whose middle is passed."""
        until = time.monotonic() + PATIENCE_S
        for place in range(10_000):
            try:
                picture = self.picture(_REST_S)
            except TimeoutError:  # the viewer rests
                self.point(100.0 + place % 50)
                picture = self.picture()
            if picture.shape[:2] == _SIZE[::-1] and is_right(picture[_MIDDLE]):
                return picture
            if time.monotonic() > until:
                break
        raise TimeoutError("the picture didn't become as it has to be")

    def wait_until_still(self, frames: int) -> NDArray[np.int_]:
        """The middle of the picture once it has been the same for some frames and seconds; at once for no frames."""
        last, count, since = self.wait_for(lambda middle: True)[_MIDDLE], 0, time.monotonic()
        while frames and (count < frames or time.monotonic() - since < _STILL_S):
            picture = self.wait_for(lambda middle: True)[_MIDDLE]
            if _differ(picture, last) < _SAME / 2:
                count += 1
            else:
                count, since = 0, time.monotonic()
            last = picture
        return last


def recovery(folder: Path, options: Sequence[str], optimises: bool) -> Recovery:
    """Starts a viewer that loses its device once. Raises RuntimeError if its work isn't there afterwards."""
    told = folder / "lose"
    os.environ[LOSE] = str(told)
    with serving(folder, *options, program=_PROGRAM) as served:
        with _page(served) as page:
            page.wait_for(lambda middle: middle.std() > _SEEN)
            page.press("Escape")  # the tour
            page.press("e")  # another look: the exposure
            before = page.wait_until_still(0 if optimises else _STILL_FRAMES)
            if optimises:
                _begin_optimisation(page, served)
            told.touch()
            began = time.monotonic()
            _draw_until_closed(page)
        served = served.restarted()
        with _page(served) as page:
            connected = time.monotonic() - began
            page.wait_for(lambda middle: True)
            window = time.monotonic() - began
            page.wait_for(lambda middle: middle.std() > _SEEN and (optimises or _differ(middle, before) < _SAME))
            found = Recovery(connected, window, time.monotonic() - began, _processor_s(served))
            wanted, done = ("Optimise", served.edits) if optimises else ("Exposure", served.looks)
            _look_until(page, lambda: any(label.startswith(wanted) for label in done()))
    return found


@contextmanager
def _page(served: Served) -> Iterator[Page]:
    cookie = {"Cookie": browser_cookie(served.address, served.token)}
    with connect(f"ws://{served.address}/", additional_headers=cookie, max_size=None, ping_interval=None) as connection:
        yield Page(connection)


def _begin_optimisation(page: Page, served: Served) -> None:
    """Returns once a running optimisation has been saved; one that has come to its end before is begun again."""
    ended = -1

    def is_running() -> bool:
        nonlocal ended
        if _has_unfinished(served):
            return True
        if (count := sum(label.startswith("Optimise") for label in served.edits())) > ended:
            ended = count
            page.press("Enter", "Control")
        return False

    _look_until(page, is_running)


def _draw_until_closed(page: Page) -> None:
    until = time.monotonic() + PATIENCE_S
    with suppress(ConnectionClosed):
        for place in itertools.count():
            page.point(100.0 + place % 50)
            page.picture()
            if time.monotonic() > until:
                raise RuntimeError(f"the viewer goes on {PATIENCE_S:.0f} s after its device was to be lost")


def _differ(first: NDArray[np.int_], second: NDArray[np.int_]) -> float:
    """Mean difference of means over blocks: a window at rest is sent once more, less compressed."""
    rows, columns = (n // _BLOCK for n in first.shape[:2])
    blocks = (first - second)[: rows * _BLOCK, : columns * _BLOCK].reshape(rows, _BLOCK, columns, _BLOCK, -1)
    return float(np.abs(blocks.mean(axis=(1, 3))).mean())


def _has_unfinished(served: Served) -> bool:
    """Whether a running optimisation has been saved."""
    return any(
        saved.restore_with_unfinished()[1] for saved in SessionStore(served.folder / "holoview").saved_sessions()
    )


def _look_until(page: Page, is_so: Callable[[], bool]) -> None:
    """Shows pictures, without which a viewer draws no others, until something is so."""
    until = time.monotonic() + PATIENCE_S
    while not is_so():
        if time.monotonic() > until:
            raise RuntimeError("the work isn't there")
        page.wait_for(lambda middle: True)


def _processor_s(served: Served) -> float:
    """Processor seconds of the process that serves now."""
    children = psutil.Process(served.process.pid).children()
    times = max(children, key=lambda child: child.create_time()).cpu_times()
    return float(times.user + times.system)


def main() -> None:
    """Prints a row for each loss, and the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=count_of, default=10)
    parser.add_argument("--shape", type=int, nargs=2, default=(192, 256), metavar=("ROWS", "COLUMNS"))
    parser.add_argument("--optimise", action="store_true", help="in the middle of an optimisation")
    args = parser.parse_args()
    options = ("--new", "--set", f"shape={list(args.shape)}")
    rows: list[Recovery] = []
    print("connected  window  picture  processor  load")
    for _ in range(args.runs):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(recovery(Path(folder), options, args.optimise))
        print(_line(rows[-1]), f"{os.getloadavg()[0]:>5.1f}", flush=True)
    print(_line(Recovery(*(median(column) for column in zip(*map(astuple, rows), strict=True)))), "(medians)")


def _line(row: Recovery) -> str:
    return f"{row.connected:>9.2f} {row.window:>7.2f} {row.picture:>8.2f} {row.processor:>10.2f}"


if __name__ == "__main__":
    main()
