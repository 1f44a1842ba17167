"""A stop blocks the zero order of relay 2."""

from __future__ import annotations

import dataclasses

from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System


class DcBlock(Effect):
    """A round stop at the zero order in the Fourier plane of relay 2; `radius` is the direction sine at its edge.

    The stop covers at most 99 % of the way to the farthest point of the relay's iris or square stop.
    """

    id = "dc_block"
    cause = "A stop at the zero order (or dust there) takes low frequencies away."
    finding = "A stop of {radius} radius blocks the zero order."
    parameters = (
        Parameter(
            "radius",
            "Direction sine at the stop's edge.",
            "mrad",
            low=0.0,
            high=50e-3,
            prior=1e-3,
            scan=(0.5e-3, 5.5e-3, 0.5e-3),
            non_smooth=True,
        ),
    )
    acts_on = ("relay 2",)

    def actual_system(self, system: System, v: Values) -> System:
        relay = system.relay2
        radius = max(v["radius"], relay.dc_block_na or 0.0)
        if relay.has_aperture:
            shortest, pitch_m = float(system.wavelengths_m.min()), system.modulators[0].pitch_m
            radius = min(radius, 0.99 * relay.steepest_sine(shortest, pitch_m))
        if radius < 1e-5:  # the least that a System accepts
            return system
        return dataclasses.replace(system, relay2=dataclasses.replace(relay, dc_block_na=radius))
