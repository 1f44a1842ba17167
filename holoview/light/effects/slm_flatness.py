"""A modulator isn't flat: it adds a static wavefront."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.system import System
from holoview.util.units import format_rounded

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext

_TERMS = range(4, 12)  # Noll: defocus, astigmatism, coma, trefoil, spherical
_COMMON = (4, 5, 6)


def _terms(modulator: int) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"z{noll}_{modulator}",
            f"Zernike term {noll} (Noll) of modulator {modulator}, r.m.s. over the circle around it.",
            "nm",
            low=-5e-6,
            high=5e-6,
            prior=100e-9,
            scan=(-300e-9, 300e-9, 100e-9) if noll in _COMMON else None,
            secondary=noll not in _COMMON,
            acts_on=f"modulator {modulator}",
        )
        for noll in _TERMS
    )


class SlmFlatness(Effect):
    """opd → opd + Σ_j c_j·Z_j over the circle around the modulator, the same at all wavelengths."""

    id = "slm_flatness"
    cause = "A modulator isn't flat (backplane or cover glass): it adds a static wavefront."
    finding = "The modulators aren't flat: {rms} r.m.s. of wavefront."
    parameters = (*_terms(1), *_terms(2))
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase", "amplitude", "complex", "mask")
    varies_over_field = True
    order = 2

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        terms = {noll: value for noll in _TERMS if (value := v[f"z{noll}_{context.number + 1}"])}
        return path_m + context.zernike(path_m, terms) if terms else path_m

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        squares = [sum(v[f"z{noll}_{m + 1}"] ** 2 for noll in _TERMS) for m in range(len(system.modulators))]
        names = ("modulator 1", "modulator 2")
        parts = [
            f"{format_rounded(math.sqrt(s), 'nm', 3)} ({name})" for s, name in zip(squares, names, strict=False) if s
        ]
        return {"rms": " and ".join(parts) or "0 nm"}
