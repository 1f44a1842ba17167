"""Modulators that change the amplitude together with the phase, as twisted-nematic cells between polarisers do."""

from __future__ import annotations

from typing import TYPE_CHECKING

from holoview.light.model.effects.effect import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext


class TwistedNematic(Effect):
    """transmission t → A(s)·t, A(s) = 1 + slope·P₁(2s − 1) + bow·P₂(2s − 1) + bend·P₃(2s − 1), at least 0.

    s is the fraction of the stroke, and so of the phase, that a pixel shows, P are Legendre polynomials: A is relative
    to its mean over all phases, which is a property of the bench as the power of its laser is. A cell that twists the
    polarisation between two polarisers passes an amplitude that depends on the voltage as the phase does (Lu and Saleh,
    Opt. Eng. 29, 240 (1990); measured curves: Moreno et al., J. Appl. Phys. 94, 3697 (2003)). For cells in which a
    polariser leaves the mode that was meant, the part of the light that isn't modulated is `undiffracted`.
    """

    id = "twisted_nematic"
    cause = "The modulators change the amplitude together with the phase (twisted-nematic cells between polarisers)."
    finding = (
        "The modulators' amplitude changes with their phase: by {slope} from its mean to the last level, bow {bow}."
    )
    parameters = (
        Parameter(
            "slope",
            "Change of the amplitude from the mean to full stroke, linear in the phase.",
            low=-1.0,
            high=1.0,
            prior=0.2,
            scan=(-0.6, 0.6, 0.2),
        ),
        Parameter("bow", "Amplitude more at both ends than the mean.", low=-1.0, high=2.0, prior=0.2),
        Parameter("bend", "Third order of the amplitude.", low=-1.0, high=1.0, prior=0.1, secondary=True),
    )
    acts_on = ("modulator 1", "modulator 2")
    element_kinds = ("phase",)

    def transmission(self, transmission: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        assert context.shown is not None
        x = 2 * context.shown - 1
        amplitude = 1 + v["slope"] * x + v["bow"] * (1.5 * x.square() - 0.5) + v["bend"] * (2.5 * x.square() - 1.5) * x
        amplitude = amplitude.clamp_min(0)
        return transmission * (amplitude if transmission.shape == amplitude.shape else context.sampled(amplitude))
