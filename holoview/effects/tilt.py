"""The illumination arrives at another angle than its nominal one."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from holoview.effects.starting_grids import square_grid
from holoview.model.effects.effect import DataProperties, Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System


class Tilt(Effect):
    """direction → direction + (tilt_y, tilt_x), for every direction of the source and every wavelength."""

    id = "tilt"
    cause = "The illumination falls in at an angle."
    finding = "The illumination is tilted by {tilt_y} (y) and {tilt_x} (x)."
    parameters = (
        Parameter("tilt_y", "Angle added in y.", "mrad", low=-0.1, high=0.1, prior=1e-3),
        Parameter("tilt_x", "Angle added in x.", "mrad", low=-0.1, high=0.1, prior=1e-3),
    )
    acts_on = ("source",)

    def degeneracies(self, properties: DataProperties) -> tuple[str, ...]:
        return ("camera_alignment",) if properties.is_fourier else ()

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return square_grid("tilt_y", "tilt_x", reach=7.5e-3, step=1.5e-3)

    def actual_system(self, system: System, v: Values) -> System:
        directions = system.source.directions_rad + np.array([v["tilt_y"], v["tilt_x"]])
        return dataclasses.replace(system, source=dataclasses.replace(system.source, directions_rad=directions))
