"""Drawn chains of elements, possible ones and others: a picture on every stage, or one sentence."""

from __future__ import annotations

import numpy as np

import holoview as hv
from tests.fuzz.drawn_chains import ChainDrawer, see_every_stage

_DRAWS = 60


def test_a_drawn_chain_is_a_picture_or_a_sentence() -> None:
    drawer, pictures = ChainDrawer(int(np.random.default_rng(7).integers(1 << 31))), 0
    for _ in range(_DRAWS):
        try:
            see_every_stage(drawer.table())
        except hv.UserError as error:
            assert "\n" not in str(error)
            continue
        pictures += 1
    assert pictures > 0
