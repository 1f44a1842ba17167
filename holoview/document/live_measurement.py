"""Measurements of the displayed image, kept up to date on a worker thread while the image changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.measure import (
    ContrastCurve,
    LineProfile,
    RegionMetrics,
    contrast_by_wavelength,
    line_profile,
    luminance_of,
    measure_region,
)
from holoview.metrics.speckle import (
    RetinalContrast,
    SpeckleHistogram,
    independent_pattern_count,
    retinal_contrast,
    speckle_histogram,
)
from holoview.util.errors import UserError
from holoview.util.latest_task import LatestTask

Image = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class ImageMeasurements:
    """Measurements of an image; each is None where it wasn't requested or isn't possible.

    document: what the image shows. region, histogram: of the measured region. profile: luminance along the line of the
    view settings. curve: contrast by the number of wavelengths, if their intensities were given. problem: why those of
    the region are missing, e.g. because it is dark. retinal: the region as cones see it, with an eye.
    """

    document: Document
    region: RegionMetrics | None
    histogram: SpeckleHistogram | None
    profile: LineProfile | None
    curve: ContrastCurve | None
    problem: str = ""
    retinal: RetinalContrast | None = None


class LiveMeasurement:
    """Measures the newest image in the background.

    measurements: the last results. on_change: called on the owner's thread when there are new ones.
    """

    def __init__(self, session: EditingSession, on_change: Callable[[], None] = lambda: None) -> None:
        self.measurements: ImageMeasurements | None = None
        self._on_change = on_change
        self._task: LatestTask[ImageMeasurements] = LatestTask(
            "figures", session.call_on_owner, session.messages.post_error
        )

    @property
    def is_busy(self) -> bool:
        """Whether newer measurements are being computed."""
        return self._task.is_busy

    def request(
        self, document: Document, xyz: Image, target: Image | None = None, intensity: Image | None = None
    ) -> None:
        """Requests measurements of an image; see `measure_image`. The arrays must not be changed afterwards."""
        self._task.submit(lambda: measure_image(document, xyz, target, intensity), self._on_result)

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _on_result(self, measurements: ImageMeasurements) -> None:
        self.measurements = measurements
        self._on_change()


def measure_image(
    document: Document, xyz: Image, target: Image | None = None, intensity: Image | None = None
) -> ImageMeasurements:
    """Measures the image XYZ (y, x, 3) of a document.

    target (y, x, 3), linear sRGB: enables PSNR and colour error. intensity (wavelength, y, x): enables the curve. An
    error that the user can correct, such as a dark region, is stored as `problem`.
    """
    region, histogram, curve, problem, retinal = None, None, None, "", None
    try:
        region = measure_region(xyz, document.measured_region, target)
        histogram = speckle_histogram(xyz[..., 1], document.measured_region, independent_pattern_count(document.system))
        if document.system.eye is not None:
            known = None if target is None else luminance_of(target, document.measured_region)
            retinal = retinal_contrast(document.system, xyz[..., 1], document.measured_region, known)
        if intensity is not None:
            curve = contrast_by_wavelength(intensity.__getitem__, document.system, document.measured_region)
    except UserError as error:
        problem = str(error)
    return ImageMeasurements(document, region, histogram, _profile(document, xyz), curve, problem, retinal)


def _profile(document: Document, xyz: Image) -> LineProfile | None:
    """Luminance along the line of the view settings; None where there is none or it leaves the image."""
    if document.view_settings.profile is None:
        return None
    try:
        return line_profile(xyz[..., 1], document.view_settings.profile, document.sample_pitch_m)
    except UserError:
        return None
