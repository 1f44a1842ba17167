"""Keeps the image of a scene up to date on the device, in short slices between frames of the window.

    edit ─▶ quick frame (of the simplified system) ─▶ pause in editing ─▶ full frame

A new edit drops the full frame of the scene before. A quick frame that was begun is shown first, then that of the
newest scene: else edits that come faster than quick frames, as in a drag, would show nothing. Where a full frame is
fast enough, quick frame and pause are skipped. The first picture can be computed on a thread while the window is built.

The simplified system has one sample for each modulator pixel and no padding, which takes a sixteenth of the work or
less: light of higher diffraction orders is aliased, and light that leaves the grid on one side re-enters on the other.
If that isn't fast enough it has three lasers only, with amplitudes that preserve the mean colour.

While one laser's amplitude is edited on a CPU, its light is added to the stored sum of the others' light, which differs
by rounding; after a pause in editing the sum is computed in its usual order, so that the picture at rest is always the
same.

`SideRenderers` has a renderer for each side of a comparison: now, target, snapshots, presets.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import SRGB_TO_XYZ, observer_weights
from holoview.light.engine.incremental import IncrementalRenderer, UpdateProgress
from holoview.light.gpu.device import Device
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.mailbox import Inputs, are_same
from holoview.util.packages import load_torch_libraries
from holoview.util.processes import lock_passed_on
from holoview.viewer.render.light_by_gap import LightByGap
from holoview.viewer.render.remembered_brightness import remember_gain, remembered_gain
from holoview.viewer.render.scene import DeviceImage, Scene, image_shape
from holoview.viewer.render.view_settings import NOW, TARGET, ComparisonSide, ViewSettings

QUICK_FRAME_ABOVE_S = 0.1
"""A full frame that takes longer than this is preceded by a quick one."""
QUICK_FRAME_BUDGET_S = 0.04
"""The time that a quick frame may take; it leaves out lasers to stay below."""
IDLE_BEFORE_FULL_S = 0.12
"""The time without an edit after which the full frame begins."""
SLICE_S = 0.012
"""The approximate duration of a slice, during which the device can't draw the window."""
_FIRST_SLICE_S = 0.1  # of the first quick frame, before which the window has nothing to show
_MIN_LASERS = 3
_FORESEEN_LASERS = 3  # whose parts of a full frame tell how bright it will be
_FIRST_POLL_S = 0.005  # between questions whether the thread has the first picture


def edit_to_scene(renderer: IncrementalRenderer | None, scene: Scene, device: Device) -> IncrementalRenderer:
    """The renderer, edited so that it will render a scene, or a new one. Raises UserError if it is impossible."""
    if renderer is None:
        return IncrementalRenderer(scene.system, scene.drive, device, plane_m=scene.plane_m)
    drive = None if scene.drive is renderer.drive else scene.drive
    renderer.edit(system=scene.system, drive=drive, plane_m=scene.plane_m)
    return renderer


def slices(
    renderer: IncrementalRenderer, slice_s: float = SLICE_S, *, may_reorder: bool = False
) -> Iterator[UpdateProgress]:
    """Renders what is stale, slice by slice. may_reorder: see `IncrementalRenderer.steps`."""
    return renderer.steps(with_srgb=False, wait=True, slice_s=slice_s, may_reorder=may_reorder)


class ProgressiveRenderer:
    """One image that follows a scene: call `request` after each change, and `compute_slice` while `is_busy`.

    picture: the newest image on the device, quick or full; None before the first. full_scene: the scene of the last
    full frame. quick_gain: the factors by which the X, Y and Z of quick frames are multiplied, whose light can't leave
    the image into higher diffraction orders. remembers: whether those of the first picture are kept for the next time.
    """

    def __init__(self, device: Device, *, remembers: bool = False) -> None:
        self._device, self._remembers = device, remembers
        self._full: IncrementalRenderer | None = None
        self._quick: IncrementalRenderer | None = None
        self._requested: Scene | None = None
        self._stage, self._follows_quick_frame = "done", False
        self._steps: Iterator[UpdateProgress] | None = None
        self._requested_at, self._version = 0.0, 0
        self._slice_s = SLICE_S  # of quick frames
        self._first: Future[None] | None = None  # while a thread computes the first picture
        self._next: Scene | None = None  # the scene that was requested meanwhile, or during a quick frame
        self.picture: DeviceImage | None = None
        self.full_scene: Scene | None = None
        self.quick_gain = (1.0, 1.0, 1.0)
        self._quick_scene: Scene | None = None
        self._gain_key: Inputs = ()  # what the gain was measured for
        self._is_gain_old = False  # whether it is measured before the next quick frame is shown
        self.light_by_gap = LightByGap()
        self._full_mean: NDArray[np.float64] | None = None  # X, Y, Z of the last full frame behind a quick one
        self._unit_means: NDArray[np.float64] | None = None  # of the last full frame, see `_follow_powers`
        self._downloads: dict[str, NDArray[np.float32]] = {}  # of the present picture

    @property
    def is_busy(self) -> bool:
        """Whether the full frame of the requested scene isn't there yet."""
        return self._stage != "done"

    @property
    def progress(self) -> float:
        """Share of the full frame that is computed: its renderer's progress."""
        if self._stage != "full":
            return float(self._stage in ("settle", "done"))
        return 0.0 if self._steps is None or self._full is None else self._full.progress

    @property
    def is_fresh(self) -> bool:
        """Whether the picture is the full frame of the requested scene."""
        return self._stage == "done" and self.picture is not None

    @property
    def follows(self) -> bool:
        """Whether the picture shows the last request, be it by its quick frame."""
        is_quick_shown = self._stage == "full" and self._follows_quick_frame
        return self._next is None and (self.is_fresh or is_quick_shown or self._stage == "settle")

    @property
    def _is_in_quick_frame(self) -> bool:
        return self._stage == "quick" and self._steps is not None

    @property
    def full_renderer(self) -> IncrementalRenderer | None:
        """The renderer of full frames; None before the first one."""
        return self._full

    @property
    def update_s(self) -> float:
        """The duration of the last full frame, from its first slice to its last."""
        return 0.0 if self._full is None else self._full.update_s

    @property
    def quick_s(self) -> float:
        """The duration of the last quick frame."""
        return 0.0 if self._quick is None else self._quick.update_s

    @property
    def wait_s(self) -> float:
        """The time until `compute_slice` can do something: after a quick frame, it waits for a pause in editing."""
        if self._first is not None:
            return 0.0 if self._first.done() else _FIRST_POLL_S
        return self._pause_s

    @property
    def _pause_s(self) -> float:
        """The rest of the pause after a quick frame or a sum in another order."""
        follows_another = self._follows_quick_frame if self._stage == "full" else self._stage == "settle"
        if self._steps is not None or not follows_another:
            return 0.0
        return max(self._requested_at + IDLE_BEFORE_FULL_S - time.perf_counter(), 0.0)

    def request(self, scene: Scene) -> None:
        """Requests the image of a scene; unfinished work on another scene is dropped, except for a quick frame."""
        if scene.is_same(self._requested if self._next is None else self._next):
            return
        if self._first is not None or self._is_in_quick_frame:
            self._next = scene
            return
        is_in_drag = self.is_busy and (self._stage == "quick" or self._follows_quick_frame)
        self._requested, self._requested_at = scene, time.perf_counter()
        self._steps = None
        self.light_by_gap.stop()
        self._stage, self._follows_quick_frame = "quick" if is_in_drag or self._is_slow(scene) else "full", False
        self._is_gain_old = not is_in_drag and not are_same(_gain_key(scene), self._gain_key)

    def start(self, scene: Scene | None, executor: Executor) -> None:
        """Has the first picture of a scene computed by an executor; `compute_slice` goes on from there."""
        if scene is None:
            return
        self.request(scene)
        self._first = executor.submit(self._compute_first)

    def compute_slice(self) -> bool:
        """Computes a slice and returns whether the picture has changed. Raises UserError for an impossible scene."""
        if self._first is not None:
            return self._take_first()
        try:
            return self._compute_slice()
        finally:
            if not self._is_in_quick_frame:
                self._take_next()

    def _compute_first(self) -> None:
        if self._requested is not None and self._requested.system.is_chain:
            load_torch_libraries()  # of which chains need tables, while the window's thread goes on
        self._slice_s = _FIRST_SLICE_S
        with lock_passed_on():  # the window's thread imports and builds the window meanwhile
            while self.picture is None and self._stage != "done":
                self._compute_slice()
        self._slice_s = SLICE_S

    def _take_first(self) -> bool:
        """Goes on from the thread's results, once they are there; raises its exception."""
        assert self._first is not None
        if not self._first.done():
            return False
        first, self._first = self._first, None
        self._take_next()
        first.result()
        return True

    def _take_next(self) -> None:
        """Goes on with the scene that was requested meanwhile."""
        scene, self._next = self._next, None
        if scene is not None:
            self.request(scene)

    def _compute_slice(self) -> bool:
        if self._stage == "done" or self._pause_s > 0:
            return False
        assert self._requested is not None
        try:
            if self._steps is None:
                self._steps = self._begin(self._requested)
            step = next(self._steps, None)
        except Exception:  # reported once and not tried again before the next edit
            self._stage, self._steps = "done", None
            raise
        if step is not None and step.done < step.total:
            return False
        self._finish()
        return True

    def xyz(self) -> NDArray[np.float32] | None:
        """The full image XYZ (y, x, 3) on the host; None until it is computed."""
        if not self.is_fresh or self._full is None or self.full_scene is None:
            return None
        if "xyz" not in self._downloads:
            self._downloads["xyz"] = self._full.xyz()
        return self._downloads["xyz"]

    def shown_xyz(self) -> NDArray[np.float32] | None:
        """The picture's XYZ (y, x, 3) on the host, be it quick; None until it shows the last request."""
        if self._stage == "settle" and self._full is not None:
            return self._full.xyz()
        if not self.follows or self.is_fresh or self._quick is None:
            return self.xyz()
        return self._quick.xyz() * np.array(self.quick_gain, np.float32)

    def poll_strategy(self) -> None:
        """Switches to a faster strategy of the transforms, if the search in the background has found one."""
        if self._full is not None:
            self._full.poll_strategy()

    def close(self) -> None:
        """Ends the renderers and their search for a faster strategy."""
        if self._first is not None:
            wait([self._first])
        self.light_by_gap.close()
        for renderer in (self._full, self._quick):
            if renderer is not None:
                renderer.close()

    def intensities(self) -> NDArray[np.float32] | None:
        """Intensities (laser, y, x) of the full image on the host; None until it is computed."""
        return self._of_lasers("intensities", lambda renderer, laser: renderer.intensity(laser))

    def luminances(self) -> NDArray[np.float32] | None:
        """Luminances (laser, y, x) of the full image on the host; None until it is computed."""
        return self._of_lasers("luminances", lambda renderer, laser: renderer.luminance(laser))

    def _of_lasers(
        self, name: str, read: Callable[[IncrementalRenderer, int], NDArray[np.float32]]
    ) -> NDArray[np.float32] | None:
        if not self.is_fresh or self._full is None:
            return None
        if name not in self._downloads:
            lasers = range(len(self._full.system.wavelengths_m))
            self._downloads[name] = np.stack([read(self._full, laser) for laser in lasers])
        return self._downloads[name]

    # --- stages -----------------------------------------------------------------------------------------------------

    def _is_slow(self, scene: Scene) -> bool:
        """Whether the full frame takes longer than QUICK_FRAME_ABOVE_S; before any measurement, on a CPU only.

        Asking prepares the full frame, which during a drag would take longer than a quick frame.
        """
        if self._full is not None and self._full.step_s is not None:
            try:
                self._full = edit_to_scene(self._full, scene, self._device)
            except UserError:
                return False
        if self._full is None or self._full.step_s is None:  # also where the bench has become a chain
            return self._device.info.is_cpu and make_quick_system(scene.system) != scene.system
        return (self._full.expected_s() or 0.0) > QUICK_FRAME_ABOVE_S

    def _begin(self, scene: Scene) -> Iterator[UpdateProgress]:
        if self._stage == "quick":
            try:
                quick_system = make_quick_system(scene.system, self._quick_laser_count(scene))
                self._quick = edit_to_scene(self._quick, replace(scene, system=quick_system), self._device)
                return slices(self._quick, self._slice_s)
            except UserError:  # the system can't be simplified
                self._stage = "full"
        self._full = edit_to_scene(self._full, scene, self._device)
        return slices(self._full, may_reorder=self._device.info.is_cpu and self._stage == "full")

    def _quick_laser_count(self, scene: Scene) -> int | None:
        """How many lasers fit into the time for a quick frame; None before any was measured."""
        if self._quick is None or self._quick.step_s is None:
            return None
        sources = len(scene.system.source.directions_rad)
        return max(int(QUICK_FRAME_BUDGET_S / (self._quick.step_s * sources)), _MIN_LASERS)

    def _finish(self) -> None:
        is_quick = self._stage == "quick"
        renderer = self._quick if is_quick else self._full
        assert renderer is not None and self._requested is not None
        self._version += 1
        self._downloads.clear()
        is_known = is_quick and self._follow_gap(renderer, self._requested)
        if is_quick and self.full_scene is not None and _differ_in_powers_alone(self.full_scene, self._requested):
            self._follow_powers(renderer, self._requested)
        elif is_quick and not is_known and self._is_gain_old and not self._requested.system.is_chain:
            gain = remembered_gain(self._requested) if self._remembers and self.full_scene is None else None
            if gain is None:
                self._foresee_brightness(renderer, self._requested)
            else:
                self._gain_key, self.quick_gain, self._is_gain_old = _gain_key(self._requested), gain, False
        gain = self.quick_gain if is_quick else (1.0, 1.0, 1.0)
        self.picture = DeviceImage(renderer.xyz_buffer, renderer.compositor.shape, is_quick, self._version, gain)
        self._steps = None
        if is_quick:
            self._stage, self._follows_quick_frame, self._quick_scene = "full", True, self._requested
            return
        self._stage = "settle" if renderer.pending_count(with_srgb=False) else "done"
        is_first = self.full_scene is None
        self._follows_quick_frame, self.full_scene, self._unit_means = False, self._requested, None
        self._full_mean = None
        self._compare_brightness(is_first)

    def _foresee_brightness(self, quick: IncrementalRenderer, scene: Scene) -> None:
        """Measures the gain of a quick frame before its full one is there, by three lasers at most.

        Their parts of the full frame are computed for that; the full frame goes on from there. The share of the light
        that leaves the image changes evenly with the wavelength: it is interpolated for the other lasers.
        """
        self._is_gain_old = False
        powers, quick_powers = scene.system.amplitudes.sum(axis=0), quick.system.amplitudes.sum(axis=0)
        wavelengths_m = scene.system.wavelengths_m
        lit = np.flatnonzero((powers > 0) & (quick_powers > 0))
        lit = lit[np.argsort(wavelengths_m[lit])]
        try:
            self._full = edit_to_scene(self._full, scene, self._device)
        except UserError:  # it is reported when the full frame is begun
            return
        shown = np.array([quick.intensity(int(laser)).mean() for laser in lit])
        if not len(lit) or not shown.all():
            return
        some = np.unique(np.linspace(0, len(lit) - 1, _FORESEEN_LASERS).round().astype(int))
        full = np.array([self._full.intensity(int(lit[one])).mean() for one in some])
        shares = full / powers[lit[some]] * quick_powers[lit[some]] / shown[some]
        xyz = shown[:, None] * observer_weights(scene.system.observer, wavelengths_m[lit])
        gains = np.interp(wavelengths_m[lit], wavelengths_m[lit[some]], shares) @ xyz / xyz.sum(axis=0)
        x, y, z = gains.tolist()
        self._gain_key, self.quick_gain = _gain_key(scene), (x, y, z)

    def _follow_gap(self, quick: IncrementalRenderer, scene: Scene) -> bool:
        """Finds the gain of a quick frame whose gap alone is another than in the last full frame, if a table tells."""
        if self.full_scene is None or self._full_mean is None:
            return False
        ratio = self.light_by_gap.ratio(self.full_scene, scene)
        if ratio is None:
            return False
        shown = quick.xyz().mean(axis=(0, 1), dtype=np.float64)
        if not shown.all():
            return False
        x, y, z = (self._full_mean * ratio / shown).tolist()
        self._gain_key, self.quick_gain, self._is_gain_old = _gain_key(scene), (x, y, z), False
        return True

    def _follow_powers(self, quick: IncrementalRenderer, scene: Scene) -> None:
        """Finds the gain of a quick frame whose lasers' powers alone are others than in the last full frame.

        The mean light of each laser at unit power is known from there; that of lasers that were off is interpolated.
        """
        assert self._full is not None
        system, shown = scene.system, quick.xyz().mean(axis=(0, 1), dtype=np.float64)
        if self._unit_means is None:
            powers = self._full.system.amplitudes.sum(axis=0)
            lit = np.flatnonzero(powers > 0)
            lit = lit[np.argsort(system.wavelengths_m[lit])]
            found = [self._full.intensity(int(laser)).mean(dtype=np.float64) / powers[laser] for laser in lit]
            self._unit_means = np.interp(system.wavelengths_m, system.wavelengths_m[lit], found)
        light = system.amplitudes.sum(axis=0) * self._unit_means
        if shown.all():
            x, y, z = (light @ observer_weights(system.observer, system.wavelengths_m) / shown).tolist()
            self._gain_key, self.quick_gain = _gain_key(scene), (x, y, z)

    def _compare_brightness(self, is_first: bool) -> None:
        """Measures the ratios of the mean X, Y and Z of a full frame, perhaps the first, and of the quick one before
        it."""
        assert self._requested is not None
        if self._quick_scene is not self._requested or self._quick is None:
            return
        full, quick = self.xyz(), self._quick.xyz()
        if full is not None and quick.any(axis=(0, 1)).all():
            self._full_mean = full.mean(axis=(0, 1), dtype=np.float64)
            x, y, z = self._full_mean / quick.mean(axis=(0, 1), dtype=np.float64)
            self._gain_key, self.quick_gain = _gain_key(self._requested), (float(x), float(y), float(z))
            self.light_by_gap.prepare(self._requested)
            if is_first and self._remembers and not self._requested.system.is_chain:
                remember_gain(self._requested, self.quick_gain)


def _gain_key(scene: Scene) -> Inputs:
    """What the share of the light that leaves the image depends on most."""
    system = scene.system
    return scene.drive, system.modulators, system.sampling, system.gap_m, system.eye


def _differ_in_powers_alone(one: Scene, other: Scene) -> bool:
    """Whether two scenes differ in the powers of the lasers alone: in neither patterns, bench nor plane."""
    if one.drive is not other.drive or one.plane_m != other.plane_m or one.system == other.system:
        return False
    amplitudes = other.system.amplitudes
    return amplitudes.shape == one.system.amplitudes.shape and one.system.with_(amplitudes=amplitudes) == other.system


# --- the simplified system ---


def make_quick_system(system: System, most_lasers: int | None = None) -> System:
    """The simplified system; if more than `most_lasers` (frame, laser) pairs are lit, it lights only three.

    A field keeps its padding: its planes are often so far away that light would re-enter many times. A chain keeps its
    samples, which its pitches need, and with a Fourier plane its padding.
    """
    amplitudes = system.amplitudes if most_lasers is None else reduced_amplitudes(system, most_lasers)
    sampling: dict[str, Any] = {} if system.is_field or system.way.kernels else {"propagation": "periodic"}
    sampling |= {} if system.is_field or system.is_chain else {"upsample": 1}
    return system.edit({**sampling, "amplitudes": amplitudes})


def reduced_amplitudes(system: System, most: int) -> NDArray[np.float64]:
    """Amplitudes (frame, wavelength) with three positive entries, if there are more than `most`.

    The three that span the largest gamut are chosen one by one, and their amplitudes by non-negative least squares so
    that the XYZ of a uniform image is preserved: exactly if its colour lies in their gamut.
    """
    lit = np.argwhere(system.amplitudes > 0)
    if len(lit) <= most:
        return system.amplitudes
    weights = observer_weights(system.observer, system.wavelengths_m)
    chosen = lit[_primaries(weights[lit[:, 1]])]
    total_xyz = (system.amplitudes @ weights).sum(axis=0)
    power = _nonnegative_powers(weights[chosen[:, 1]], total_xyz)
    amplitudes = np.zeros_like(system.amplitudes)
    amplitudes[chosen[:, 0], chosen[:, 1]] = power
    return amplitudes if np.any(power > 0) else system.amplitudes


def _primaries(weights: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices of three rows of `weights` (XYZ at unit power), each the farthest from the span of those before it.

    They are the first pivots of a QR decomposition with column pivoting.
    """
    chosen: list[int] = []
    left = weights.astype(np.float64)
    for _ in range(weights.shape[1]):
        lengths = np.linalg.norm(left, axis=1)
        lengths[chosen] = -1.0
        chosen.append(int(np.argmax(lengths)))
        direction = left[chosen[-1]] / max(lengths[chosen[-1]], np.finfo(np.float64).tiny)
        left = left - np.outer(left @ direction, direction)
    return np.array(chosen, dtype=np.intp)


def _nonnegative_powers(xyz: NDArray[np.float64], total_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """The powers p ≥ 0 (laser,) of few lasers for which p·xyz (laser, 3) is the nearest to `total_xyz` (3,).

    Some subset of the lasers is lit, by plain least squares: all subsets are tried.
    """
    best, distance = np.zeros(len(xyz)), float(np.linalg.norm(total_xyz))
    for count in range(1, len(xyz) + 1):
        for subset in combinations(range(len(xyz)), count):
            power = np.zeros(len(xyz))
            power[list(subset)] = np.linalg.lstsq(xyz[list(subset)].T, total_xyz, rcond=None)[0]
            missed = float(np.linalg.norm(total_xyz - power @ xyz))
            if power.min() >= 0 and missed < distance:
                best, distance = power, missed
    return best


# --- the sides of a comparison ----------------------------------------------------------------------------------------


_MAX_OTHERS = 2  # renderers besides that of "now", as each takes memory of the device


@dataclass(frozen=True, eq=False)
class _ShownTarget:
    """A target on the device: the image (y, x, 3) that it shows, and of which specification."""

    spec: object
    image: NDArray[np.float32]
    shown: DeviceImage


class ComparedScenes(Protocol):
    """The scenes of the sides of a comparison at present, which the editing session tells."""

    @property
    def view_settings(self) -> ViewSettings:
        """Which sides are shown, and how."""

    @property
    def system(self) -> System:
        """The system of the side "now"."""

    @property
    def target_spec(self) -> object:
        """The specification of the target; None without a target."""

    def scene_for(self, side: ComparisonSide) -> Scene | None:
        """The scene of a side; None for a side that isn't rendered."""

    def target_at(self) -> NDArray[np.float32] | None:
        """The target (y, x, 3) in linear sRGB at the displayed plane; None until it is built."""


class PicturesOfSides(Protocol):
    """Full pictures of sides that were computed before."""

    def picture(self, side: ComparisonSide, scene: Scene | None) -> DeviceImage | None:
        """The picture of a side on the device; None unless it shows this scene."""

    def xyz(self, side: ComparisonSide, scene: Scene | None) -> NDArray[np.float32] | None:
        """The same on the host, XYZ (y, x, 3)."""


class SideRenderers:
    """One renderer for each side: call `request` after each change of the scenes, `compute_slice` while `is_busy`.

    now: the renderer of "now", if it has been started already. kept: pictures of sides that are there already.
    """

    def __init__(
        self,
        device: Device,
        scenes: ComparedScenes,
        now: ProgressiveRenderer | None = None,
        kept: PicturesOfSides | None = None,
    ) -> None:
        self._device, self._scenes = device, scenes
        self.now = ProgressiveRenderer(device) if now is None else now
        self._others: dict[ComparisonSide, ProgressiveRenderer] = {}
        self.kept = kept
        self._target: _ShownTarget | None = None

    def visible_sides(self) -> tuple[ComparisonSide, ...]:
        """The sides that the view settings show, and "now", which is always kept up to date."""
        view = self._scenes.view_settings
        shown = (view.shown,) if view.compare == "off" else (view.a, view.b)
        return tuple(dict.fromkeys((NOW, *shown)))

    def request(self) -> None:
        """Requests the images of the visible sides. Raises UserError for an impossible scene."""
        for side in self.visible_sides():
            if side == TARGET:
                continue
            scene = self._scenes.scene_for(side)
            if scene is not None and (self.kept is None or self.kept.picture(side, scene) is None):
                self._renderer_for(side).request(scene)

    def leave_processor(self, to_jobs: bool) -> None:
        """Holds back what is computed beside the images while jobs run."""
        for renderer in (self.now, *self._others.values()):
            renderer.light_by_gap.is_held = to_jobs

    def compute_slice(self) -> bool:
        """Computes a slice of the first side that isn't up to date; returns whether a picture has changed."""
        for side in self.visible_sides():
            renderer = self.renderer(side)
            if renderer is not None and renderer.is_busy and renderer.wait_s == 0:
                return renderer.compute_slice()
        return False

    @property
    def is_busy(self) -> bool:
        """Whether an image isn't up to date, even if its full frame still waits for a pause in editing."""
        return any(renderer.is_busy for side in self.visible_sides() if (renderer := self.renderer(side)) is not None)

    @property
    def wait_s(self) -> float:
        """The time until `compute_slice` can do something, while `is_busy`."""
        waits = [
            renderer.wait_s
            for side in self.visible_sides()
            if (renderer := self.renderer(side)) is not None and renderer.is_busy
        ]
        return min(waits, default=0.0)

    def renderer(self, side: ComparisonSide) -> ProgressiveRenderer | None:
        """The renderer of a side; None if it isn't rendered."""
        return self.now if side == NOW else self._others.get(side)

    def picture(self, side: ComparisonSide) -> DeviceImage | None:
        """The newest image of a side on the device; None before the first."""
        if side == TARGET:
            return self._target_picture()
        kept = None if self.kept is None or side == NOW else self.kept.picture(side, self._scene_of(side))
        if kept is not None:
            return kept
        renderer = self.renderer(side)
        return None if renderer is None else renderer.picture

    def xyz(self, side: ComparisonSide) -> NDArray[np.floating] | None:
        """The full image XYZ (y, x, 3) of a side on the host; None until it is computed."""
        if side == TARGET:
            target = self._scenes.target_at()
            return None if target is None else target @ SRGB_TO_XYZ.T
        kept = None if self.kept is None or side == NOW else self.kept.xyz(side, self._scene_of(side))
        if kept is not None:
            return kept
        renderer = self.renderer(side)
        return None if renderer is None else renderer.xyz()

    def close(self) -> None:
        """Ends all renderers."""
        for renderer in (self.now, *self._others.values()):
            renderer.close()

    def _scene_of(self, side: ComparisonSide) -> Scene | None:
        """The scene of a side; None too while nothing can be displayed, as without light."""
        with suppress(UserError):
            return self._scenes.scene_for(side)
        return None

    def _renderer_for(self, side: ComparisonSide) -> ProgressiveRenderer:
        if side == NOW:
            return self.now
        if side not in self._others:
            while len(self._others) >= _MAX_OTHERS:
                self._others.pop(next(iter(self._others))).light_by_gap.stop()
            self._others[side] = ProgressiveRenderer(self._device)
        self._others[side] = self._others.pop(side)
        return self._others[side]

    def _target_picture(self) -> DeviceImage | None:
        """The newest target that is built; an eye, which the target follows, has to rest before a new one is built."""
        scenes, old = self._scenes, self._target
        if old is not None and (old.spec, old.shown.shape) != (scenes.target_spec, image_shape(scenes.system)):
            old = self._target = None
        is_moving = scenes.system.eye is not None and not self.now.is_fresh
        image = None if is_moving and old is not None else scenes.target_at()
        is_new = image is not None and (old is None or old.image is not image)
        if is_new and image is not None and scenes.target_spec is not None:
            xyz = np.zeros((*image.shape[:2], 4), np.float32)
            xyz[..., :3] = image @ SRGB_TO_XYZ.T
            shown = DeviceImage(self._device.upload(xyz, "target"), (image.shape[0], image.shape[1]))
            self._target = _ShownTarget(scenes.target_spec, image, shown)
        return None if self._target is None else self._target.shown
