"""The lasers: their power, their wavelengths, a second line of each, and the width of the lines."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.effects.effect import Effect, Needs, Parameter, Values
from holoview.light.model.system import System


class LaserPower(Effect):
    """emitted = power^(1 + exponent), both relative to the nominal power."""

    id = "laser_power"
    cause = "The lasers' light doesn't rise in proportion to the power that was set."
    finding = "The lasers' light rises as power to the {total}."
    parameters = (
        Parameter(
            "exponent", "Added to the exponent 1 of the power.", low=-0.9, high=3.0, prior=0.1, scan=(-0.5, 0.8, 0.1)
        ),
    )
    acts_on = ("source",)
    needs = Needs(powers=2)

    def laser_power(self, power: Any, v: Values) -> Any:
        return power ** (1 + v["exponent"])

    def finding_fields(self, system: Any, v: Values) -> dict[str, str]:
        return {"total": f"{1 + v['exponent']:.3f}"}


class WavelengthOffset(Effect):
    """λ → λ + offset, for every laser."""

    id = "wavelength_offset"
    cause = "The lasers' wavelengths are off."
    finding = "The wavelengths are off by {offset}."
    parameters = (
        Parameter(
            "offset", "Added to every wavelength.", "nm", low=-50e-9, high=50e-9, prior=2e-9, scan=(-18e-9, 18e-9, 2e-9)
        ),
    )
    acts_on = ("source",)

    def actual_system(self, system: System, v: Values) -> System:
        return system.with_(wavelengths=system.wavelengths_m + v["offset"])


_SEARCHED_SHARE = 0.3
_PRIOR_M = 20e-9  # large: steps of derivatives, 2 % of it, have to pass over the jumps of irises on a grid
_SEARCHED_OFFSETS_M = (-10e-9, -8e-9, -6e-9, -4e-9, -2e-9, -1e-9, 1e-9, 2e-9, 4e-9, 6e-9, 8e-9, 10e-9)


class SecondLine(Effect):
    """A share of each laser's power is at λ + offset, and the rest, 1 − share, at λ.

    Longitudinal modes beside the strongest one, or a sideband (Saleh & Teich, Fundamentals of Photonics). Lines
    whose beat is much faster than an exposure, above a kilohertz for a camera, add in intensity. All lasers have the
    same share and offset. The first line is the stronger one: where the nominal wavelength is that of the weaker line,
    `wavelength_offset` leads from it to the other.
    """

    id = "second_line"
    cause = "The lasers emit a second spectral line (another longitudinal mode, or a sideband)."
    finding = "A share {share} of each laser's light is in a second line, {offset} away."
    parameters = (
        Parameter("share", "Share of the power in the second line, the weaker one.", low=0.0, high=0.5, prior=0.1),
        Parameter(
            "offset",
            "Wavelength of the second line minus that of the first; without effect while its share is 0.",
            "nm",
            low=-30e-9,
            high=30e-9,
            prior=_PRIOR_M,
            identity=2e-9,
            passes_edges=True,
            modifies=("share",),
        ),
    )
    acts_on = ("source",)
    degenerate_limit = ("wavelength_offset",)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [{"share": _SEARCHED_SHARE, "offset": offset} for offset in _SEARCHED_OFFSETS_M]

    def actual_system(self, system: System, v: Values) -> System:
        if v["share"] == 0 or v["offset"] == 0:
            return system
        return _with_lines(system, np.array([0.0, v["offset"]]), np.array([1 - v["share"], v["share"]]))


def _with_lines(system: System, offsets_m: NDArray[np.float64], shares: NDArray[np.float64]) -> System:
    """A system of which each laser is several, (line,) beside its wavelength, with these shares of its power."""
    lines = (system.wavelengths_m[:, None] + offsets_m).ravel()
    amplitudes = (system.amplitudes[:, :, None] * shares).reshape(system.frames, -1)
    source = system.source
    if source.tilts_rad is not None:
        source = dataclasses.replace(source, tilts_rad=np.repeat(source.tilts_rad, len(shares), axis=0))
    return dataclasses.replace(system, wavelengths_m=lines, amplitudes=amplitudes, source=source)


_QUADRATURE_POINTS = ((2.5e-9, 5), (5e-9, 7), (np.inf, 11))  # (standard deviation up to which, number of points)
_NEGLIGIBLE = 0.01  # weight of a node in the intensity


class Bandwidth(Effect):
    """Each wavelength becomes a line of standard deviation `sigma`.

    The line is (1 − top) times a Gaussian plus `top` times a rectangle of the same variance, sampled by Gauss–Hermite
    and Gauss–Legendre quadrature.
    """

    id = "bandwidth"
    cause = "The lasers' lines are broad: light of slightly different wavelengths adds in intensity."
    finding = "The light's spectral lines are {sigma} wide (standard deviation), not monochromatic."
    parameters = (
        Parameter(
            "sigma",
            "Standard deviation of each line.",
            "nm",
            low=0.0,
            high=30e-9,
            prior=1e-9,
            scan=(1e-9, 9e-9, 1e-9),
            even_symmetric=True,
        ),
        Parameter(
            "top",
            "Share of a rectangle in the line.",
            low=0.0,
            high=1.0,
            prior=0.5,
            secondary=True,
            modifies=("sigma",),
        ),
    )
    acts_on = ("source",)

    def actual_system(self, system: System, v: Values) -> System:
        if v["sigma"] == 0:
            return system
        nodes, weights = line_quadrature(_point_count(v["sigma"]), v["top"])
        return _with_lines(system, v["sigma"] * nodes, weights)

    def sample_phase(self, system: System, v: Values) -> float:
        """π·z·u²·δλ, summed over all ways to the farthest plane: u of the first order's edge, δλ between nodes."""
        shortest, way = float(system.wavelengths_m.min()), system.way
        ways_m = [*way.distances_m[:-1], float(np.abs(system.planes_m).max())]
        sines = [r.first_order_sine(shortest, pitch_m) for r, pitch_m in zip(way.relays, way.orders_m, strict=True)]
        turns = sum(z * (sine / shortest) ** 2 for z, sine in zip(ways_m, sines, strict=True))
        return math.pi * turns * v["sigma"] * _widest_step(_point_count(v["sigma"]), v["top"])


def _point_count(sigma_m: float) -> int:
    return next(count for widest, count in _QUADRATURE_POINTS if sigma_m <= widest)


def _widest_step(points: int, top: float) -> float:
    """The widest step between neighbouring nodes that aren't negligible, in standard deviations."""
    nodes, weights = line_quadrature(points, top)
    rules = (nodes[:points], nodes[points:]) if top else (nodes,)
    kept = (rule[w > _NEGLIGIBLE] for rule, w in zip(rules, np.split(weights, len(rules)), strict=True))
    return max((float(np.diff(rule).max()) for rule in kept if len(rule) > 1), default=0.0)


def line_quadrature(points: int, top: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes, in standard deviations, and weights, which sum to 1, of a line of which `top` is a rectangle."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(points)
    weights = weights / weights.sum()
    if top == 0:
        return nodes, weights
    legendre_nodes, legendre_weights = np.polynomial.legendre.leggauss(points)
    return (
        np.concatenate([nodes, 3**0.5 * legendre_nodes]),
        np.concatenate([(1 - top) * weights, top / 2 * legendre_weights]),
    )
