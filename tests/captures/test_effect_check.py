"""Known effects are checked against the bench before a search: what it can't have is one line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import pytest

from holoview.captures.dataset import Captures
from holoview.captures.predictor import check_known_effects
from holoview.model.bench_parts import Relay
from holoview.util.errors import UserError


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ({"gap": {"gap_error": 1e-4}}, "effects.gap: it needs 2 modulators, there are 1"),
        ({"slm_alignment": {"shift_x": 1e-6}}, "effects.slm_alignment: it needs 2 modulators"),
        ({"distance": {"distance_error": 1e38}}, "effects.distance.distance_error: .*out of range"),
        ({"distance": {"nothing": 1.0}}, "effects.distance.nothing: unknown parameter"),
        ({"nosuch": {}}, "nosuch"),
    ],
)
def test_a_known_effect_that_the_bench_cannot_have_is_refused(
    make_captures: Callable[..., Captures], known: Mapping[str, Mapping[str, float]], message: str
) -> None:
    two = make_captures()
    captures = replace(two, levels=two.levels[:, :1], slms=two.slms[:1], gap_m=None, relay1=Relay())
    check_known_effects(captures, {"distance": {"distance_error": 1e-4}, "laser_power": {}})
    with pytest.raises(UserError, match=message):
        check_known_effects(captures, known)
