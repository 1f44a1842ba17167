"""Jobs that a renderer is timed with: a whole frame, and edits after which part of it is computed anew."""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle
from typing import Any

from holoview.benchmark.strategy_choice import resolve_strategy
from holoview.benchmark.timing import TimedJob
from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import Device
from holoview.gpu.tune import StrategyOption
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.view import random_drive

_CHANGE = 1.01
"""Factor between the two values that an edit alternates between."""


def open_renderer(
    system: System, device: Device, half: bool = False, strategy: StrategyOption = "auto", max_wavelengths: int = 1
) -> IncrementalRenderer:
    """A renderer of a random drive at the middle focal plane, with its first frame rendered."""
    middle = middle_plane_m(system)
    chosen = resolve_strategy(device, make_plan(system, [*system.planes_m, middle]).grid.padded, strategy)
    renderer = IncrementalRenderer(
        system,
        random_drive(system),
        device,
        plane_m=middle,
        half=half,
        strategy=chosen,
        max_wavelengths=max_wavelengths,
    )
    renderer.update()
    return renderer


def middle_plane_m(system: System) -> float:
    """The focal plane at which frames are rendered, m."""
    return float(system.planes_m[len(system.planes_m) // 2])


def full_frame(renderer: IncrementalRenderer) -> TimedJob:
    """Render everything from the light source to XYZ."""

    def job() -> None:
        renderer.invalidate()
        _update_and_wait(renderer)

    return job


def frames_in_a_row(renderer: IncrementalRenderer, count: int) -> TimedJob:
    """Render `count` frames and wait once, at the end."""

    def job() -> None:
        for _ in range(count):
            renderer.invalidate()
            renderer.update(with_srgb=False)
        renderer.device.wait()

    return job


def scrub(renderer: IncrementalRenderer) -> TimedJob:
    """Alternate between two focal planes."""
    planes_m = cycle([renderer.plane_m * _CHANGE, renderer.plane_m])
    return _edit(renderer, lambda: {"plane_m": next(planes_m)})


def gap_edit(renderer: IncrementalRenderer) -> TimedJob | None:
    """Alternate between two gaps of the modulators; None for a bench with one modulator."""
    before = renderer.system
    if before.gap_m is None:
        return None
    gaps_m = cycle([before.gap_m * _CHANGE, before.gap_m])
    return _edit(renderer, lambda: {"system": renderer.system.edit({"gap": next(gaps_m)})})


def amplitude_edit(renderer: IncrementalRenderer) -> TimedJob:
    """Alternate between two amplitudes of all lasers."""
    factors = cycle([_CHANGE, 1.0])
    amplitudes = renderer.system.amplitudes
    return _edit(renderer, lambda: {"system": renderer.system.with_(amplitudes=amplitudes * next(factors))})


def _edit(renderer: IncrementalRenderer, change: Callable[[], dict[str, Any]]) -> TimedJob:
    """Time from an edit to XYZ, with all earlier results up to date."""

    def job() -> None:
        renderer.edit(**change())
        _update_and_wait(renderer)

    return job


def _update_and_wait(renderer: IncrementalRenderer) -> None:
    renderer.update(with_srgb=False)
    renderer.device.wait()
