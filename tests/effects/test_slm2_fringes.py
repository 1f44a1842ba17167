"""The fringes of modulator 2 are those of modulator 1, on the other modulator."""

from __future__ import annotations

from collections.abc import Callable

import torch

import holoview as hv
from holoview.captures.dataset import Captures
from holoview.model.bench_parts import Relay
from holoview.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
FRINGES = {"path_x": 4e-6, "cos1": 0.2}


def test_without_a_gap_fringes_on_either_modulator_are_the_same(make_session: Make, predicted: Predicted) -> None:
    """Nor with a stop between: then transmissions multiply."""
    captures = make_session(1, gap_m=0.0, relay1=Relay())
    one, two = (predicted(captures, {f"slm{n}_fringes": FRINGES}) for n in (1, 2))
    torch.testing.assert_close(one, two, rtol=1e-9, atol=1e-12)


def test_it_is_told_in_words() -> None:
    text = get_effect("slm2_fringes").format_finding(hv.load("holochrome-8"), {"path_x": 5.5e-6, "cos1": 0.1})
    assert "depth 0.1 lie over modulator 2; 0 (y) and 10 (x)" in text
