"""The images of the pages "phase" and "spectrum" on the device, computed when they are displayed."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.app.viewport import DeviceImage
from holoview.gpu.device import Device
from holoview.session.derived_images import eyebox_xyz, phase_turns
from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.latest_task import LatestTask


class DerivedImages:
    """Images of derived pages. The spectrum is computed on a thread; the image before stays until it is ready."""

    def __init__(self, device: Device, session: EditingSession) -> None:
        self._device, self._session = device, session
        self._pictures: dict[str, tuple[Any, DeviceImage]] = {}
        self._requested_key: Any = None
        self._task: LatestTask[NDArray[np.float32]] = LatestTask(
            "spectrum", session.call_on_owner, session.messages.post_error
        )

    @property
    def is_busy(self) -> bool:
        """Whether an image is being computed."""
        return self._task.is_busy

    def picture(self) -> DeviceImage | None:
        """The image of the displayed page; None until it is computed."""
        document, view = self._session.displayed_document, self._session.view_settings
        if view.page == "phase":
            key = (document.system, document.drive, view.frame, view.modulator)
            if self._current("phase", key) is None:
                turns = phase_turns(*key)
                self._put("phase", key, np.repeat(turns[..., None], 3, axis=2))
        if view.page == "spectrum":
            self._request_spectrum(document)
        entry = self._pictures.get(view.page)
        return None if entry is None else entry[1]

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _request_spectrum(self, document: Document) -> None:
        key = (document.system, document.drive)
        if self._requested_key is None or not _is_same(self._requested_key, key):
            self._requested_key = key
            self._task.submit(partial(eyebox_xyz, *key), partial(self._put, "spectrum", key))

    def _current(self, page: str, key: Any) -> DeviceImage | None:
        entry = self._pictures.get(page)
        return entry[1] if entry is not None and _is_same(entry[0], key) else None

    def _put(self, page: str, key: Any, xyz: NDArray[np.float32]) -> None:
        four = np.zeros((*xyz.shape[:2], 4), np.float32)
        four[..., :3] = xyz
        self._pictures[page] = (key, DeviceImage(self._device.upload(four, page), (xyz.shape[0], xyz.shape[1])))


def _is_same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether (system, drive, …) are equal; patterns are compared by identity, which is what edits share."""
    return one[1] is other[1] and one[0] == other[0] and one[2:] == other[2:]
