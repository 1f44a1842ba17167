"""Small images of all focal planes of the bench, computed once the image itself is there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from holoview.app.progressive_renderer import TimedRenderer
from holoview.app.viewport import DeviceImage
from holoview.engine.incremental import UpdateProgress
from holoview.gpu.device import Device
from holoview.gpu.recorder import CommandRecorder
from holoview.model.system import System
from holoview.session.document import Drive
from holoview.session.editing_session import EditingSession
from holoview.session.quick_system import make_quick_system
from holoview.session.scene import Scene
from holoview.util.errors import UserError

_MOST_PLANES = 24


class PlanePreviews:
    """A picture a plane, of the cheaper bench; those that are stale stay until their successor is there."""

    def __init__(self, device: Device, session: EditingSession) -> None:
        self._device, self._session = device, session
        self._engine = TimedRenderer(device)
        self._requested: tuple[System, Drive] | None = None
        self._stale: list[float] = []
        self._steps: Iterator[UpdateProgress] | None = None
        self.pictures: dict[float, DeviceImage] = {}
        self._version = 0

    @property
    def planes_m(self) -> list[float]:
        """The planes of the bench, nearest first; of very many, evenly chosen ones."""
        planes = np.unique(self._session.system.planes_m)
        chosen = np.unique(np.linspace(0, len(planes) - 1, min(len(planes), _MOST_PLANES)).round().astype(int))
        return [float(planes[i]) for i in chosen]

    @property
    def is_busy(self) -> bool:
        """Whether there is something to compute."""
        return bool(self._stale)

    def request(self) -> None:
        """Follows the session."""
        shown = self._session.displayed_document
        is_same = (
            self._requested is not None and shown.drive is self._requested[1] and shown.system == self._requested[0]
        )
        if not is_same:
            self._requested, self._steps = (shown.system, shown.drive), None
            here = self._session.view_settings.plane_m
            self._stale = sorted(self.planes_m, key=lambda z: abs(z - here))
            self.pictures = {z: picture for z, picture in self.pictures.items() if z in self._stale}

    def compute_slice(self) -> bool:
        """Computes a slice; whether a picture has changed."""
        if not self._stale or self._requested is None:
            return False
        plane_m = self._stale[0]
        try:
            if self._steps is None:
                system, drive = self._requested
                self._steps = self._engine.start(Scene(make_quick_system(system), drive, plane_m))
            if next(self._steps, None) is not None:
                return False
        except UserError:  # a bench that has no cheaper version has no small images either
            self._stale, self._steps = [], None
            return False
        self._keep(plane_m)
        self._stale, self._steps = self._stale[1:], None
        return True

    def _keep(self, plane_m: float) -> None:
        session = self._engine.renderer
        assert session is not None
        known = self.pictures.get(plane_m)
        fits = known is not None and known.shape == session.compositor.shape
        buffer = (
            known.buffer
            if known is not None and fits
            else session.compositor.xyz_buffer(f"plane {plane_m * 1e3:.4g} mm")
        )
        recorder = CommandRecorder(self._device, "plane")
        recorder.copy(session.xyz_buffer, buffer)
        recorder.submit()
        self._version += 1
        self.pictures[plane_m] = DeviceImage(buffer, session.compositor.shape, is_quick=True, version=self._version)
