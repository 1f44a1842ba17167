"""The source isn't a point: light falls in from a cone of directions, and speckle washes out."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from holoview.effects.effect import Effect
from holoview.effects.parameter import Parameter, Values
from holoview.system import System

_FEWEST, _MOST = 7, 127


class SourceExtent(Effect):
    """Each direction → a disc of directions of angular radius `radius`, mutually incoherent and equally strong.

    Directions lie on Vogel's spiral, as many as resolve the finest speckle: a direction moves it by distance × angle,
    over 2·radius in all, and it is λ/(2·NA) wide.
    """

    id = "source_extent"
    cause = "The source is extended: its light is only partly coherent in space."
    finding = "The source is a disc of {radius} angular radius, not a point."
    parameters = (
        Parameter(
            "radius",
            "Angular radius of the source.",
            "mrad",
            low=0.0,
            high=20e-3,
            prior=1e-3,
            scan=(0.5e-3, 5.5e-3, 0.5e-3),
            even=True,
        ),
    )
    where = ("source",)

    def bench(self, system: System, v: Values) -> System:
        radius = v["radius"]
        count = self.directions(system, radius)
        turn = np.arange(count) * math.pi * (3 - math.sqrt(5))
        out = radius * np.sqrt((np.arange(count) + 0.5) / count)
        disc = np.stack([out * np.sin(turn), out * np.cos(turn)], axis=1)
        disc -= disc.mean(axis=0)
        directions = (system.source.directions_rad[:, None] + disc[None]).reshape(-1, 2)
        return dataclasses.replace(system, source=dataclasses.replace(system.source, directions_rad=directions))

    def directions(self, system: System, radius_rad: float) -> int:
        """How many directions the disc takes."""
        far = float(system.planes_m.max()) + (system.gap_m or 0.0)
        shortest = float(system.wavelengths_m.min())
        nas = [na for na in (system.relay1.iris_na, system.relay2.iris_na) if na is not None]
        sine = min([*nas, shortest / system.modulators[0].pitch_m])
        across = 2 * radius_rad * far * 2 * sine / shortest
        return min(max(math.ceil(math.pi / 4 * (across + 2) ** 2), _FEWEST), _MOST)
