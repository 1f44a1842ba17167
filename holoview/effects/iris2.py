"""The stop of relay 2 has another size than its nominal one, or isn't centred."""

from __future__ import annotations

from holoview.effects.iris_base import Iris
from holoview.model.effects.effect import Needs


class Iris2(Iris):
    """The iris or square stop in the Fourier plane of relay 2."""

    id = "iris2"
    cause = "The iris or square stop behind the last modulator is wider, narrower or off its centre."
    finding = "The {stop} of relay 2 {faults}."
    relay = "relay2"
    acts_on = ("relay 2",)
    needs = Needs(irises=(2,), fourier=False)
