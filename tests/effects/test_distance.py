"""A plane further away is a bench with its plane further away; on a Fourier bench, defocus."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import torch

from holoview.captures.dataset import Captures

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_it_adds_to_the_distance(make_session: Make, predicted: Predicted) -> None:
    captures = make_session()
    further = dataclasses.replace(captures, distance_m=np.full(2, 3e-3 + 1e-4))
    assert torch.equal(predicted(captures, {"distance": {"distance_error": 1e-4}}), predicted(further))


def test_a_fourier_bench_is_defocused_either_way(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier()
    nearer = dataclasses.replace(captures, distance_m=np.full(2, -1e-3))
    found = predicted(captures, {"distance": {"distance_error": -1e-3}})
    torch.testing.assert_close(found, predicted(nearer), rtol=1e-9, atol=0)
    assert not torch.allclose(found, predicted(captures), rtol=0.1)
