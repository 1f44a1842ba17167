"""The modulators' stroke, the optical path of full drive: its size, and how it varies over their areas."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from holoview.model.effects.effect import Effect, Parameter, Values
from holoview.model.system import System
from holoview.util.units import format_rounded

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext


class Stroke(Effect):
    """stroke → stroke·(1 + stroke_error ± difference), + for the first modulator and − for the second.

    The same everywhere on a modulator: the mean of a `stroke_map`.
    """

    id = "stroke"
    cause = "The modulators' stroke (the optical path of full drive) isn't its nominal value."
    finding = "The stroke is {strokes}, not {nominal}."
    parameters = (
        Parameter(
            "stroke_error", "Relative error of the stroke.", low=-0.9, high=2.0, prior=0.1, scan=(-0.5, 0.5, 0.05)
        ),
        Parameter(
            "difference",
            "Half the relative difference of the two strokes.",
            low=-0.5,
            high=0.5,
            prior=0.05,
            secondary=True,
        ),
    )
    acts_on = ("modulator 1", "modulator 2")
    degenerate_with: ClassVar = ("stroke_map",)

    def actual_system(self, system: System, v: Values) -> System:
        modulators = tuple(
            dataclasses.replace(m, stroke_m=m.stroke_m * (1 + v["stroke_error"] + sign * v["difference"]))
            for m, sign in zip(system.modulators, (1, -1), strict=False)
        )
        return dataclasses.replace(system, modulators=modulators)

    def finding_fields(self, system: System, v: Values) -> Mapping[str, str]:
        strokes = [format_rounded(m.stroke_m, "nm") for m in self.actual_system(system, v).modulators]
        return {
            "strokes": " and ".join(dict.fromkeys(strokes)),
            "nominal": format_rounded(system.modulators[0].stroke_m, "nm"),
        }


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
