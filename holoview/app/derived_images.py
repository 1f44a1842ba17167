"""The images of the pages "phase" and "spectrum" on the device, computed when they are displayed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.app.viewport import DeviceImage
from holoview.document.derived_images import eyebox_xyz, phase_turns
from holoview.document.document import Drive
from holoview.document.editing_session import EditingSession
from holoview.document.latest_task import LatestTask
from holoview.gpu.device import Device
from holoview.model.system import System

Xyz = NDArray[np.float32]


class DerivedImages:
    """Images of derived pages. They are computed on a thread; the image before stays until the new one is ready."""

    def __init__(self, device: Device, session: EditingSession) -> None:
        self._device, self._session = device, session
        self._pictures: dict[str, tuple[Any, DeviceImage]] = {}
        self._requested: tuple[str, Any] | None = None
        self._task: LatestTask[Xyz] = LatestTask("derived image", session.call_on_owner, session.messages.post_error)

    @property
    def is_busy(self) -> bool:
        """Whether an image is being computed."""
        return self._task.is_busy

    def picture(self) -> DeviceImage | None:
        """The image of the displayed page; None until it is computed."""
        document, view = self._session.displayed_document, self._session.view_settings
        if view.page == "phase":
            self._request("phase", (document.system, document.drive, view.frame, view.modulator), _phase_xyz)
        if view.page == "spectrum":
            system = document.system.with_(eye=None)  # the eyebox doesn't depend on where the pupil is
            self._request("spectrum", (system, document.drive, document.system.eye is not None), eyebox_xyz)
        entry = self._pictures.get(view.page)
        return None if entry is None else entry[1]

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _request(self, page: str, key: tuple[Any, ...], compute: Callable[..., Xyz]) -> None:
        """Has the image of a page computed from `key`, unless it is there or was the last to be requested."""
        known = (self._requested, (page, self._pictures[page][0]) if page in self._pictures else None)
        if any(entry is not None and entry[0] == page and _is_same(entry[1], key) for entry in known):
            return
        self._requested = (page, key)
        self._task.submit(partial(compute, *key), partial(self._put, page, key))

    def _put(self, page: str, key: Any, xyz: Xyz) -> None:
        four = np.zeros((*xyz.shape[:2], 4), np.float32)
        four[..., :3] = xyz
        self._pictures[page] = (key, DeviceImage(self._device.upload(four, page), (xyz.shape[0], xyz.shape[1])))


def _phase_xyz(system: System, drive: Drive, frame: int, modulator: int) -> Xyz:
    """The phase of a pattern in turns (y, x, 3), thrice, as the shader of images reads it."""
    return np.repeat(phase_turns(system, drive, frame, modulator)[..., None], 3, axis=2)


def _is_same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether (system, drive, …) are equal; patterns are compared by identity, which is what edits share."""
    return one[1] is other[1] and one[0] == other[0] and one[2:] == other[2:]
