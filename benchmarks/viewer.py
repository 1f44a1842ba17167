"""Measures how fast the viewer responds to input while it computes, after a change of plane or gap, and when idle.

    python -m benchmarks.viewer [--preset NAME] [--size WxH] [--adapter NAME]

The window is off screen, by default 1280 × 800 pixels. A response is a frame that was drawn and read back after the
event. The event arrives when a slice of the computation begins, which is the worst case.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from rendercanvas.offscreen import OffscreenRenderCanvas

from benchmarks.common import count_of, shape_of
from holoview.light.gpu.device import open_device
from holoview.light.model import preset
from holoview.viewer.app.app import App
from holoview.viewer.app.script import InputDriver
from holoview.viewer.document.editing_session import EditingSession


def main() -> None:
    """Print a table of medians and maxima."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--preset", default="holochrome-8")
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("--adapter")
    parser.add_argument("--events", type=count_of, default=24)
    parser.add_argument("--shape", type=shape_of, help="of the modulators, x by y, instead of the preset's")
    args = parser.parse_args()
    width, height = (int(side) for side in args.size.split("x"))
    device = open_device(args.adapter)
    system, events = preset.load(args.preset), range(args.events)
    if args.shape is not None:
        system = system.with_(shape=list(args.shape))
    app = App(EditingSession(system), device, OffscreenRenderCanvas(size=(width, height)), frame_s=1 / 60)
    driver = InputDriver(app)
    driver.draw_frames(4)
    driver.draw_until_idle()
    print(f"{args.preset}, window {args.size}, {device.info.label}")
    _line("the window alone", [_timed(driver.draw_frames) for _ in events])
    _line(
        "input while all is computed anew",
        _while_computing(driver, events, lambda i: _gap(driver, 2e-3 + 1e-5 * (i + 1))),
    )
    driver.draw_until_idle()
    _line("scrub: quick frame on the screen", [_scrub(driver, 9.1e-3 + 2e-5 * i) for i in events])
    for name, change in (
        ("focal plane", lambda i: _plane(driver, 1.05e-2 + 1e-5 * i)),
        ("gap", lambda i: _gap(driver, 3e-3 + 1e-5 * i)),
    ):
        _line(f"full frame after {name}", [_full(driver, change, i) for i in range(3)])
    app.close()


def _while_computing(driver: InputDriver, events: range, edit: Callable[[int], None]) -> list[float]:
    """Seconds to respond to each of several pointer moves, while slices of a full frame are computed."""
    seconds: list[float] = []
    for number in events:
        if not driver.context.side_renderers.now.is_busy:
            edit(number)
        start = time.perf_counter()
        driver.app.compute_slice()
        driver.move((400 + 5.0 * number, 300))
        seconds.append(time.perf_counter() - start)
        time.sleep(driver.context.side_renderers.wait_s)
    return seconds


def _scrub(driver: InputDriver, plane_m: float) -> float:
    """Seconds from a change of the focal plane until its quick frame is drawn."""
    start, version = time.perf_counter(), driver.context.side_renderers.now.picture
    _plane(driver, plane_m)
    while driver.context.side_renderers.now.picture is version:
        driver.app.compute_slice()
    driver.draw_frames()
    return time.perf_counter() - start


def _full(driver: InputDriver, change: Callable[[int], None], number: int) -> float:
    """Seconds from an edit to the full frame, including the pause and the quick frame that precede it."""
    start = time.perf_counter()
    change(number)
    driver.app.compute_slice()
    while driver.context.side_renderers.is_busy:
        driver.app.compute_slice()
    return time.perf_counter() - start


def _plane(driver: InputDriver, plane_m: float) -> None:
    driver.app.session.edit_view("Plane", plane_m=plane_m)


def _gap(driver: InputDriver, gap_m: float) -> None:
    driver.app.session.change("Gap", {"gap": gap_m})


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _line(name: str, seconds: list[float]) -> None:
    print(f"{name:36} median {1e3 * float(np.median(seconds)):7.1f} ms   worst {1e3 * max(seconds):7.1f} ms")


if __name__ == "__main__":
    main()
