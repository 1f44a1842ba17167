"""The lasers emit a second spectral line beside the nominal one; both add in intensity."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

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
        ),
    )
    acts_on = ("source",)
    degenerate_limit = ("wavelength_offset",)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        return [{"share": _SEARCHED_SHARE, "offset": offset} for offset in _SEARCHED_OFFSETS_M]

    def actual_system(self, system: System, v: Values) -> System:
        if v["share"] == 0 or v["offset"] == 0:
            return system
        lines = (system.wavelengths_m[:, None] + np.array([0.0, v["offset"]])).ravel()
        shares = np.array([1 - v["share"], v["share"]])
        amplitudes = (system.amplitudes[:, :, None] * shares).reshape(system.frames, -1)
        source = system.source
        if source.tilts_rad is not None:
            source = dataclasses.replace(source, tilts_rad=np.repeat(source.tilts_rad, 2, axis=0))
        return dataclasses.replace(system, wavelengths_m=lines, amplitudes=amplitudes, source=source)
