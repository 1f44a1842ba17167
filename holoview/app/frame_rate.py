"""Measures how many images a second the viewer shows while a focal plane is scrubbed, in a window off screen.

An image counts when it is computed, drawn with all panels, and read back to the host, as a canvas off screen does. A
window on a screen isn't read back, but waits for the screen.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from itertools import cycle
from typing import Any

from holoview.app.app import App
from holoview.app.input_driver import InputDriver
from holoview.document.document import middle_plane
from holoview.document.editing_session import EditingSession
from holoview.gpu.device import Device
from holoview.model.system import System
from holoview.render.view_settings import ViewSettings

_FRAME_S = 1 / 60
_NEAR, _FAR = 0.99, 1.01
_TIMEOUT_S = 60.0


def measure_frame_rate(
    system: System, device: Device, size: tuple[int, int], rounds: int, limit_s: float
) -> dict[str, Any]:
    """Times of an image in the viewer as JSON values, ms: of its window alone, of a scrub, and until its full frame.

    size: of the window (x, y) in pixels. rounds: images of each kind, fewer if they take more than `limit_s`.
    """
    from rendercanvas.offscreen import OffscreenRenderCanvas

    plane_m = middle_plane(system)
    session = EditingSession(system, view_settings=ViewSettings(plane_m=plane_m))
    app = App(session, device, OffscreenRenderCanvas(size=size), frame_s=_FRAME_S)
    try:
        driver = InputDriver(app)
        driver.draw_until_idle(max(limit_s, _TIMEOUT_S))
        planes_m = cycle([_NEAR * plane_m, plane_m, _FAR * plane_m])
        window_s = _repeat(driver.draw_frames, rounds, limit_s)
        scrub_s = _repeat(lambda: _scrub(driver, next(planes_m)), rounds, limit_s)
        driver.draw_until_idle(max(limit_s, _TIMEOUT_S))
        full_s = _repeat(lambda: _full(driver, next(planes_m)), rounds, limit_s)
    finally:
        app.close()
    columns, rows = (n * system.sampling.upsample for n in reversed(system.modulators[0].shape))
    return {
        "window": list(size),
        "size": [columns, rows],
        "wavelengths": len(system.wavelengths_m),
        "window_ms": 1e3 * statistics.median(window_s),
        "scrub_ms": 1e3 * statistics.median(scrub_s),
        "full_ms": 1e3 * statistics.median(full_s),
        "scrub_images_per_s": len(scrub_s) / sum(scrub_s),
        "rounds": len(scrub_s),
    }


def _scrub(driver: InputDriver, plane_m: float) -> None:
    """Change the focal plane, and draw its first image, which may be a quick one."""
    version = driver.context.side_renderers.now.picture
    driver.app.session.edit_view("Plane", plane_m=plane_m)
    while driver.context.side_renderers.now.picture is version:
        driver.app.compute_slice()
    driver.draw_frames()


def _full(driver: InputDriver, plane_m: float) -> None:
    """Change the focal plane, and draw its full frame, which may follow a quick one and a pause."""
    driver.app.session.edit_view("Plane", plane_m=plane_m)
    driver.app.compute_slice()
    while driver.context.side_renderers.is_busy:
        driver.app.compute_slice()
    driver.draw_frames()


def _repeat(job: Callable[[], object], rounds: int, limit_s: float) -> list[float]:
    """Seconds of each run of a job, after one that isn't timed; at least one."""
    job()
    seconds: list[float] = []
    while len(seconds) < rounds and (not seconds or sum(seconds) < limit_s):
        start = time.perf_counter()
        job()
        seconds.append(time.perf_counter() - start)
    return seconds
