"""The stroke of a modulator varies smoothly over its area: cell gap, temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext

_TERMS = range(1, 7)  # Noll: mean, slope along x, slope along y, bow, two saddles
_COMMON = (1, 2, 3, 4)


def _terms(modulator: int) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"z{noll}_{modulator}",
            f"Zernike term {noll} (Noll) of modulator {modulator}'s relative stroke, r.m.s. over the circle around it.",
            low=-0.5,
            high=0.5,
            prior=0.03,
            scan=(-0.15, 0.15, 0.05) if noll in _COMMON else None,
            secondary=noll not in _COMMON,
        )
        for noll in _TERMS
    )


class StrokeMap(Effect):
    """opd → opd · (1 + Σ_j c_j·Z_j) over the circle around the modulator.

    The phase of a level is proportional to the thickness of the liquid crystal, which is that of the cell, and to its
    birefringence, which falls with the temperature (Xun & Cohn, Appl. Opt. 43, 6400 (2004), for measured maps). A bow
    changes the mean too, which alone is `stroke`; a wavefront that doesn't depend on the level is `slm_flatness`.
    """

    id = "stroke_map"
    cause = "A modulator's stroke varies over its area (thickness or temperature of the liquid crystal)."
    finding = "The stroke varies over the modulators: {rms} r.m.s. of itself."
    parameters = (*_terms(1), *_terms(2))
    acts_on = ("modulator 1", "modulator 2")
    varies_over_field = True
    degenerate_with: ClassVar = ("stroke",)

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        terms = {noll: value for noll in _TERMS if (value := v[f"z{noll}_{context.number + 1}"])}
        return path_m * (1 + context.zernike(path_m, terms)) if terms else path_m

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        squares = [sum(v[f"z{noll}_{m + 1}"] ** 2 for noll in _TERMS[1:]) for m in range(len(system.modulators))]
        parts = [f"{100 * square**0.5:.2g} % (modulator {m})" for m, square in enumerate(squares, start=1) if square]
        return {"rms": " and ".join(parts) or "0 %"}
