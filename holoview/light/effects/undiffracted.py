"""Light that isn't modulated: it leaves a zero order, or, polarised across, adds in intensity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, ExposureSample, Parameter, Values
from holoview.light.model.system import System

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext


class Undiffracted(Effect):
    """transmission t → (1 − |a|)·t + a with the unmodulated amplitude a = share ± difference + i·quadrature.

    The sign is + for the first modulator and − for the second.
    """

    id = "undiffracted"
    cause = "Part of the light isn't modulated (fill factor, reflections, dead time): a zero order remains."
    finding = "A share {size} of the light's amplitude isn't modulated."
    parameters = (
        Parameter("share", "Amplitude that isn't modulated.", low=-0.5, high=0.9, prior=0.1, scan=(-0.1, 0.5, 0.1)),
        Parameter(
            "difference",
            "Half of what modulator 1 has more.",
            low=-0.5,
            high=0.5,
            prior=0.05,
            secondary=True,
            acts_on="modulator 2",
        ),
        Parameter("quadrature", "Its part out of phase.", low=-0.9, high=0.9, prior=0.05, secondary=True),
    )
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase", "complex")

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        a = self.unmodulated_amplitude(context.number, v)
        return (1 - abs(a)) * transmission + a

    def unmodulated_amplitude(self, modulator: int, v: Values) -> complex:
        """The complex amplitude that modulator 0 or 1 doesn't modulate."""
        return complex(v["share"] + (-1) ** modulator * v["difference"], v["quadrature"])

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        sizes = [f"{abs(self.unmodulated_amplitude(n, v)):.3g}" for n in range(len(system.modulators))]
        return {"size": " and ".join(dict.fromkeys(sizes))}


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
