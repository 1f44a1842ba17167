"""Pixels of a modulator influence their neighbours: fringing fields between them, coupling of their circuits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext


class Crosstalk(Effect):
    """opd → opd convolved with a Gaussian of standard deviation `sigma` modulator pixels.

    The electric field reaches beyond a pixel's edges, so that the path changes smoothly from one pixel to the next.
    Before it, `coupling` blurs the pixels' values as wholes, by weights coupling^(n²) of the neighbours n pixels away:
    leaks between the circuits of pixels, each of which stays uniform and keeps sharp edges.
    """

    id = "crosstalk"
    cause = "Neighbouring pixels of the modulators influence each other (fringing fields)."
    finding = "The modulators' pixels leak into their neighbours: {leaks}."
    parameters = (
        Parameter(
            "sigma",
            "Standard deviation of the blur across the pixels' edges.",
            "px",
            low=0.0,
            high=4.0,
            prior=0.3,
            scan=(0.15, 1.2, 0.15),
            even_symmetric=True,
        ),
        Parameter(
            "coupling",
            "Weight of the nearest pixels over that of a pixel itself, in a mean of whole pixels.",
            low=0.0,
            high=0.95,
            prior=0.1,
            scan=(0.1, 0.6, 0.1),
        ),
    )
    acts_on = ("modulator 1", "modulator 2")
    order = 1
    has_rival_parameters = True

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return context.averaged_pixels(share, v["coupling"]) if v["coupling"] else share

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return context.blurred(path_m, v["sigma"]) if v["sigma"] else path_m

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        edges = f"a blur of {v['sigma']:.3g} px across their edges (standard deviation)"
        whole = f"the nearest ones count {v['coupling']:.3g} times as much as the pixel itself"
        told = [text for text, size in ((edges, v["sigma"]), (whole, v["coupling"])) if size]
        return {"leaks": ", and ".join(told) or edges}
