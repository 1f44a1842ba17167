"""An amplitude modulator's response: what its black pixels let through, and its gamma."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, Values
from holoview.light.model.system import System
from holoview.light.numerics.sampling import power_law

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext


class Leakage(Effect):
    """transmission t → t + (1 − t)·a, a = amplitude + i·quadrature: black passes a, white all as before.

    The contrast of the modulator, the light of a white pixel over that of a black one, is 1/|a|².
    """

    id = "leakage"
    cause = "Black pixels of an amplitude modulator let light through: its contrast is limited."
    finding = "Black pixels let {share} of the light through, a contrast of {contrast}:1."
    element_finding = "Black pixels of {element} let {share} of the light through, a contrast of {contrast}:1."
    parameters = (
        Parameter("amplitude", "Amplitude behind black.", low=-0.9, high=0.9, prior=0.1, scan=(-0.3, 0.3, 0.1)),
        Parameter("quadrature", "Its part out of phase.", low=-0.9, high=0.9, prior=0.1, secondary=True),
    )
    acts_on = ()
    element_kinds = ("amplitude",)

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return transmission + (1 - transmission) * complex(v["amplitude"], v["quadrature"])

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        share = v["amplitude"] ** 2 + v["quadrature"] ** 2
        return {"share": f"{100 * share:.3g} %", "contrast": f"{1 / share:.3g}" if share else "∞"}


class AmplitudeGamma(Effect):
    """amplitude = drive^gamma."""

    id = "amplitude_gamma"
    cause = "The amplitudes of an amplitude modulator aren't proportional to its drive: its table is wrong."
    finding = "Half drive gives {half} of the amplitude, not 0.5: a gamma of {gamma}."
    element_finding = "Half drive of {element} gives {half} of the amplitude, not 0.5: a gamma of {gamma}."
    parameters = (Parameter("gamma", "Exponent of the response.", low=0.2, high=5.0, prior=0.2, identity=1.0),)
    acts_on = ()
    element_kinds = ("amplitude",)

    def element_starts(self, parameters: tuple[Parameter, ...]) -> list[dict[str, float]]:
        return [{"gamma": gamma} for gamma in (0.45, 0.67, 0.82, 1.22, 1.49, 2.23)]

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        return power_law(share, v["gamma"])

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        return {"half": f"{0.5 ** v['gamma']:.2f}"}
