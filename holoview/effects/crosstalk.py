"""Fringing fields: the electric field of a pixel reaches its neighbours, which blurs the optical path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext


class Crosstalk(Effect):
    """opd → opd convolved with a Gaussian of standard deviation `sigma` modulator pixels."""

    id = "crosstalk"
    cause = "Neighbouring pixels of the modulators influence each other (fringing fields)."
    finding = "The modulators' pixels leak into their neighbours: a blur of {sigma} (standard deviation)."
    parameters = (
        Parameter(
            "sigma",
            "Standard deviation of the blur.",
            "px",
            low=0.0,
            high=4.0,
            prior=0.3,
            scan=(0.15, 1.2, 0.15),
            even=True,
        ),
    )
    acts_on = ("modulator 1", "modulator 2")
    order = 1

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return context.blurred(path_m, v["sigma"])
