"""Figures of the region that is looked at, kept up to date on a thread while the image changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.metrics.speckle_histogram import SpeckleHistogram, speckle_histogram
from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.latest_task import LatestTask
from holoview.session.measure import (
    ContrastCurve,
    LineProfile,
    RegionMetrics,
    contrast_by_wavelength,
    independent_pattern_count,
    line_profile,
    measure_region,
)
from holoview.util.errors import UserError

Image = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class ImageMeasurements:
    """All that is known of what is seen: of its region, and along its line (luminance) where one is drawn.

    curve: contrast by the number of wavelengths, where their intensities were given. problem: why figures of the region
    are missing, e.g. because it is dark.
    """

    document: Document
    region: RegionMetrics | None
    histogram: SpeckleHistogram | None
    profile: LineProfile | None
    curve: ContrastCurve | None
    problem: str = ""


class LiveMeasurement:
    """Measures the newest image in the background; `figures` are the last that are known, `changed` is told of them."""

    def __init__(self, session: EditingSession, changed: Callable[[], None] = lambda: None) -> None:
        self.measurements: ImageMeasurements | None = None
        self._changed = changed
        self._newest: LatestTask[ImageMeasurements] = LatestTask(
            "figures", session.call_on_owner, session.messages.post_error
        )

    @property
    def is_busy(self) -> bool:
        """Whether newer figures are on their way."""
        return self._newest.is_busy

    def request(self, state: Document, xyz: Image, target: Image | None = None, intensity: Image | None = None) -> None:
        """Measures XYZ (y, x, 3) of a state beside its target; intensity (wavelength, y, x) gives the curve.

        The arrays must not change any more.
        """
        self._newest.submit(lambda: measure_image(state, xyz, target, intensity), self._on_result)

    def close(self) -> None:
        """Ends the thread."""
        self._newest.close()

    def _on_result(self, figures: ImageMeasurements) -> None:
        self.measurements = figures
        self._changed()


def measure_image(
    state: Document, xyz: Image, target: Image | None = None, intensity: Image | None = None
) -> ImageMeasurements:
    """The figures of an image; what the user can mend, such as a dark region, is told in `problem`."""
    region, histogram, curve, problem = None, None, None, ""
    try:
        region = measure_region(xyz, state.measured_region, target)
        histogram = speckle_histogram(xyz[..., 1], state.measured_region, independent_pattern_count(state.system))
        if intensity is not None:
            curve = contrast_by_wavelength(intensity.__getitem__, state.system, state.measured_region)
    except UserError as error:
        problem = str(error)
    return ImageMeasurements(state, region, histogram, _profile(state, xyz), curve, problem)


def _profile(state: Document, xyz: Image) -> LineProfile | None:
    """Luminance along the line, or nothing where a line of another bench leaves the image."""
    if state.view_settings.profile is None:
        return None
    pitch_m = state.system.modulators[0].pitch_m / state.system.sampling.upsample
    try:
        return line_profile(xyz[..., 1], state.view_settings.profile, pitch_m)
    except UserError:
        return None
