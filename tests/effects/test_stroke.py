"""A longer stroke is a modulator with a longer stroke."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import torch

from holoview.bench.captures.dataset import Captures
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_both_strokes_grow_and_differ(make_session: Make, predicted: Predicted) -> None:
    captures = make_session()
    first, second = (dataclasses.replace(captures.slms[0], opd_range_m=780e-9 * k) for k in (1.12, 1.08))
    longer = dataclasses.replace(captures, slms=(first, second))
    found = predicted(captures, {"stroke": {"stroke_error": 0.1, "difference": 0.02}})
    torch.testing.assert_close(found, predicted(longer), rtol=1e-9, atol=0)


def test_it_says_what_the_stroke_is(make_session: Make) -> None:
    said = get_effect("stroke").format_finding(make_session().nominal_system(), {"stroke_error": -0.5})
    assert said == "The stroke is 390 nm, not 780 nm."
