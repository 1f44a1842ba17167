"""The look-up table between levels and drive is wrong, so that levels aren't equal steps of optical path."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from holoview.model.effects.effect import Effect, Parameter, Values
from holoview.model.system import System
from holoview.numerics.sampling import knot_interval, power_law

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext

_STEPS = 15  # intervals between knots at 0, 1/15, …, 1 of the drive, the levels of a modulator with 16
_GAMMAS = (0.45, 0.55, 0.67, 0.82, 1.22, 1.49, 1.82, 2.23)  # e^±0.2 … e^±0.8


def _knots(modulator: int) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"level{modulator}_{k:02d}",
            f"Added by modulator {modulator} at {k}/{_STEPS} of the drive, as a share of the stroke.",
            low=-0.6,
            high=0.6,
            prior=0.05,
            secondary=True,
        )
        for k in range(1, _STEPS + 1)
    )


class Lut(Effect):
    """Fraction of the stroke = drive^gamma + a correction that is linear between free knots.

    Where the correction would make the response fall at a knot, it stays constant instead. Each modulator has its own
    gamma and knots; the nominal response is the straight line.
    """

    id = "lut"
    cause = "The modulators' levels aren't equal steps of optical path: their look-up table is wrong."
    finding = "Half drive gives {half} of the stroke, not 0.5."
    parameters = (
        Parameter("gamma1", "Exponent of modulator 1's response.", low=0.2, high=5.0, prior=0.2, identity=1.0),
        Parameter("gamma2", "Exponent of modulator 2's response.", low=0.2, high=5.0, prior=0.2, identity=1.0),
        *_knots(1),
        *_knots(2),
    )
    acts_on = ("modulator 1", "modulator 2")

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        """Both modulators with the same gamma, and each alone."""
        alike = [{"gamma1": g, "gamma2": g} for g in _GAMMAS]
        alone = [{name: g} for name in ("gamma1", "gamma2") for g in _GAMMAS]
        return alike + alone if len(system.modulators) == 2 else alone[: len(_GAMMAS)]

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        number = context.number + 1
        gamma = v[f"gamma{number}"]
        curved = power_law(share, gamma)
        added = [0.0, *(v[f"level{number}_{k:02d}"] for k in range(1, _STEPS + 1))]
        if not any(added):
            return curved
        knots = share.new_tensor([(k / _STEPS) ** gamma for k in range(_STEPS + 1)])
        rising = (knots + share.new_tensor(added)).cummax(dim=0).values
        correction = rising - knots
        index, fraction = knot_interval(share, _STEPS)
        return curved + correction[index] * (1 - fraction) + correction[index + 1] * fraction

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        halves = []
        for number in range(1, len(system.modulators) + 1):
            low, high = (v[f"level{number}_{k:02d}"] for k in (7, 8))
            halves.append(f"{0.5 ** v[f'gamma{number}'] + (low + high) / 2:.2f}")
        return {"half": " and ".join(dict.fromkeys(halves))}
