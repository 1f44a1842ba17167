"""Light that the cover glass of modulator 2 reflects twice interferes with what passes."""

from __future__ import annotations

from holoview.effects.slm_fringes_base import SlmFringes
from holoview.model.effects.effect import Needs


class Slm2Fringes(SlmFringes):
    """transmission t → t·(1 + ½·(c_λ + i·s_λ)·exp(iφ)), φ = 2π·(path_y·y + path_x·x)/(2λ), y and x from −1 to 1.

    Two beams of a weak etalon (Born & Wolf, Principles of Optics, 7.6): the second one passes the glass once more to
    and fro, a round trip 2·n·thickness that varies over the modulator by `path`. The light has fringes of depth c and
    phase, and so has its wavefront. (c, s) is free at each wavelength.
    """

    id = "slm2_fringes"
    cause = "The cover glass of modulator 2 reflects light twice, which interferes: fringes lie over the modulator."
    acts_on = ("modulator 2",)
    needs = Needs(modulators=2, fourier=False)
    modulator = 1
