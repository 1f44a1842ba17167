"""The illumination: its angle, its brightness over the first modulator, and the angular size of its source."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.effects.effect import DataProperties, Effect, Parameter, Values, square_grid
from holoview.light.model.system import System
from holoview.util.units import format_rounded

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext


class SourceProfile(Effect):
    """amplitude = exp(−fall·|r|² + slope·r), with r in units of half the modulator's longer side.

    A Gaussian beam of waist w and centre c has fall = (half/w)² and slope = 2·fall·c/half. These parameters are zero
    for uniform illumination, where the waist is infinite and the centre undefined.
    """

    id = "source_profile"
    cause = "The illumination isn't flat: a Gaussian beam, or one that is off the centre."
    finding = "The illumination is {shape}."
    parameters = (
        Parameter("fall", "Fall of the amplitude's logarithm at the edge.", low=-2.0, high=8.0, prior=0.3),
        Parameter("slope_y", "Slope of the amplitude's logarithm in y.", low=-8.0, high=8.0, prior=0.2),
        Parameter("slope_x", "Slope of the amplitude's logarithm in x.", low=-8.0, high=8.0, prior=0.2),
    )
    acts_on = ("source",)
    varies_over_field = True
    order = 3  # it lights what the modulator leaves unmodulated too

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [{"fall": fall} for fall in (0.2, 0.5, 1.0, 2.0, 4.0)] + square_grid("slope_y", "slope_x", 0.5, 0.5)

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        y, x = (place / context.half_width() for place in context.positions(transmission))
        logarithm = v["slope_y"] * y + v["slope_x"] * x - v["fall"] * (y * y + x * x)
        return transmission * logarithm.exp()

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        half = max(system.field_m) / 2
        fall, slopes = v["fall"], (v["slope_y"], v["slope_x"])
        if fall <= 0.02:
            return {"shape": "brighter on one side" if any(slopes) else "brighter towards the edge"}
        centre = [format_rounded(slope / (2 * fall) * half, "um", 3) for slope in slopes]
        waist = format_rounded(half / fall**0.5, "mm", 3)
        return {
            "shape": f"a Gaussian beam of waist {waist} (1/e of amplitude), centred at y = {centre[0]}, x = {centre[1]}"
        }


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


_MIN_SIDE, _MAX_SIDE = 3, 9  # directions along a side of the grid
_FINEST_SPECKLE_M = 400e-9  # wavelength whose speckle is counted, so that no laser's light depends on another one


class SourceExtent(Effect):
    """Each direction becomes a disc of mutually incoherent directions of angular radius `radius`.

    `outline` changes the disc gradually to a square (1) or a Gaussian spot (−1) of the same variance, radius²/4 along
    each axis. The directions are a square grid, mapped to the disc with equal areas (Shirley & Chiu, J. Graph. Tools 2,
    45 (1997)). A direction at an angle θ shifts the speckle by distance·θ, and modulators of width D make speckle at
    least λ·distance/D wide, so that D·θ/λ grains pass, however far away. With λ = 400 nm the grid follows from the
    radius and the width alone: the light at a plane and wavelength doesn't depend on what else is computed. Nearer by,
    and behind narrow stops, speckle is wider and fewer directions would do.
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
            even_symmetric=True,
        ),
        Parameter(
            "outline",
            "From a Gaussian spot over a disc to a square.",
            low=-1.0,
            high=1.0,
            prior=0.5,
            secondary=True,
            modifies=("radius",),
        ),
    )
    acts_on = ("source",)

    def actual_system(self, system: System, v: Values) -> System:
        if v["radius"] == 0:
            return system
        spread = v["radius"] * spot_directions(directions_per_side(system, v["radius"]), v["outline"])
        directions = (system.source.directions_rad[:, None] + spread[None]).reshape(-1, 2)
        return dataclasses.replace(system, source=dataclasses.replace(system.source, directions_rad=directions))

    def sample_phase(self, system: System, v: Values) -> float:
        """2π·u·z·δθ over gap and farthest plane: u of the first order's edge, δθ between neighbouring directions."""
        if v["radius"] == 0:
            return 0.0
        shortest, way = float(system.wavelengths_m.min()), system.way
        far_m = float(np.abs(system.planes_m).max()) + sum(way.distances_m)
        step = 2 * v["radius"] / directions_per_side(system, v["radius"])
        sine = way.relays[way.last].first_order_sine(shortest, way.orders_m[way.last])
        return 2 * math.pi * sine / shortest * far_m * step


def directions_per_side(system: System, radius_rad: float) -> int:
    """The number of directions along a side of the grid: one for each grain of speckle that passes, and two more."""
    grains = 2 * radius_rad * max(system.field_m) / _FINEST_SPECKLE_M
    return min(max(math.ceil(grains) + 2, _MIN_SIDE), _MAX_SIDE)


def spot_directions(side: int, outline: float) -> NDArray[np.float64]:
    """Points (n, 2) of equal weight for a radius of 1, with a variance of 1/4 along each axis for every outline.

    n is the square of `side`, or of the next odd number: then the middle of the disc is a point, the nominal direction.
    """
    side |= 1
    middles = (2 * np.arange(side) + 1) / side - 1
    v, u = (a.ravel() for a in np.meshgrid(middles, middles, indexing="ij"))
    radius = np.maximum(np.abs(u), np.abs(v))
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.where(np.abs(u) >= np.abs(v), np.pi / 4 * v / u, np.pi / 2 - np.pi / 4 * u / v)
    angle = np.where(radius == 0, 0.0, angle)
    sign = np.where(np.where(np.abs(u) >= np.abs(v), u, v) < 0, -1.0, 1.0)
    direction = sign[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    disc = _scaled(radius[:, None] * direction)
    if outline > 0:
        return _scaled((1 - outline) * disc + outline * _scaled(np.stack([v, u], axis=1)))
    if outline < 0:
        gauss = np.sqrt(-2 * np.log1p(-(radius**2)))[:, None] * direction
        return _scaled((1 + outline) * disc - outline * _scaled(gauss))
    return disc


def _scaled(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points relative to their mean, scaled to a mean squared radius of 1/2."""
    points = points - points.mean(axis=0)
    return points / math.sqrt(2 * float((points**2).sum(axis=1).mean()))
