"""The modulators' phase ripples during an exposure, as digital drive makes it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from holoview.model.effects.effect import Effect, ExposureSample
from holoview.model.effects.parameter import Parameter, Values

_SAMPLES_PER_CYCLE = 6


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
            even_symmetric=True,
        ),
    )
    acts_on = ("modulator 1", "modulator 2")

    def exposure_samples(self, v: Values) -> Sequence[ExposureSample]:
        angles = [math.pi * (k + 0.5) / _SAMPLES_PER_CYCLE for k in range(_SAMPLES_PER_CYCLE)]
        return [(1 / _SAMPLES_PER_CYCLE, 1 + math.sqrt(2) * v["depth"] * math.cos(angle)) for angle in angles]
