"""Columns, rows or pixels of modulator 1 don't follow what is sent."""

from __future__ import annotations

from holoview.effects.slm_stuck_base import SlmStuck


class Slm1Stuck(SlmStuck):
    """Fraction of the stroke = level_j at the stuck place j, whatever was sent.

    The backplane addresses pixels by a driver for each column and a gate for each row. Where one of them, or a
    contact, fails, a whole line keeps one voltage, and single pixels stay at theirs (Armitage, Underwood & Wu,
    Introduction to Microdisplays, Wiley 2006, chapter 2). Where lines cross, the column is seen.
    """

    id = "slm1_stuck"
    cause = "Columns, rows or pixels of modulator 1 are stuck: they show the same whatever is sent."
    acts_on = ("modulator 1",)
    modulator = 0
