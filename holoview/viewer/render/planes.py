"""Images of focal planes and along a pupil's path, for exports and comparisons; previews of planes in the window."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.pictures import write_png
from holoview.holograms.view import simulate
from holoview.light.colour import to_srgb8, xyz_to_linear_srgb
from holoview.light.engine.incremental import IncrementalRenderer, UpdateProgress
from holoview.light.gpu.device import Device, open_device
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.model import preset
from holoview.light.model.focus import plane_label
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback
from holoview.viewer.render.progressive_renderer import edit_to_scene, make_quick_system, slices
from holoview.viewer.render.scene import DeviceImage, Drive, Scene

Xyz = NDArray[np.floating]
SeenView = tuple[System, float]
"""A system, and the plane (m) on which its eye is focused."""


def render_planes(
    system: System, drive: Drive, planes_m: Sequence[float], check: Callable[[], None] = lambda: None
) -> Iterator[Xyz]:
    """Renders XYZ (y, x, 3) at each plane in turn; see `render_each`."""
    return render_each([(system, float(plane_m)) for plane_m in planes_m], drive, check)


def render_each(
    views: Sequence[SeenView],
    drive: Drive,
    check: Callable[[], None] = lambda: None,
    backend: str = "auto",
    adapter: str | None = None,
) -> Iterator[Xyz]:
    """Renders XYZ (y, x, 3) of patterns on each (system, plane in m) in turn; the systems show patterns of one shape.

    backend, adapter: as `simulate` takes them. With WebGPU, the views share common results. `check` is called
    between steps and may raise an exception to cancel. Raises UserError as `simulate` does.
    """
    renderer = None if backend.startswith("torch") else _open_renderer(views[0], drive, backend, adapter)
    if renderer is None:
        for system, plane_m in views:
            check()
            yield simulate(system, drive, [plane_m], "torch" if backend == "auto" else backend).xyz[0]
        return
    for system, plane_m in views:
        renderer.edit(system=system, plane_m=plane_m)
        for _ in renderer.steps(with_srgb=False, wait=True):
            check()
        yield renderer.xyz()


def _open_renderer(view: SeenView, drive: Drive, backend: str, adapter: str | None) -> IncrementalRenderer | None:
    """A renderer of a view; None for the backend "auto" where no adapter can show it."""
    try:
        return IncrementalRenderer(view[0], drive, open_device(adapter), plane_m=view[1])
    except UserError:
        if backend != "auto" or adapter is not None:
            raise
        return None


# --- pictures along the path of a pupil -------------------------------------------------------------------------------


def exposed_pictures(
    views: Sequence[SeenView],
    drive: Drive,
    stops: float,
    progress: ProgressCallback,
    *,
    backend: str,
    adapter: str | None,
) -> Iterator[NDArray[np.uint8]]:
    """Each view, exposed by `stops`, as 8-bit sRGB (y, x, 3). Raises UserError as `render_each` does."""
    rendered = render_each(views, drive, backend=backend, adapter=adapter)
    for number, xyz in enumerate(rendered, start=1):
        yield to_srgb8(xyz_to_linear_srgb(xyz * 2.0**stops))
        progress(number, len(views), "pictures")


def write_pictures(
    pictures: Iterable[NDArray[np.uint8]], folder: Path, views: Sequence[SeenView], texts: Mapping[str, str]
) -> list[str]:
    """Writes the picture of each view as FOLDER/0000.png …, with its plane and its system; returns the files."""
    files = []
    for i, (pixels, (system, plane_m)) in enumerate(zip(pictures, views, strict=True)):
        files.append(str(folder / f"{i:04}.png"))
        own = {"holoview.plane": plane_label(system, plane_m, digits=7), "holoview.system": preset.dumps(system)}
        write_png(files[-1], pixels, {**texts, **own})
    return files


def describe_view(time_s: float, system: System, plane_m: float) -> dict[str, Any]:
    """Time, pupil and plane of a view, for programs."""
    assert system.eye is not None
    pupil_mm = system.eye.pupil_diameter_m(system.field_m) * 1e3
    place = {"y_mm": system.eye.pupil_y_m * 1e3, "x_mm": system.eye.pupil_x_m * 1e3, "pupil_mm": pupil_mm}
    return {"time_s": time_s, **place, "plane": plane_label(system, plane_m, digits=7)}


# --- previews ---


_MAX_PLANES = 24


def previewed_planes(system: System) -> list[float]:
    """The planes of a system that have previews, by rising distance: at most 24 of them, evenly chosen."""
    planes = np.unique(system.planes_m)
    chosen = np.unique(np.linspace(0, len(planes) - 1, min(len(planes), _MAX_PLANES)).round().astype(int))
    return [float(planes[i]) for i in chosen]


class PlanePreviews:
    """One picture of the simplified system for each plane; outdated pictures stay until they are replaced."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._renderer: IncrementalRenderer | None = None
        self._requested: tuple[System, Drive] | None = None
        self._stale: list[float] = []
        self._steps: Iterator[UpdateProgress] | None = None
        self.pictures: dict[float, DeviceImage] = {}
        self._version = 0

    @property
    def is_busy(self) -> bool:
        """Whether a picture is outdated."""
        return bool(self._stale)

    def request(self, scene: Scene) -> None:
        """Requests pictures of all planes of a scene, starting with planes near the displayed one."""
        system, drive = self._requested or (None, None)
        if scene.drive is not drive or scene.system != system:
            self._requested, self._steps = (scene.system, scene.drive), None
            self._stale = sorted(previewed_planes(scene.system), key=lambda z: abs(z - scene.plane_m))
            self.pictures = {z: picture for z, picture in self.pictures.items() if z in self._stale}

    def compute_slice(self) -> bool:
        """Computes a slice and returns whether a picture has changed."""
        if not self._stale or self._requested is None:
            return False
        plane_m = self._stale[0]
        try:
            if self._steps is None:
                system, drive = self._requested
                scene = Scene(make_quick_system(system), drive, plane_m)
                self._renderer = edit_to_scene(self._renderer, scene, self._device)
                self._steps = slices(self._renderer)
            if next(self._steps, None) is not None:
                return False
        except UserError:  # the system can't be simplified: there are no previews
            self._stale, self._steps = [], None
            return False
        self._store_picture(plane_m)
        self._stale, self._steps = self._stale[1:], None
        return True

    def _store_picture(self, plane_m: float) -> None:
        """Copies the renderer's image to a buffer of its own."""
        renderer = self._renderer
        assert renderer is not None
        previous = self.pictures.get(plane_m)
        fits = previous is not None and previous.shape == renderer.compositor.shape
        buffer = (
            previous.buffer
            if previous is not None and fits
            else renderer.compositor.xyz_buffer(f"plane {plane_m * 1e3:.4g} mm")
        )
        recorder = CommandRecorder(self._device, "plane")
        recorder.copy(renderer.xyz_buffer, buffer)
        recorder.submit()
        self._version += 1
        self.pictures[plane_m] = DeviceImage(buffer, renderer.compositor.shape, is_quick=True, version=self._version)
