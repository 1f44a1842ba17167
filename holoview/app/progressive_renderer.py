"""Keeps an image of a bench up to date on the device, in slices: the latest edit wins and stale work is dropped.

    an edit ─▶ quick frame (the cheaper bench) ─▶ the hand rests ─▶ full frame

The quick frame is left out where the full one is fast enough by itself.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.app.viewport import DeviceImage
from holoview.engine.incremental import IncrementalRenderer, UpdateProgress
from holoview.gpu.device import Device
from holoview.session.document import Drive
from holoview.session.quick_system import make_quick_system
from holoview.session.scene import Scene
from holoview.util.errors import UserError

QUICK_FRAME_ABOVE_S = 0.1
"""A full frame that takes longer than this is preceded by a quick one."""
QUICK_FRAME_BUDGET_S = 0.04
"""What a quick frame may take to compute: lasers are left out of it until it does."""
IDLE_BEFORE_FULL_S = 0.12
"""Without an edit for so long, a dragging hand rests, and the full frame begins."""
SLICE_S = 0.012
"""About so long the device is kept from drawing the window."""
_FEWEST_LASERS = 3


class TimedRenderer:
    """A `FrameSession` that is opened when it is first needed, and how long its steps take."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self.renderer: IncrementalRenderer | None = None
        self.step_s: float | None = None
        self.update_s = 0.0
        self._drive: Drive | None = None
        self._began = 0.0

    def start(self, scene: Scene) -> Iterator[UpdateProgress]:
        """The slices that bring the image to a scene. Raises UserError where that is impossible."""
        if self.renderer is None:
            self.renderer = IncrementalRenderer(scene.system, scene.drive, self._device, plane_m=scene.plane_m)
        else:
            drive = None if scene.drive is self._drive else scene.drive
            self.renderer.edit(system=scene.system, drive=drive, plane_m=scene.plane_m)
        self._drive, self._began = scene.drive, time.perf_counter()
        return self._timed(self.renderer.steps(with_srgb=False, wait=True, slice_s=SLICE_S))

    def expected_s(self) -> float | None:
        """How long the slices that are left will take; None before anything was measured."""
        if self.renderer is None or self.step_s is None:
            return None
        return self.renderer.pending_count(with_srgb=False) * self.step_s

    def _timed(self, steps: Iterator[UpdateProgress]) -> Iterator[UpdateProgress]:
        before, spent, done = time.perf_counter(), 0.0, 0
        for step in steps:
            spent += time.perf_counter() - before
            if step.done > done:
                self.step_s = spent if self.step_s is None else 0.7 * self.step_s + 0.3 * spent
                done, spent = step.done, 0.0
            yield step
            before = time.perf_counter()
        self.update_s = time.perf_counter() - self._began


class ProgressiveRenderer:
    """One image that follows a scene. Call `want` at each change and `advance` while `is_busy`."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._full, self._quick = TimedRenderer(device), TimedRenderer(device)
        self._wanted: Scene | None = None
        self._stage = "done"
        self._steps: Iterator[UpdateProgress] | None = None
        self._requested_at, self._version = 0.0, 0
        self.picture: DeviceImage | None = None
        self.progress = 1.0
        self.full_scene: Scene | None = None
        self.quick_gain = 1.0
        self._quick_scene: Scene | None = None
        self._gain_of: object = None
        self._xyz_cache: tuple[int, NDArray[np.float32]] | None = None
        self._lasers_host: tuple[int, NDArray[np.float32]] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether there is something to compute."""
        return self._stage != "done"

    @property
    def is_fresh(self) -> bool:
        """Whether the picture is the full one of what is wanted."""
        return self._stage == "done" and self.picture is not None

    @property
    def full_renderer(self) -> IncrementalRenderer | None:
        """The renderer of full frames; None before the first was begun."""
        return self._full.renderer

    @property
    def update_s(self) -> float:
        """How long the last full frame took from its first slice to its last."""
        return self._full.update_s

    @property
    def quick_s(self) -> float:
        """How long the last quick frame took."""
        return self._quick.update_s

    @property
    def wait_s(self) -> float:
        """How long to wait until `advance` has something to do."""
        if self._stage != "full" or self._steps is not None or self.picture is None:
            return 0.0
        return max(self._requested_at + IDLE_BEFORE_FULL_S - time.perf_counter(), 0.0)

    def request(self, scene: Scene) -> None:
        """Asks for another image; work on the one before is dropped."""
        if scene.is_same(self._wanted):
            return
        self._wanted, self._requested_at = scene, time.perf_counter()
        self._steps, self.progress = None, 0.0
        self._stage = "quick" if self._is_slow(scene) else "full"

    def compute_slice(self) -> bool:
        """Computes a slice; whether the picture has changed. Raises UserError where the scene is impossible."""
        if self._stage == "done" or self.wait_s > 0:
            return False
        assert self._wanted is not None
        try:
            if self._steps is None:
                self._steps = self._begin(self._wanted)
            step = next(self._steps, None)
        except Exception:  # not to be tried again and again: the user is told, and may edit what is wrong
            self._stage, self._steps = "done", None
            raise
        if step is not None:
            self.progress = step.done / step.total if self._stage == "full" else 0.0
            if step.done < step.total:
                return False
            next(self._steps, None)  # its end, where it is timed
        self._finish()
        return True

    def xyz(self) -> NDArray[np.float32] | None:
        """The full image on the host, XYZ (y, x, 3); None until it is there."""
        if not self.is_fresh or self._full.renderer is None or self.full_scene is None:
            return None
        if self._xyz_cache is None or self._xyz_cache[0] != self._version:
            self._xyz_cache = (self._version, self._full.renderer.xyz())
        return self._xyz_cache[1]

    def poll_strategy(self) -> None:
        """Lets the full frame go on by a faster strategy, where the search in the background has found one."""
        if self._full.renderer is not None:
            self._full.renderer.poll_strategy()

    def close(self) -> None:
        """Ends that search."""
        for engine in (self._full, self._quick):
            if engine.renderer is not None:
                engine.renderer.close()

    def intensity(self, wavelength: int) -> NDArray[np.float32] | None:
        """Intensity (y, x) of a laser of the full image; None until it is there."""
        if not self.is_fresh or self._full.renderer is None:
            return None
        return self._full.renderer.intensity(wavelength)

    def intensities(self) -> NDArray[np.float32] | None:
        """Intensities (wavelength, y, x) of the full image; None until it is there."""
        if not self.is_fresh or self._full.renderer is None:
            return None
        if self._lasers_host is None or self._lasers_host[0] != self._version:
            count = len(self._full.renderer.system.wavelengths_m)
            both = np.stack([self._full.renderer.intensity(i) for i in range(count)])
            self._lasers_host = (self._version, both)
        return self._lasers_host[1]

    # --- stages -----------------------------------------------------------------------------------------------------

    def _is_slow(self, scene: Scene) -> bool:
        """Whether the full frame would keep a hand waiting."""
        if self._full.renderer is None or self._full.step_s is None:
            return self._device.info.is_cpu
        try:
            self._full.start(scene)
        except UserError:
            return False
        return (self._full.expected_s() or 0.0) > QUICK_FRAME_ABOVE_S

    def _begin(self, scene: Scene) -> Iterator[UpdateProgress]:
        if self._stage == "full":
            return self._full.start(scene)
        try:
            quick_system = make_quick_system(scene.system, self._quick_laser_count(scene))
            return self._quick.start(replace(scene, system=quick_system))
        except UserError:  # a grid that has no cheaper version
            self._stage = "full"
            return self._full.start(scene)

    def _quick_laser_count(self, scene: Scene) -> int | None:
        """How many lasers a quick frame has time for, as its steps went so far."""
        if self._quick.step_s is None:
            return None
        sources = len(scene.system.source.directions_rad)
        return max(int(QUICK_FRAME_BUDGET_S / (self._quick.step_s * sources)), _FEWEST_LASERS)

    def _finish(self) -> None:
        engine = self._quick if self._stage == "quick" else self._full
        assert engine.renderer is not None and self._wanted is not None
        self._version += 1
        is_quick, shape = self._stage == "quick", engine.renderer.compositor.shape
        gain = self.quick_gain if is_quick else 1.0
        self.picture = DeviceImage(engine.renderer.xyz_buffer, shape, is_quick, self._version, gain)
        self._steps = None
        if is_quick:
            self._stage, self._quick_scene = "full", self._wanted
            return
        self._stage, self.progress, self.full_scene = "done", 1.0, self._wanted
        self._compare_brightness()

    def _compare_brightness(self) -> None:
        """How much brighter the cheaper bench is, unless that is known: its light can't leave to higher orders."""
        assert self._wanted is not None
        system = self._wanted.system
        of = (system.modulators, system.sampling, system.gap_m is None)
        if of == self._gain_of or self._quick_scene is not self._wanted or self._quick.renderer is None:
            return
        full, quick = self.xyz(), self._quick.renderer.xyz()
        if full is not None and quick[..., 1].any():
            self._gain_of = of
            self.quick_gain = float(full[..., 1].mean() / quick[..., 1].mean())
