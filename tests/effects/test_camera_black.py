"""The black level moves by counts, the signal stays."""

from __future__ import annotations

from collections.abc import Callable

import torch

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor


def test_it_adds_counts(make_session: Callable[..., Captures]) -> None:
    predict = Predictor(make_session(1))
    found = predict([0], {"camera_black": {"black": 12.5}})
    assert found.black_level == 64.0 + 12.5
    assert torch.equal(found.signal, predict([0]).signal)
