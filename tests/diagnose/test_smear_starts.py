"""The residuals show the line along which pictures are smeared."""

from __future__ import annotations

import pytest

from holoview.bench.diagnose.starts.picture import SmearStarts
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import MakeContext


@pytest.mark.parametrize(("y", "x"), [(1.0, -1.5), (0.5, 2.0)])
def test_the_start_is_the_line_to_first_order(make_context: MakeContext, y: float, x: float) -> None:
    """Fourth derivatives, which the start leaves out, and differences instead of derivatives cost a part of it."""
    context = make_context({"motion_blur": {"length_y": y, "length_x": x}})
    comparison = context.data_weighted_comparison(context.split.coarse, 0.0)
    starts = SmearStarts(comparison.fit_gains({}), comparison)
    (found,) = starts(listed_effects()["motion_blur"])
    assert (found["length_y"], found["length_x"]) == pytest.approx((y, x), abs=0.25)
    assert [name for name, effect in listed_effects().items() if starts(effect)] == ["motion_blur"]
