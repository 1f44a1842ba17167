"""Figures of the region that is looked at, kept up to date on a thread while the image changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.errors import UserError
from holoview.metrics.histogram import SpeckleHistogram, speckle_histogram
from holoview.session.measure import (
    ContrastCurve,
    Profile,
    RegionFigures,
    contrast_by_wavelength,
    line_profile,
    measure_region,
    patterns_expected,
)
from holoview.session.newest import Newest
from holoview.session.session import Session
from holoview.session.state import State

Image = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Figures:
    """All that is known of what is seen: of its region, and along its line (luminance) where one is drawn.

    curve: contrast by the number of wavelengths, where their intensities were given. problem: why figures of the region
    are missing, e.g. because it is dark.
    """

    state: State
    region: RegionFigures | None
    histogram: SpeckleHistogram | None
    profile: Profile | None
    curve: ContrastCurve | None
    problem: str = ""


class Live:
    """Measures the newest image in the background; `figures` are the last that are known, `changed` is told of them."""

    def __init__(self, session: Session, changed: Callable[[], None] = lambda: None) -> None:
        self.figures: Figures | None = None
        self._changed = changed
        self._newest: Newest[Figures] = Newest("figures", session.deliver, session.messages.post_error)

    @property
    def is_busy(self) -> bool:
        """Whether newer figures are on their way."""
        return self._newest.is_busy

    def look(self, state: State, xyz: Image, target: Image | None = None, intensity: Image | None = None) -> None:
        """Measures XYZ (y, x, 3) of a state beside its target; intensity (wavelength, y, x) gives the curve.

        The arrays must not change any more.
        """
        self._newest.ask(lambda: measured(state, xyz, target, intensity), self._take)

    def close(self) -> None:
        """Ends the thread."""
        self._newest.close()

    def _take(self, figures: Figures) -> None:
        self.figures = figures
        self._changed()


def measured(state: State, xyz: Image, target: Image | None = None, intensity: Image | None = None) -> Figures:
    """The figures of an image; what the user can mend, such as a dark region, is told in `problem`."""
    region, histogram, curve, problem = None, None, None, ""
    try:
        region = measure_region(xyz, state.region, target)
        histogram = speckle_histogram(xyz[..., 1], state.region, patterns_expected(state.system))
        if intensity is not None:
            curve = contrast_by_wavelength(intensity.__getitem__, state.system, state.region)
    except UserError as error:
        problem = str(error)
    return Figures(state, region, histogram, _profile(state, xyz), curve, problem)


def _profile(state: State, xyz: Image) -> Profile | None:
    """Luminance along the line, or nothing where a line of another bench leaves the image."""
    if state.look.profile is None:
        return None
    pitch_m = state.system.modulators[0].pitch_m / state.system.sampling.upsample
    try:
        return line_profile(xyz[..., 1], state.look.profile, pitch_m)
    except UserError:
        return None
