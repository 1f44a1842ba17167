"""A black level so far below the recorded one that dark pixels read 0."""

from __future__ import annotations

import pytest

from holoview.bench.diagnose.fit import identity_values, local_fit
from tests.diagnose.conftest import MakeContext

BLACK = -97.0
"""Counts below the recorded 64: a tenth of the pixels reads 0."""


def test_pixels_that_read_nothing_hide_no_black_level(make_context: MakeContext) -> None:
    """With them the fit ends 15 counts off. What noise still takes below 0 beside others moves it by 0.2; the noise of
    some 30 000 pixels with shot noise of 4 to 30 counts by 0.1."""
    context = make_context({"camera_black": {"black": BLACK}})
    effect, every = context.effects["camera_black"], context.kept
    assert 0.05 < (context.data.captures.images == 0).mean() < 0.2
    values = {"camera_black": identity_values(effect)}
    for _ in range(2):
        values = local_fit([effect], values, context.model_weighted_comparison(every, values)).values
    assert values["camera_black"]["black"] == pytest.approx(BLACK, abs=1.0)
