"""Places of the eye's pupil that are drawn anew in each iteration, and those at which the result is judged.

A draw depends on the seed and on the iteration alone, so that an optimisation that is resumed draws the same places.
Shi et al., Pupil-aware holography, ACM Trans. Graph. 41, 6 (2022), train on pupils that are sampled in this way.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from holoview.model.focus import required_eye
from holoview.model.system import System
from holoview.numerics.fft_grid import positions
from holoview.optimise.settings import Settings

Places = tuple[tuple[float, float], ...]
"""Places (y, x) of the pupil in the eyebox, m."""
StacksAt = Callable[[Places], NDArray[np.floating]]
"""The focal stacks (place · plane, y, x, 3) in linear sRGB that the eye of a system is to see from places."""

_HELD_OUT = 2  # places along each axis


def drawn_places(system: System, settings: Settings, iteration: int) -> Places:
    """The places of an iteration: `settings.drawn_pupils`, uniform in a disc about the pupil of the system's eye.

    Raises UserError without an eye.
    """
    eye = required_eye(system, "pupil places")
    random = np.random.default_rng([settings.seed, iteration])
    radius_m = settings.drawn_radius_m * np.sqrt(random.random(settings.drawn_pupils))
    angle = 2 * math.pi * random.random(settings.drawn_pupils)
    y, x = eye.pupil_y_m + radius_m * np.sin(angle), eye.pupil_x_m + radius_m * np.cos(angle)
    return tuple(zip(y.tolist(), x.tolist(), strict=True))


def held_out_places(system: System, radius_m: float) -> Places:
    """A grid of 2 x 2 places, a radius apart, about the pupil of the system's eye: where to judge a result.

    Raises UserError without an eye.
    """
    eye, steps = required_eye(system, "pupil places"), positions(_HELD_OUT, radius_m).tolist()
    return tuple((eye.pupil_y_m + y, eye.pupil_x_m + x) for y in steps for x in steps)


class DrawnPupils:
    """The places of each iteration, and the stacks that are to be seen from them. Arguments as those of `iterate`."""

    def __init__(self, system: System, settings: Settings, stacks_at: StacksAt) -> None:
        self._system, self._settings, self._stacks_at = system, settings, stacks_at

    def __call__(self, iteration: int) -> tuple[Places, NDArray[np.floating]]:
        """The places of an iteration, and the stacks (place · plane, y, x, 3)."""
        places = drawn_places(self._system, self._settings, iteration)
        return places, self._stacks_at(places)
