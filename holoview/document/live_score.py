"""A score of the displayed image beside its target, kept up to date on a worker thread while the image changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from holoview.colour import xyz_to_linear_srgb
from holoview.document.editing_session import EditingSession
from holoview.metrics.psnr import psnr_linear_srgb
from holoview.util.latest_task import LatestTask

Image = NDArray[np.floating]
Measure = Callable[[Image, Image], float]
"""An image in XYZ (y, x, 3) and its target in linear sRGB to a score."""


_Request = tuple[Image, Image, Measure]


class LiveScore:
    """Measures the newest image in the background.

    name: of the thread. on_change: called on the owner's thread when there is a new result, or none can be had.
    """

    def __init__(self, name: str, session: EditingSession, on_change: Callable[[], None] = lambda: None) -> None:
        self._on_change, self._post_error = on_change, session.messages.post_error
        self._requested: _Request | None = None
        self._result: float | None = None
        self._failed: Measure | None = None
        self._task: LatestTask[float] = LatestTask(name, session.call_on_owner, self._on_error)

    @property
    def is_busy(self) -> bool:
        """Whether the newest image has no result yet."""
        return self._requested is not None and self._result is None and self._failed is None

    def get(self, xyz: Image, target: Image, measure: Measure) -> float | None:
        """The score of an image XYZ (y, x, 3) to a target (y, x, 3) in linear sRGB; None until it is measured.

        The arrays must not be changed afterwards. An error is posted once: the same measure isn't called again before
        another one was. Images of another shape than the target have no score.
        """
        if xyz.shape != target.shape or measure == self._failed:
            return None
        if self._requested is None or not _is_same(self._requested, (xyz, target, measure)):
            self._requested, self._result, self._failed = (xyz, target, measure), None, None
            self._task.submit(partial(measure, xyz, target), partial(self._on_result, self._requested))
        return self._result

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _on_result(self, request: _Request, score: float) -> None:
        if request is self._requested:
            self._result, self._failed = score, None
            self._on_change()

    def _on_error(self, error: BaseException) -> None:
        self._failed = None if self._requested is None else self._requested[2]
        self._post_error(error)
        self._on_change()


def _is_same(one: _Request, other: _Request) -> bool:
    """Whether two requests are of the same arrays and of equal measures."""
    return one[0] is other[0] and one[1] is other[1] and one[2] == other[2]


def image_psnr_db(xyz: Image, target: Image) -> float:
    """PSNR (dB) of an image XYZ (y, x, 3) to a target (y, x, 3) in linear sRGB, both clipped to what a screen shows.

    Raises UserError when the shapes differ.
    """
    return psnr_linear_srgb(xyz_to_linear_srgb(xyz), target).mean_db


@dataclass(frozen=True)
class ImageScore:
    """A perceptual score of an image XYZ (y, x, 3) to a target (y, x, 3) in linear sRGB.

    name: of the score. samples_per_degree: of visual angle. Called, it raises UserError when the score isn't installed.
    """

    name: str
    samples_per_degree: float

    def __call__(self, xyz: Image, target: Image) -> float:
        from holoview.metrics.perceptual import measure_score  # loads torch

        return measure_score(self.name, xyz_to_linear_srgb(xyz), target, self.samples_per_degree).mean
