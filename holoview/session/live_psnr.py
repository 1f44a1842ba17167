"""PSNR of the displayed image to its target, kept up to date on a worker thread while the image changes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from holoview.colour import xyz_to_linear_srgb
from holoview.metrics.psnr import psnr_linear_srgb
from holoview.session.editing_session import EditingSession
from holoview.session.latest_task import LatestTask

Image = NDArray[np.floating]


class LivePsnr:
    """Measures the newest image in the background.

    on_change: called on the owner's thread when there is a new result.
    """

    def __init__(self, session: EditingSession, on_change: Callable[[], None] = lambda: None) -> None:
        self._on_change = on_change
        self._requested: tuple[Image, Image] | None = None
        self._result: tuple[Image, Image, float] | None = None
        self._task: LatestTask[float] = LatestTask("psnr", session.call_on_owner, session.messages.post_error)

    @property
    def is_busy(self) -> bool:
        """Whether a newer image is being measured."""
        return self._task.is_busy

    def get(self, xyz: Image, target: Image) -> float | None:
        """PSNR (dB) of an image XYZ (y, x, 3) to a target (y, x, 3) in linear sRGB; None until it is measured.

        The arrays must not be changed afterwards. Images of another shape than the target have no PSNR.
        """
        if xyz.shape != target.shape:
            return None
        if self._result is not None and self._result[0] is xyz and self._result[1] is target:
            return self._result[2]
        if self._requested is None or self._requested[0] is not xyz or self._requested[1] is not target:
            self._requested = (xyz, target)
            self._task.submit(partial(image_psnr_db, xyz, target), partial(self._on_result, xyz, target))
        return None

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _on_result(self, xyz: Image, target: Image, psnr_db: float) -> None:
        self._result = (xyz, target, psnr_db)
        self._on_change()


def image_psnr_db(xyz: Image, target: Image) -> float:
    """PSNR (dB) of an image XYZ (y, x, 3) to a target (y, x, 3) in linear sRGB, both clipped to what a screen shows.

    Raises UserError when the shapes differ.
    """
    return psnr_linear_srgb(xyz_to_linear_srgb(xyz), target).mean_db
