"""Dispersion: the optical path that a level adds depends on the wavelength."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect, Needs
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext

_REFERENCE_M = 550e-9  # wavelength at which slope and curvature don't count
_SLOPE_UNIT_M = 100e-9  # change of wavelength for which they are given


class Dispersion(Effect):
    """opd(λ) = opd · (1 + offset + slope·x + curvature·x²), x = (550 nm − λ)/100 nm.

    The birefringence of liquid crystals is larger at short wavelengths, so that slope > 0 (Cauchy's formula; Li et al.,
    J. Disp. Technol. 1, 51 (2005)).
    """

    id = "dispersion"
    cause = "The modulators' optical path depends on the wavelength (dispersion of the liquid crystal)."
    finding = "The modulators' optical path changes with the wavelength: {blue} at 450 nm against 550 nm."
    parameters = (
        Parameter(
            "slope", "Relative rise of the path for each 100 nm.", low=-0.8, high=0.8, prior=0.1, scan=(-0.3, 0.3, 0.05)
        ),
        Parameter("curvature", "Its quadratic part.", low=-0.5, high=0.5, prior=0.03, secondary=True),
        Parameter("offset", "Relative error of the path at 550 nm.", low=-0.5, high=0.5, prior=0.05, secondary=True),
    )
    acts_on = ("modulator 1", "modulator 2")
    needs = Needs(wavelengths=2)

    def optical_path(self, path_m: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return path_m * self.path_factor(context.wavelength_m, v)

    def path_factor(self, wavelength_m: float, v: Values) -> float:
        """The factor of the nominal optical path."""
        x = (_REFERENCE_M - wavelength_m) / _SLOPE_UNIT_M
        return 1 + v["offset"] + v["slope"] * x + v["curvature"] * x * x

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"blue": f"{(self.path_factor(450e-9, v) / self.path_factor(_REFERENCE_M, v) - 1) * 100:+.1f} %"}
