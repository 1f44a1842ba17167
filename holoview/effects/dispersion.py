"""The optical path of a level depends on the wavelength: its size, and the shape of the table."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect, Needs, Parameter, Values
from holoview.model.system import System
from holoview.numerics.sampling import power_law

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext


_REFERENCE_M = 550e-9  # wavelength at which slopes and curvature don't count
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


_LOWEST = 0.05  # of the exponent
_SEARCHED = (-0.3, -0.2, -0.1, 0.1, 0.2, 0.3)


def _of_modulator(number: int) -> tuple[Parameter, Parameter]:
    return (
        Parameter(
            f"slope{number}",
            f"Rise of the exponent of modulator {number} for each 100 nm.",
            low=-0.6,
            high=0.6,
            prior=0.1,
        ),
        Parameter(
            f"offset{number}",
            f"Exponent of modulator {number} at 550 nm, minus 1.",
            low=-0.7,
            high=2.0,
            prior=0.1,
            secondary=True,
        ),
    )


class LutDispersion(Effect):
    """Fraction of the stroke → fraction^γ(λ), γ = 1 + offset + slope·x ≥ 0.05, x = (550 nm − λ)/100 nm.

    A table is made at one wavelength. The path of a level follows from the liquid crystal's tilt at its voltage; tilted
    and untilted layers disperse differently, so that a table that is linear at one wavelength is curved at others (Li
    et al., J. Disp. Technol. 1, 51 (2005), for the dispersion). `dispersion` changes the path of full drive, `lut` the
    shape at all wavelengths alike; this is the shape that differs between wavelengths.
    """

    id = "lut_dispersion"
    cause = "The shape of the modulators' look-up table depends on the wavelength."
    finding = "Half drive gives {blue} of the stroke at 450 nm and {red} at 650 nm, not 0.5."
    parameters = (*_of_modulator(1), *_of_modulator(2))
    acts_on = ("modulator 1", "modulator 2")
    needs = Needs(wavelengths=2)

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Both modulators alike, and each alone."""
        alone = [{f"slope{n + 1}": slope} for n in range(len(system.modulators)) for slope in _SEARCHED]
        alike = [{"slope1": slope, "slope2": slope} for slope in _SEARCHED]
        return alike + alone if len(system.modulators) == 2 else alone

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return power_law(share, self.exponent(context.number, context.wavelength_m, v))

    def exponent(self, modulator: int, wavelength_m: float, v: Values) -> float:
        """γ of modulator 0 or 1 at a wavelength."""
        x = (_REFERENCE_M - wavelength_m) / _SLOPE_UNIT_M
        return max(1 + v[f"offset{modulator + 1}"] + v[f"slope{modulator + 1}"] * x, _LOWEST)

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        def halves(wavelength_m: float) -> str:
            texts = [f"{0.5 ** self.exponent(n, wavelength_m, v):.2f}" for n in range(len(system.modulators))]
            return " and ".join(dict.fromkeys(texts))

        return {"blue": halves(450e-9), "red": halves(650e-9)}
