"""The pictures of the pages "phase" and "spectrum", made when they are looked at."""

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
    """Pictures of pages other than the image. What takes long is made on a thread; the last one stays until then."""

    def __init__(self, device: Device, session: EditingSession) -> None:
        self._device, self._session = device, session
        self._pictures: dict[str, tuple[Any, DeviceImage]] = {}
        self._asked: Any = None
        self._newest: LatestTask[NDArray[np.float32]] = LatestTask(
            "spectrum", session.call_on_owner, session.messages.post_error
        )

    @property
    def is_busy(self) -> bool:
        """Whether a picture is on its way."""
        return self._newest.is_busy

    def picture(self) -> DeviceImage | None:
        """The picture of the look's page; None where there is none yet."""
        shown, look = self._session.displayed_document, self._session.view_settings
        if look.page == "phase":
            key = (shown.system, shown.drive, look.frame, look.modulator)
            if self._known("phase", key) is None:
                turns = phase_turns(*key)
                self._put("phase", key, np.repeat(turns[..., None], 3, axis=2))
        if look.page == "spectrum":
            self._ask(shown)
        found = self._pictures.get(look.page)
        return None if found is None else found[1]

    def close(self) -> None:
        """Ends the thread."""
        self._newest.close()

    def _ask(self, shown: Document) -> None:
        key = (shown.system, shown.drive)
        if self._asked is None or not _is_same(self._asked, key):
            self._asked = key
            self._newest.submit(partial(eyebox_xyz, *key), partial(self._put, "spectrum", key))

    def _known(self, page: str, key: Any) -> DeviceImage | None:
        found = self._pictures.get(page)
        return found[1] if found is not None and _is_same(found[0], key) else None

    def _put(self, page: str, key: Any, xyz: NDArray[np.float32]) -> None:
        four = np.zeros((*xyz.shape[:2], 4), np.float32)
        four[..., :3] = xyz
        self._pictures[page] = (key, DeviceImage(self._device.upload(four, page), (xyz.shape[0], xyz.shape[1])))


def _is_same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether (system, drive, …) are equal; patterns are compared by identity, which is what edits share."""
    return one[1] is other[1] and one[0] == other[0] and one[2:] == other[2:]
