"""The modulators' phase isn't steady during an exposure: digital drive makes it ripple."""

from __future__ import annotations

import math
from collections.abc import Sequence

from holoview.effects.effect import Effect, Moment
from holoview.effects.parameter import Parameter, Values

_MOMENTS = 6


class Flicker(Effect):
    """phase → phase · (1 + √2·depth·cos φ), averaged in intensity over a cycle of φ."""

    id = "flicker"
    cause = "The modulators' phase ripples within an exposure (flicker of digital drive)."
    finding = "The modulators' phase ripples by {depth} of itself (r.m.s.) within an exposure."
    parameters = (
        Parameter(
            "depth",
            "Relative r.m.s. ripple of the phase.",
            low=0.0,
            high=0.5,
            prior=0.05,
            scan=(0.03, 0.3, 0.03),
            even=True,
        ),
    )
    where = ("modulator 1", "modulator 2")

    def moments(self, v: Values) -> Sequence[Moment]:
        angles = [math.pi * (k + 0.5) / _MOMENTS for k in range(_MOMENTS)]
        return [(1 / _MOMENTS, 1 + math.sqrt(2) * v["depth"] * math.cos(angle)) for angle in angles]
