"""Unmodulated light (gaps between pixels, reflections, dead time), which leaves a zero order."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext


class Undiffracted(Effect):
    """transmission t → (1 − |a|)·t + a with the unmodulated amplitude a = share ± difference + i·quadrature.

    The sign is + for the first modulator and − for the second.
    """

    id = "undiffracted"
    cause = "Part of the light isn't modulated (fill factor, reflections, dead time): a zero order remains."
    finding = "A share {size} of the light's amplitude isn't modulated."
    parameters = (
        Parameter("share", "Amplitude that isn't modulated.", low=-0.5, high=0.9, prior=0.1, scan=(-0.1, 0.5, 0.1)),
        Parameter("difference", "Half of what modulator 1 has more.", low=-0.5, high=0.5, prior=0.05, secondary=True),
        Parameter("quadrature", "Its part out of phase.", low=-0.9, high=0.9, prior=0.05, secondary=True),
    )
    acts_on = ("modulator 1", "modulator 2")

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        a = self.unmodulated_amplitude(context.number, v)
        return (1 - abs(a)) * transmission + a

    def unmodulated_amplitude(self, modulator: int, v: Values) -> complex:
        """The complex amplitude that modulator 0 or 1 doesn't modulate."""
        return complex(v["share"] + (-1) ** modulator * v["difference"], v["quadrature"])

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        sizes = [f"{abs(self.unmodulated_amplitude(n, v)):.3g}" for n in range(len(system.modulators))]
        return {"size": " and ".join(dict.fromkeys(sizes))}
