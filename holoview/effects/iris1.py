"""The stop of relay 1 has another size than its nominal one, or isn't centred."""

from __future__ import annotations

from holoview.effects.iris_base import Iris
from holoview.model.effects.effect import Needs


class Iris1(Iris):
    """The iris or square stop in the Fourier plane of relay 1."""

    id = "iris1"
    cause = "The iris or square stop between the modulators is wider, narrower or off its centre."
    finding = "The {stop} of relay 1 {faults}."
    relay = "relay1"
    acts_on = ("relay 1",)
    needs = Needs(modulators=2, irises=(1,), fourier=False)
