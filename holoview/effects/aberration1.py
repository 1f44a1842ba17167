"""Relay 1 has aberrations."""

from __future__ import annotations

from typing import ClassVar

from holoview.effects.aberration_base import Aberration
from holoview.model.effects.effect import Needs


class Aberration1(Aberration):
    """Zernike terms in the Fourier plane of relay 1. Its defocus alone is equivalent to a wrong gap."""

    id = "aberration1"
    cause = "The optics between the modulators have aberrations."
    finding = "Relay 1 has aberrations of {rms} r.m.s., {largest} above all."
    acts_on = ("relay 1",)
    degenerate_with: ClassVar = ("gap",)
    needs = Needs(modulators=2, irises=(1,), fourier=False)
