"""The wavelengths of all lasers are wrong by the same amount."""

from __future__ import annotations

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System


class WavelengthOffset(Effect):
    """λ → λ + offset, for every laser."""

    id = "wavelength_offset"
    cause = "The lasers' wavelengths are off."
    finding = "The wavelengths are off by {offset}."
    parameters = (
        Parameter(
            "offset", "Added to every wavelength.", "nm", low=-50e-9, high=50e-9, prior=2e-9, scan=(-18e-9, 18e-9, 2e-9)
        ),
    )
    acts_on = ("source",)

    def actual_system(self, system: System, v: Values) -> System:
        return system.with_(wavelengths=system.wavelengths_m + v["offset"])
