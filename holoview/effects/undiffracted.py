"""Part of the light isn't modulated: gaps between pixels, reflections, dead time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.effects.effect import Effect
from holoview.effects.parameter import Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.effects.places import Surface


class Undiffracted(Effect):
    """t → (1 − |a|)·t + a, a = share + i·quadrature: an amplitude that every modulator leaves as it is."""

    id = "undiffracted"
    cause = "Part of the light isn't modulated (fill factor, reflections, dead time): a zero order remains."
    finding = "A share {size} of the light's amplitude isn't modulated."
    parameters = (
        Parameter("share", "Amplitude that isn't modulated.", low=-0.5, high=0.9, prior=0.1, scan=(-0.1, 0.5, 0.1)),
        Parameter("quadrature", "Its part out of phase.", low=-0.9, high=0.9, prior=0.05, fine=True),
    )
    where = ("modulator 1", "modulator 2")

    def transmission(self, light: Tensor, at: Surface, v: Values) -> Tensor:
        amount = complex(v["share"], v["quadrature"])
        return (1 - abs(amount)) * light + amount

    def words(self, system: object, v: Values) -> dict[str, str]:
        return {"size": f"{abs(complex(v['share'], v['quadrature'])):.3g}"}
