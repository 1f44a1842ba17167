"""Light of the other polarisation, which the modulators don't modulate, and which adds in intensity."""

from __future__ import annotations

import math
from collections.abc import Sequence

from holoview.model.effects.effect import Effect, ExposureSample
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System


class Polarisation(Effect):
    """I → (1 − share)·I + share·I₀, with I₀ the intensity behind modulators without any optical path.

    Liquid crystals modulate one linear polarisation (Saleh & Teich, Fundamentals of Photonics). Of light whose
    plane of polarisation is turned by α, share = sin²α is polarised across; it passes both modulators unmodulated, and
    light of two orthogonal polarisations doesn't interfere. Behind an analyser it does interfere: then it is an
    amplitude with a phase that is added to the modulators' transmission, which is `undiffracted`.
    """

    id = "polarisation"
    cause = "Light of the other polarisation passes the modulators unmodulated and adds in intensity."
    finding = "A share {share} of the light is polarised across and isn't modulated ({angle} from the right plane)."
    parameters = (
        Parameter(
            "share", "Share of the power that isn't modulated.", low=0.0, high=0.9, prior=0.05, scan=(0.05, 0.5, 0.05)
        ),
    )
    acts_on = ("modulator 1", "modulator 2")

    def exposure_samples(self, v: Values) -> Sequence[ExposureSample]:
        return [(1 - v["share"], 1.0), (v["share"], 0.0)] if v["share"] else [(1.0, 1.0)]

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"angle": f"{math.degrees(math.asin(v['share'] ** 0.5)):.1f}°"}
