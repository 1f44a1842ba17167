"""Lasers aren't monochromatic: each wavelength is a line of some width, and its parts add in intensity."""

from __future__ import annotations

import dataclasses

import numpy as np

from holoview.effects.effect import Effect
from holoview.effects.parameter import Parameter, Values
from holoview.system import System

_POINTS = ((2.5e-9, 5), (5e-9, 7), (np.inf, 11))  # by the line's width


class Bandwidth(Effect):
    """Each wavelength → a Gaussian line of standard deviation `sigma`, by Gauss–Hermite quadrature."""

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
            even=True,
        ),
    )
    where = ("source",)

    def bench(self, system: System, v: Values) -> System:
        points = next(count for widest, count in _POINTS if v["sigma"] <= widest)
        nodes, weights = np.polynomial.hermite_e.hermegauss(points)
        lines = (system.wavelengths_m[:, None] + v["sigma"] * nodes).ravel()
        amplitudes = (system.amplitudes[:, :, None] * (weights / weights.sum())).reshape(system.frames, -1)
        source = system.source
        if source.tilts_rad is not None:
            source = dataclasses.replace(source, tilts_rad=np.repeat(source.tilts_rad, points, axis=0))
        return dataclasses.replace(system, wavelengths_m=lines, amplitudes=amplitudes, source=source)
