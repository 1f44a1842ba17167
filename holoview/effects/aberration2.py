"""Relay 2 has aberrations."""

from __future__ import annotations

from typing import ClassVar

from holoview.effects.aberration_base import Aberration
from holoview.model.effects.effect import Needs


class Aberration2(Aberration):
    """Zernike terms in the Fourier plane of relay 2. Its defocus alone is equivalent to a wrong distance."""

    id = "aberration2"
    cause = "The optics behind the last modulator have aberrations."
    finding = "Relay 2 has aberrations of {rms} r.m.s., {largest} above all."
    acts_on = ("relay 2",)
    degenerate_with: ClassVar = ("distance",)
    needs = Needs(irises=(2,), fourier=False)
