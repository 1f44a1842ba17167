"""A longer gap is a bench with a longer gap."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import torch

from holoview.bench.captures.dataset import Captures
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_it_adds_to_the_gap(make_session: Make, predicted: Predicted) -> None:
    captures = make_session()
    longer = dataclasses.replace(captures, gap_m=1e-3 + 1e-4)
    assert torch.equal(predicted(captures, {"gap": {"gap_error": 1e-4}}), predicted(longer))


def test_it_says_how_long_the_gap_is(make_session: Make) -> None:
    assert (
        get_effect("gap").format_finding(make_session().nominal_system(), {"gap_error": 0.11e-3})
        == "The gap is 1.11 mm, not 1 mm."
    )
