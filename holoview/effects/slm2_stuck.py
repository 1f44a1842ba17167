"""Columns, rows or pixels of modulator 2 don't follow what is sent."""

from __future__ import annotations

from holoview.effects.slm_stuck_base import SlmStuck
from holoview.model.effects.effect import Needs


class Slm2Stuck(SlmStuck):
    """Fraction of the stroke = level_j at the stuck place j, as for modulator 1 (`slm1_stuck`)."""

    id = "slm2_stuck"
    cause = "Columns, rows or pixels of modulator 2 are stuck: they show the same whatever is sent."
    acts_on = ("modulator 2",)
    modulator = 1
    needs = Needs(modulators=2)
