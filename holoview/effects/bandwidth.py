"""The lasers aren't monochromatic: each emits a spectral line of some width, whose parts add in intensity."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

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
        Parameter("top", "Share of a rectangle in the line.", low=0.0, high=1.0, prior=0.5, secondary=True),
    )
    acts_on = ("source",)

    def actual_system(self, system: System, v: Values) -> System:
        if v["sigma"] == 0:
            return system
        nodes, weights = line_quadrature(_point_count(v["sigma"]), v["top"])
        lines = (system.wavelengths_m[:, None] + v["sigma"] * nodes).ravel()
        amplitudes = (system.amplitudes[:, :, None] * weights).reshape(system.frames, -1)
        source = system.source
        if source.tilts_rad is not None:
            source = dataclasses.replace(source, tilts_rad=np.repeat(source.tilts_rad, len(nodes), axis=0))
        return dataclasses.replace(system, wavelengths_m=lines, amplitudes=amplitudes, source=source)

    def sample_phase(self, system: System, v: Values) -> float:
        """π·z·u²·δλ, summed over gap and farthest plane: u of the first order's edge, δλ between neighbouring nodes."""
        shortest, pitch_m = float(system.wavelengths_m.min()), system.modulators[0].pitch_m
        ways = ((system.gap_m or 0.0, system.relay1), (float(system.planes_m.max()), system.relay2))
        turns = sum(z * (relay.first_order_sine(shortest, pitch_m) / shortest) ** 2 for z, relay in ways)
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
