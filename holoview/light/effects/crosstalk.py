"""Pixels of a modulator influence their neighbours: fringing fields between them, coupling of their circuits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext

_FARTHEST = 4.5  # standard deviations from an edge, where 10⁻⁶ of its step is left
_LEAST_WIDTH = 1e-9  # samples, so that steep edges don't divide by zero


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
    element_kinds = ("phase",)
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


class Fringing(Effect):
    """Edges of one sign are smeared, by a Gaussian of σ = |width|·exp(−|Δ|/step) pixels where the path changes by Δ.

    Where the electrode of a pixel pulls sideways at its neighbour's liquid crystal, the field adds to the tilt of the
    molecules at the edges that face one way and acts against it at the others (Apter et al., Appl. Opt. 43, 11 (2004);
    Moser et al., Opt. Express 27, 25046 (2019)): an edge at which the path falls isn't as wide as one at which it
    rises. The positive sign of a width smears edges at which the path falls towards larger rows or columns, the
    negative one those at which it rises; the others stay sharp.

    The Gaussian and its dependence on the step are an empirical law of this program, not one of these papers. Its two
    numbers, width 0.82 and step 0.86 µm, are fitted to one modulator: the first orders of binary gratings with periods
    of 4, 8 and 16 pixels at 1550 nm, measured 1.78, 1.30 and 1.12 times as bright with steps of 3π as with π, come out
    as 1.74, 1.30 and 1.13. A blur that doesn't know the step makes them darker; one that smears both signs alike makes
    no difference between the orders +1 and −1. What such edges do to other patterns of that modulator wasn't measured.
    """

    id = "fringing"
    cause = "Fields across the pixels' edges smear edges of one sign (the tilt of the liquid crystal tells them apart)."
    finding = "Edges of one sign are smeared: {sizes}."
    parameters = (
        *(
            Parameter(
                f"width_{axis}",
                f"Standard deviation of small edges where the path falls towards larger {axis}; negative: rises.",
                "px",
                low=-3.0,
                high=3.0,
                prior=0.3,
                scan=(-0.9, 0.9, 0.3),
            )
            for axis in "yx"
        ),
        Parameter(
            "step",
            "Step of the path at which an edge is smeared 1/e as much.",
            "um",
            low=50e-9,
            high=50e-6,
            prior=0.3e-6,
            identity=0.86e-6,
            secondary=True,
            modifies=("width_y", "width_x"),
        ),
    )
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase",)

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        smeared = context.sampled(path_m)
        for axis, name in enumerate(("width_y", "width_x")):
            if v[name]:
                smeared = _smeared(smeared, axis, v[name] * context.upsample, v["step"])
        return smeared

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        told = [
            f"by {abs(v[name]):.3g} px where the path {'falls' if v[name] > 0 else 'rises'} towards larger {axis}"
            for axis, name in (("y", "width_y"), ("x", "width_x"))
            if v[name]
        ]
        step = self.parameters[-1].format(v["step"])
        return {"sizes": f"{', and '.join(told) or 'none'} (standard deviation of small edges, 1/e at {step})"}


def _smeared(path_m: Tensor, axis: int, width: float | Tensor, step_m: float | Tensor) -> Tensor:
    """Samples (y, x) of a path with smeared edges of one sign along an axis; width: in samples.

    A smeared edge differs from a sharp one by Δ·Q(r/σ) at the distance r, on both sides with opposite signs, Q the tail
    of the normal distribution. A sample takes the mean over itself, by ∫ Q(r/σ) dr from m = σ·φ(m/σ) − m·Q(m/σ).
    """
    before = path_m.movedim(axis, -1)
    steps = before.diff(dim=-1)
    steps, size = (steps.clamp(max=0), width) if width > 0 else (steps.clamp(min=0), -width)
    sigma = (size * (-steps.abs() / step_m).exp()).clamp(min=_LEAST_WIDTH)
    after, count = before.clone(), before.shape[-1]
    inner = sigma / math.sqrt(2 * math.pi)
    for m in range(min(math.ceil(_FARTHEST * float(size)), count - 1)):
        z = (m + 1) / sigma
        outer = sigma * (-z.square() / 2).exp() / math.sqrt(2 * math.pi) - (m + 1) * (z / math.sqrt(2)).erfc() / 2
        moved = steps * (inner - outer)
        after[..., m + 1 :] -= moved[..., : count - 1 - m]
        after[..., : count - 1 - m] += moved[..., m:]
        inner = outer
    return after.movedim(-1, axis)
